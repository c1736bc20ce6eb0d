"""What all simulated devices share on Modbus and CAN: servers, buses, the serial line and its timing."""
