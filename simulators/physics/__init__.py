"""The mechanical and electrical chain of a scene: what is put together of coil, stack, films and amplifiers."""
