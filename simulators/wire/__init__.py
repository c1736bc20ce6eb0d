"""What simulated devices share on Modbus and CAN: servers, buses, lines and their time."""
