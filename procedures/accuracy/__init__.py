"""Measuring and showing the time that each sensor model takes for its accuracy."""
