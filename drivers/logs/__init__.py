"""Files of all that went over a bench's links: written, read, and answered from again."""
