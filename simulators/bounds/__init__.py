"""What leaving an effect out of a scene changes in the results, at most."""
