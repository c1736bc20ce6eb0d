"""One simulated device for each device of the bench."""
