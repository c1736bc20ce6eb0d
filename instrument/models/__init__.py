"""Sensor models: the force that the tooth takes. All are asked by one call, `response`; MODELS lists them."""
