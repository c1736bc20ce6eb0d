"""Counter-based random streams: the n-th number of a stream is a function of seed, name and n alone.

So any block size gives the same numbers, any moment is reached without stepping there, and adding or
removing one effect leaves the numbers of every other unchanged. Philox is the generator of Salmon et al.,
"Parallel random numbers: as easy as 1, 2, 3" (SC11); normals come by inverting the distribution function,
one number each, because rejection methods use up a variable count.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.random import Philox
from scipy.special import ndtri

_WORDS = 4  # numbers that one step of the Philox counter gives


class Stream:
    """Independent standard normals, numbered from 0. Streams of one seed and name are equal."""

    def __init__(self, seed: int, *name: object) -> None:
        self._name: tuple[Any, ...] = (seed, *name)
        digest = hashlib.sha256(repr(self._name).encode()).digest()
        self._key = int.from_bytes(digest[:16], "little")

    def child(self, *name: object) -> Stream:
        """The stream of a part, independent of this one and of its other children."""
        return Stream(*self._name, *name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Stream) and self._name == other._name

    def __hash__(self) -> int:
        return self._key

    def normal(self, first: int, count: int) -> npt.NDArray[np.float64]:
        """Numbers `first` to `first + count - 1`, shape (count,)."""
        step, offset = divmod(first, _WORDS)
        words = Philox(key=self._key, counter=step).random_raw(offset + count)[offset:]
        # 52 bits and a half are exact in a double; with 53 the largest would round to 1, whose normal is infinite
        uniform = ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
        values: npt.NDArray[np.float64] = ndtri(uniform)
        return values
