"""Sums of the matrices that elements or smaller fronts pass on to a front."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.dissection import Front, Indices

Array = NDArray[np.float64]

FEW = 100  # unknowns of an element that are added one by one faster than by runs


class Assembled:
    """Dense matrices of a front: of what is eliminated, of the rest, and between both. Lower triangles only."""

    def __init__(self, front: Front, runs: Indices) -> None:
        self._end, self._count = front.first + front.count, front.count
        lengths = runs[:, 1] - runs[:, 0]
        rest = int(lengths.sum())
        self.own, self.rest = (np.zeros((size, size), order="F") for size in (front.count, rest))
        self.between = np.zeros((rest, front.count), order="F")
        self._starts = np.concatenate([[front.first], runs[:, 0]])
        self._offsets = np.concatenate([[0], front.count + np.cumsum(lengths) - lengths])

    def add(self, runs: Indices, matrix: Array) -> None:
        """Add a matrix of runs of unknowns (runs, 2)."""
        end = self._end
        split = np.flatnonzero((runs[:, 0] < end) & (end < runs[:, 1]))
        if len(split):  # at most one is eliminated in part
            runs = np.insert(runs, split + 1, [[end, runs[split[0], 1]]], axis=0)
            runs[split, 1] = end
        where = np.searchsorted(self._starts, runs[:, 0], side="right") - 1
        to = (self._offsets[where] + runs[:, 0] - self._starts[where]).tolist()
        stops = np.cumsum(runs[:, 1] - runs[:, 0]).tolist()
        pieces = list(zip(to, [0, *stops], stops, strict=False))
        for row, (place, low, high) in enumerate(pieces):
            for beside, first, last in pieces[: row + 1]:
                self._block(place, beside)[: high - low, : last - first] += matrix[low:high, first:last]

    def add_numbers(self, own: Indices, matrix: Array) -> None:
        """Add a matrix of unknowns by their numbers, which rise."""
        if len(own) > FEW:
            breaks = np.concatenate([[0], np.flatnonzero(np.diff(own) > 1) + 1, [len(own)]])
            self.add(np.stack([own[breaks[:-1]], own[breaks[1:] - 1] + 1], axis=1), matrix)
            return
        where = np.searchsorted(self._starts, own, side="right") - 1
        to = self._offsets[where] + own - self._starts[where]
        first = int(np.searchsorted(to, self._count))
        here, there = to[:first], to[first:] - self._count
        self.own[here[:, None], here] += matrix[:first, :first]
        self.between[there[:, None], here] += matrix[first:, :first]
        self.rest[there[:, None], there] += matrix[first:, first:]

    def _block(self, row: int, column: int) -> Array:
        count = self._count
        if column >= count:
            return self.rest[row - count :, column - count :]
        return self.own[row:, column:] if row < count else self.between[row - count :, column:]
