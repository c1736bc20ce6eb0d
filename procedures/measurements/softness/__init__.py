"""How hard unknown objects are."""
