"""What every procedure is given: a plan, a record, resuming and replaying."""
