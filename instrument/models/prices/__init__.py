"""What answers of the models cost, and how far models lie from experiments: measured once and stored."""
