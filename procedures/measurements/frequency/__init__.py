"""Frequency sweep of the films and of the drive."""
