"""What both finite-element models share: solving, estimating errors, coupling films."""
