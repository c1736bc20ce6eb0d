"""Sensor models: what force the tooth takes. `response` is the one call; its MODELS lists them."""
