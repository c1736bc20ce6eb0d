"""Parts that both finite-element models share: condensing, curves, error estimates, coupling of films."""
