"""The Young modulus of one object to a tolerance, or as well as a time allows."""
