"""Prices of the models' answers, and the models' distances from experiments: measured once and stored."""
