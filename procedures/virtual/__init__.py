"""What is asked of a scene instead of a bench, and benches that are served to other programs."""
