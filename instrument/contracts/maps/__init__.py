"""Maps of makers' devices: files that say what a contract says, with frames that prove them.

A map that comes with palpate is a file in this folder; its name is that of the device kind.
"""
