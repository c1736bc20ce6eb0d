"""Calibration of the films against the load cell."""
