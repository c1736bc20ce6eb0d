"""Shows results to people: tables in the terminal and plots on disk, all of which mark simulated results."""
