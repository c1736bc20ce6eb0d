"""The thesis' figures under their own numbers: its values as marks, ours as curves."""
