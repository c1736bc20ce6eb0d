"""The finite-element model of the round single sensor."""
