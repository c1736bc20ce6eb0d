"""Bounds on the change of the results when an effect is left out of a scene."""
