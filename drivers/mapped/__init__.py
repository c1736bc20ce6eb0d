"""Drivers of makers' devices: one for each role, which speaks in the fields and commands that a map names for it."""
