"""Bus logs shown to people."""
