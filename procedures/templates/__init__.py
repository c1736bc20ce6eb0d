"""Files that begin a device, an effect or a procedure of one's own."""
