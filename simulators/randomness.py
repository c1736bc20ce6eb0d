"""Counter-based random streams: the n-th number of a stream depends on the seed, the stream's name and n only.

Any block size therefore gives the same numbers, any moment can be reached directly, and adding or removing one effect
leaves the numbers of all others unchanged. NumPy's ziggurat method makes a normal number from a varying count of
random words. Numbers are therefore drawn in blocks, and each block seeds its own generator with its block number. The
generator is SFC64 (C. Doty-Humphrey, PractRand), NumPy's fastest.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random import SFC64, Generator

BLOCK = 512  # random numbers in a block: a load set uses a few hundred of each stream
MIXING = 12  # words to discard until every bit of the seed has reached every bit of the state
_KEPT = 2  # blocks kept, so that small pieces across a border draw each block once


class _ThreadsOwn(threading.local):
    """A thread's generator, which takes longer to make than a block to draw; each block sets its whole state."""

    def __init__(self) -> None:
        self.generator = Generator(SFC64(0))
        self.state = dict(self.generator.bit_generator.state)


_OWN = _ThreadsOwn()


class Stream:
    """Independent standard normals, numbered from 0. Streams of one seed and name are equal."""

    def __init__(self, seed: int, *name: object) -> None:
        self._name: tuple[Any, ...] = (seed, *name)
        digest = hashlib.sha256(repr(self._name).encode()).digest()
        self._words = int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")
        self._state = np.array([*self._words, 0, 1], np.uint64)  # those of two blocks differ in the block number only
        self._blocks: dict[int, npt.NDArray[np.float64]] = {}
        self.kept: dict[object, Any] = {}  # a cache for effects, of values computed from this stream's numbers

    def child(self, *name: object) -> Stream:
        """The stream of a part, independent of this one and of its other children."""
        return Stream(*self._name, *name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Stream) and self._words == other._words

    def __hash__(self) -> int:
        return self._words[0]

    def normal(self, first: int, count: int) -> npt.NDArray[np.float64]:
        """Numbers `first` to `first + count - 1`, shape (count,), not to be written to."""
        return cut(self.block, first, count)

    def spread(self, deviation: float, first: int, count: int) -> npt.NDArray[np.float64]:
        """`normal` times a standard deviation; where that is 0, nothing is drawn."""
        return deviation * self.normal(first, count) if deviation else np.zeros(count)

    def block(self, number: int) -> npt.NDArray[np.float64]:
        """Numbers `number` * BLOCK to the next multiple, (BLOCK,), not to be written to."""
        if number not in self._blocks:
            self._state[2] = number
            _OWN.state["state"]["state"] = self._state
            _OWN.generator.bit_generator.state = _OWN.state
            _OWN.generator.bit_generator.random_raw(MIXING)  # with `output=False` it takes three times as long
            keep(self._blocks, number, _OWN.generator.standard_normal(BLOCK))
        return self._blocks[number]


def cut(block: Callable[[int], npt.NDArray[np.float64]], first: int, count: int) -> npt.NDArray[np.float64]:
    """Numbers `first` to `first + count - 1`, shape (count,), of the sequence that all blocks make."""
    number, start = divmod(first, BLOCK)
    end = start + count
    if end <= BLOCK:
        return block(number)[start:end]
    whole = range(number + 1, number + (end - 1) // BLOCK)
    last = number + (end - 1) // BLOCK
    return np.concatenate([block(number)[start:], *map(block, whole), block(last)[: (end - 1) % BLOCK + 1]])


def keep(
    blocks: dict[int, npt.NDArray[np.float64]], number: int, values: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Cache a block in place of the oldest, and make it read-only."""
    values.flags.writeable = False
    for old in list(blocks)[: 1 - _KEPT]:
        del blocks[old]
    blocks[number] = values
    return values
