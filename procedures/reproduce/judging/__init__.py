"""Differences of the thesis' numbers and ours, and whether they are within their scatter."""
