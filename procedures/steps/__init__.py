"""What procedures share on the bench: pressing, driving, recording films, and what is done about failures."""
