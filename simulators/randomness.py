"""Counter-based random streams: the n-th number of a stream is a function of seed, name and n alone.

So any block size gives the same numbers, any moment is reached without stepping there, and adding or
removing one effect leaves the numbers of every other unchanged. Numpy's ziggurat, which makes the normals, uses up a
variable count of words: so numbers come in blocks, and the count of the block is part of what its generator is seeded
with. That is SFC64 by C. Doty-Humphrey, of PractRand, the fastest that numpy has.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random import SFC64, Generator

BLOCK = 4096  # numbers of one count
MIXING = 12  # words from which on every bit of the seed is in every word
_KEPT = 2  # blocks: what is read across their border in small pieces is drawn once


class Stream:
    """Independent standard normals, numbered from 0. Streams of one seed and name are equal."""

    def __init__(self, seed: int, *name: object) -> None:
        self._name: tuple[Any, ...] = (seed, *name)
        digest = hashlib.sha256(repr(self._name).encode()).digest()
        self._words = int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")
        self._blocks: dict[int, npt.NDArray[np.float64]] = {}
        self.kept: dict[object, Any] = {}  # what is made of its numbers, as long as it is there itself

    @functools.cached_property
    def _generator(self) -> Generator:
        return Generator(SFC64(0))

    @functools.cached_property
    def _state(self) -> dict[str, Any]:
        """Of the generator; that of a block differs in the number of the block alone."""
        state = dict(self._generator.bit_generator.state)
        state["state"] = {"state": np.array([*self._words, 0, 1], np.uint64)}
        return state

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

    def block(self, number: int) -> npt.NDArray[np.float64]:
        """Numbers `number` * BLOCK to the next multiple, (BLOCK,), not to be written to."""
        if number not in self._blocks:
            self._state["state"]["state"][2] = number
            self._generator.bit_generator.state = self._state
            self._generator.bit_generator.random_raw(MIXING)  # without output it takes three times as long
            keep(self._blocks, number, self._generator.standard_normal(BLOCK))
        return self._blocks[number]


def cut(block: Callable[[int], npt.NDArray[np.float64]], first: int, count: int) -> npt.NDArray[np.float64]:
    """Numbers `first` to `first + count - 1`, shape (count,), of all blocks one after the other."""
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
    """Puts a block, from now on not to be written to, in the place of the oldest."""
    values.flags.writeable = False
    for old in list(blocks)[: 1 - _KEPT]:
        del blocks[old]
    blocks[number] = values
    return values
