"""An open bench, real or simulated, with its person, calibrations and records."""
