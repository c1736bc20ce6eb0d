"""What an answer costs: lines of uncertainty, the cheapest plan for a tolerance, and when a run has measured enough."""
