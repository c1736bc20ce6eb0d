"""An open bench, real or simulated, with its operator, calibrations and records."""
