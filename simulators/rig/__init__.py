"""The physical rig behind the simulated devices, built from a scene and its effects."""
