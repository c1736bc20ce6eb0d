"""The live page: a run that a browser shows while it goes on."""
