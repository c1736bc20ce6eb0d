"""What measurements say: forces, force ratios, positions and moduli, with uncertainty."""
