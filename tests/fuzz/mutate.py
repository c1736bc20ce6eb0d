"""Mutations of good inputs; the same seed gives the same inputs."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

EDGES = (0, 1, 2, 3, 4, 7, 8, 16, 32, 64, 0x7F, 0x80, 0x81, 0xFE, 0xFF)
LONGEST = 1 << 17  # bytes that an input grows to


def mutate(random: Random, seeds: Sequence[bytes], words: Sequence[bytes]) -> bytes:
    """One to eight changes of a good input."""
    data = bytearray(random.choice(seeds))
    for _ in range(1 << int(random.random() * 4)):
        at = int(random.random() * (len(data) + 1))
        kind = int(random.random() * 10)
        if kind < 3 and at < len(data):
            data[at] ^= 1 << int(random.random() * 8)
        elif kind < 5 and at < len(data):
            data[at] = random.choice(EDGES) if kind == 3 else int(random.random() * 256)
        elif kind == 5:
            data[at:at] = random.choice(words) if words else bytes([random.choice(EDGES)])
        elif kind == 6:
            del data[at : at + 1 + int(random.random() * 8)]
        elif kind == 7:
            other = random.choice(seeds)
            start = int(random.random() * (len(other) + 1))
            data[at : at + 16] = other[start : start + 16]
        elif kind == 8:
            data[at:at] = data[at : at + 1 + int(random.random() * 16)]
        elif random.random() < 0.3:
            del data[at:]
    return bytes(data[:LONGEST])
