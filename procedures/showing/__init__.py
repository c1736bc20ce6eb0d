"""Results for people: tables in the terminal and plots on disk, each saying where it is simulated."""
