"""The thesis' models and their tables beside our models."""
