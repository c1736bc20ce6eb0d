"""The three-dimensional finite-element model: plates, one tooth or many."""
