"""Work on simulated scenes without a run: the cells of a study, and benches that are served to other programs."""
