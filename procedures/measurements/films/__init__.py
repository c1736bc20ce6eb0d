"""Film calibration against the load cell."""
