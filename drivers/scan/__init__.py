"""Finds out which devices answer on TCP addresses, serial lines and CAN buses, by reading alone."""
