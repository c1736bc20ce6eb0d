"""The description of a bench: its devices, its links, and the tasks of its operator."""
