"""Parts that both finite-element models share: solving, error estimates, coupling of films."""
