"""Calibration of a sensor model by references, objects of known modulus."""
