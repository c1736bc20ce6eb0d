"""Uncertainty budgets, and where uncertainty comes from that readings do not show."""
