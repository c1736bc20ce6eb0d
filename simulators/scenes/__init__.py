"""The definition of a scene, and the scenes that come with palpate."""
