"""Steps that procedures share on the bench: pressing, driving, recording films, and handling failures."""
