"""Measures what the accuracy of each sensor model costs in time, and shows it."""
