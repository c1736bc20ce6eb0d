"""The thesis' tables and figures beside what the models give: one file a kind of table."""
