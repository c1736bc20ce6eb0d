"""Load sweep: the main job."""
