"""Calibrations of load cells and films, how good they are, and their files."""
