"""Twins of makers' devices, made from their maps: what a role needs of the rig, through fields that the map names."""
