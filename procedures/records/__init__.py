"""Runs on disk: written durably, read, checked, repaired, continued and exported."""
