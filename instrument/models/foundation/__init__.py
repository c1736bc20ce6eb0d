"""Models without a mesh in space: beams on elastic foundations, and springs in parallel."""
