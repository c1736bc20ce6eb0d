"""The mechanical and electrical chain of a scene: coil, stack, films and amplifiers."""
