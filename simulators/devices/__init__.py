"""The simulated devices, one module for each device kind."""
