"""Bus logs: files of everything that went over a bench's links. They are written, read and replayed."""
