"""Studies: many scenes, each swept through the loads. Their description, how they are run, and their results."""
