"""What a scene is, and the scenes that come with palpate."""
