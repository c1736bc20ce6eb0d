"""One driver for each device of the bench, and what drivers of one bus share."""
