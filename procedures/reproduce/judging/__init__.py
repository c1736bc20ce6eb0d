"""How far the thesis' numbers and ours are apart, and whether that is within their scatter."""
