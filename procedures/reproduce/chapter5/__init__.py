"""The thesis' experiments beside experiments on the simulated bench."""
