"""The two kinds of links, Modbus and CAN, each behind the one module that imports its library."""
