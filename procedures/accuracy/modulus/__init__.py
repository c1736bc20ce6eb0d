"""How well a modulus is known after which bench time."""
