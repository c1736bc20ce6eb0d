"""Frequency sweep."""
