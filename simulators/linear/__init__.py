"""Piecewise linear systems under periodic inputs, in closed form: mathematics that knows nothing of a bench."""
