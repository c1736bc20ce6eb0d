"""Temperature sweep."""
