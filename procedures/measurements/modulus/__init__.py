"""Young modulus of a sample by compression."""
