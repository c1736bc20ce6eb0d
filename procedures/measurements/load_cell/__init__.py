"""Load-cell calibration with dead weights."""
