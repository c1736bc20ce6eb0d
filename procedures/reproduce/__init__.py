"""The thesis' tables and figures beside ours: one file for each kind of table."""
