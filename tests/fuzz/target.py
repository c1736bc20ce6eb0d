"""Decoders under hostile input, by name: what each takes, the property that it is held to, inputs and their changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from random import Random

from palpate.instrument.errors import PalpateError

CORPUS = Path(__file__).with_name("corpus")
"""Inputs that were met or thought of, kept for good; `<decoder>-<what>`."""

# Where a decoder is, and how many of a thousand inputs it gets: fast ones more, and what comes over a wire.
TARGETS = {
    "modbus_tcp": ("modbus:tcp", 160),
    "modbus_rtu": ("modbus:rtu", 120),
    "sdo_answers": ("can:sdo_answers", 150),
    "node_frames": ("can:node_frames", 150),
    "fields": ("values:fields", 300),
    "quantities": ("values:quantities", 60),
    "bench_files": ("files:bench", 24),
    "scene_files": ("files:scene", 8),
    "load_cell_calibrations": ("files:load_cell", 12),
    "film_calibrations": ("files:films", 8),
    "price_lists": ("files:prices", 3),
    "surfaces": ("files:surface", 3),
    "runs": ("files:run", 2),
}


def target(name: str) -> Target:
    """Raises KeyError."""
    module, function = TARGETS[name][0].split(":")
    made: Target = getattr(import_module(f"tests.fuzz.{module}"), function)()
    return made


class WronglyAcceptedError(AssertionError):
    """A decoder gave a value that the bytes do not hold."""


@dataclass(frozen=True, slots=True)
class Target:
    """A decoder.

    Attributes:
        seeds: good inputs, which it must accept.
        decode: what a value decoded from the input is compared with lies in here: returns after a value that an
            independent reading of the same bytes gives too, raises PalpateError where the input is refused, and
            WronglyAcceptedError where the two differ.
        words: pieces that mutations put in.
    """

    seeds: Sequence[bytes]
    decode: Callable[[bytes], None]
    words: Sequence[bytes] = ()

    def accepts(self, data: bytes) -> bool:
        """False where the input is refused; whatever else is raised is a finding."""
        try:
            self.decode(data)
        except PalpateError:
            return False
        return True


def require(same: bool, what: str, *details: object) -> None:
    """Raises WronglyAcceptedError."""
    if not same:
        raise WronglyAcceptedError(f"{what}: {', '.join(map(repr, details))}"[:1000])


def same_number(one: float, other: float) -> bool:
    """Equal to rounding, or both NaN."""
    return one == other or math.isclose(one, other, rel_tol=1e-14) or (math.isnan(one) and math.isnan(other))


def keep(name: str, data: bytes) -> Path:
    """Into the corpus."""
    path = CORPUS / f"{name}-{sha256(data).hexdigest()[:8]}"
    path.write_bytes(data)
    return path


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
