"""Many scenes, each swept through the loads: what a study is, how it is run anywhere, what it found."""
