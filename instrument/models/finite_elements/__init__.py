"""Parts that both finite-element models share: elimination, curves over the modulus, error estimates, what is kept."""
