"""The load sweep: force ratios of samples under several loads."""
