"""Curves of force ratio over modulus, computed beforehand and evaluated in microseconds."""
