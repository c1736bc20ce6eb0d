"""A sensor's figures of merit from one run."""
