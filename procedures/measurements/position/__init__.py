"""Position sweep."""
