"""The physical rig behind the simulated devices, put together of what a scene's effects make of it."""
