"""What a bench is, on paper: its description, the lines between devices, and the person at it."""
