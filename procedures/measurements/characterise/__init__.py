"""The characterisation of a sensor: its figures of merit from one run."""
