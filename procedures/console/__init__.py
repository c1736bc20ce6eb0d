"""How palpate speaks to the person at a terminal: texts, and a bar that shows how far a long job is."""
