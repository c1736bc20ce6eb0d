"""Elimination of the unknowns of a sum of element matrices by dense fronts.

    condense(mesh).stiffness       # against the unknowns that are kept

Elements are halved again and again along whatever coordinate leaves the fewest shared unknowns. From the smallest
halves upwards, each front adds those of its two halves, eliminates what no element outside knows (Cholesky), and passes
on the rest (multifrontal method: Duff and Reid 1983). So all work is dense and no sparse matrix is assembled. Nothing
has to be kept: loads are eliminated along with the matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

LEAF = 400  # unknowns of elements that are eliminated together; smaller fronts cost more calls than they save work


@dataclass(frozen=True, slots=True)
class Mesh:
    """Elements whose matrices are to be added.

    Attributes:
        unknowns: (elements, n), numbers of each element's unknowns; -1 for those that are fixed to zero.
        coordinates: (elements, m), coordinates along which elements may be parted.
        matrices: function that gives the stiffness (count, n, n) of some elements, by their numbers.
        kept: (size,), whether an unknown is kept.
        loads: (size, loads), forces on the unknowns.
    """

    unknowns: Indices
    coordinates: Array
    matrices: Callable[[Indices], Array]
    kept: NDArray[np.bool_]
    loads: Array


@dataclass(frozen=True, slots=True)
class Condensed:
    """What is left of a mesh on its kept unknowns, in the order of their numbers.

    Attributes:
        stiffness: (kept, kept).
        loads: (kept, loads), forces on the kept unknowns that act as the loads do.
        work: (loads, loads), work of each load on the displacements of each other with all kept unknowns held.
        largest: unknowns of the largest front.
    """

    stiffness: Array
    loads: Array
    work: Array
    largest: int


@dataclass(frozen=True, slots=True)
class _Node:
    """Elements `start` to `stop` in the order of elimination; halves: numbers of two earlier nodes, or none."""

    start: int
    stop: int
    halves: tuple[int, ...]


def condense(mesh: Mesh) -> Condensed:
    """Eliminate all unknowns that are not kept.

    Raises:
        EstimateError: the stiffness is not positive definite to working precision: a part is not held.
    """
    elements, nodes = _dissected(mesh)
    unknowns = mesh.unknowns[elements]
    rank, fronts = _numbered(unknowns, nodes, mesh.kept)
    ranked = np.where(unknowns >= 0, rank[unknowns], -1)
    loads = np.empty_like(mesh.loads)
    loads[rank] = mesh.loads
    work = np.zeros((loads.shape[1], loads.shape[1]))
    passed: dict[int, tuple[Indices, Array, Array]] = {}
    for number, (node, (own, rest)) in enumerate(zip(nodes, fronts, strict=True)):
        front = _Front(np.concatenate([own, rest]), len(own), loads.shape[1])
        if node.halves:
            for half in node.halves:
                front.add(*passed.pop(half))
        else:
            numbers = slice(node.start, node.stop)
            front.fill(ranked[numbers], mesh.matrices(elements[numbers]))
        passed[number] = (rest, *front.eliminate(loads[own], work))
    kept, stiffness, moved = passed.popitem()[1]
    lower = np.tril(stiffness, -1)
    return Condensed(
        stiffness=lower + lower.T + np.diag(np.diag(stiffness)),
        loads=loads[kept] + moved,
        work=work,
        largest=max(len(own) + len(rest) for own, rest in fronts),
    )


class _Front:
    """Dense matrix of the unknowns `ranks`, the first `count` of which are to be eliminated. Lower triangles only."""

    def __init__(self, ranks: Indices, count: int, loads: int) -> None:
        self._ranks, self._count = ranks, count
        rest = len(ranks) - count
        self._own, self._rest = (np.zeros((size, size), order="F") for size in (count, rest))
        self._between = np.zeros((rest, count), order="F")
        self._loads = np.zeros((len(ranks), loads))

    def add(self, ranks: Indices, matrix: Array, loads: Array) -> None:
        """Add what is left of one half."""
        places, count = np.searchsorted(self._ranks, ranks), self._count
        self._loads[places] += loads
        cut = int(np.searchsorted(places, count))
        ends = np.flatnonzero(np.diff(places) != 1) + 1
        starts = np.unique(np.concatenate([[0], ends, [cut]])[: len(ends) + 2])
        starts = starts[starts < len(places)]
        stops = np.append(starts[1:], len(places))
        runs = list(zip(places[starts].tolist(), starts.tolist(), stops.tolist(), strict=True))
        for row, (to, low, high) in enumerate(runs):
            for beside, first, last in runs[: row + 1]:
                block = matrix[low:high, first:last]
                self._block(to, beside)[: high - low, : last - first] += block

    def _block(self, row: int, column: int) -> Array:
        count = self._count
        if column >= count:
            return self._rest[row - count :, column - count :]
        return self._own[row:, column:] if row < count else self._between[row - count :, column:]

    def fill(self, ranks: Indices, matrices: Array) -> None:
        """Add element matrices (elements, n, n) of unknowns (elements, n), some of which may be one and the same."""
        size, count = len(self._ranks), self._count
        places = np.where(ranks >= 0, np.searchsorted(self._ranks, ranks), size)  # the last place is for fixed ones
        at = places[:, :, None] * (size + 1) + places[:, None, :]
        total = np.bincount(at.ravel(), matrices.ravel(), (size + 1) ** 2).astype(np.float64, copy=False)
        whole = total.reshape(size + 1, -1)[:size, :size]
        self._own, self._between, self._rest = (
            np.asfortranarray(part) for part in (whole[:count, :count], whole[count:, :count], whole[count:, count:])
        )

    def eliminate(self, loads: Array, work: Array) -> tuple[Array, Array]:
        """Matrix and loads of the rest; adds the loads' work to `work`."""
        from scipy.linalg.blas import dsyrk, dtrsm
        from scipy.linalg.lapack import dpotrf

        count = self._count
        rest = self._loads[count:]
        if not count:
            return self._rest, rest
        factor, failed = dpotrf(self._own, lower=1, clean=0, overwrite_a=1)
        if failed:
            raise EstimateError("a stiffness is not positive definite: a part is not held; hold every part")
        forward = dtrsm(1.0, factor, np.asfortranarray(loads + self._loads[:count]), lower=1)
        work += forward.T @ forward
        if not len(self._between):
            return self._rest, rest
        between = dtrsm(1.0, factor, self._between, side=1, lower=1, trans_a=1, overwrite_b=1)
        matrix = dsyrk(-1.0, between, beta=1.0, c=self._rest, lower=1, overwrite_c=1)
        return matrix, rest - between @ forward


def _dissected(mesh: Mesh) -> tuple[Indices, list[_Node]]:
    """Elements in the order of elimination, and the nodes of the tree, halves before their sums."""
    unknowns, nodes, order = mesh.unknowns, list[_Node](), list[Indices]()
    mark = np.zeros(len(mesh.kept) + 1, dtype=bool)  # the last entry is that of fixed unknowns

    def number(of: Indices) -> int:
        mark[unknowns[of]] = True
        mark[-1] = False
        found = int(np.count_nonzero(mark[unknowns[of]]))
        mark[unknowns[of]] = False
        return found

    def shared(one: Indices, other: Indices) -> int:
        mark[unknowns[one]] = True
        mark[-1] = False
        common = unknowns[other][mark[unknowns[other]]]
        mark[unknowns[one]] = False
        return len(np.unique(common))

    def halved(of: Indices) -> tuple[Indices, Indices]:
        best, fewest = None, np.inf
        for values in mesh.coordinates[of].T:
            sequence = np.argsort(values, kind="stable")
            steps = np.flatnonzero(np.diff(values[sequence]) > 1e-9 * np.ptp(values)) + 1
            if not len(steps):
                continue
            middle = int(steps[np.argmin(np.abs(steps - len(of) / 2))])
            one, other = of[sequence[:middle]], of[sequence[middle:]]
            price = shared(one, other) * (1 + abs(middle / len(of) - 0.5))
            if price < fewest:
                best, fewest = (one, other), price
        if best is None:
            return of[: len(of) // 2], of[len(of) // 2 :]
        return best

    def node(of: Indices, start: int) -> int:
        halves: tuple[int, ...] = ()
        if len(of) > 1 and len(of) * unknowns.shape[1] > LEAF:
            one, other = halved(of)
            halves = (node(one, start), node(other, start + len(one)))
        else:
            order.append(of)
        nodes.append(_Node(start, start + len(of), halves))
        return len(nodes) - 1

    node(np.arange(len(unknowns)), 0)
    return np.concatenate(order), nodes


def _numbered(
    unknowns: Indices, nodes: list[_Node], kept: NDArray[np.bool_]
) -> tuple[Indices, list[tuple[Indices, Indices]]]:
    """New numbers of the unknowns, and by node those that it eliminates and those that it passes on, ascending.

    Numbers rise with the node that eliminates, then with the first element: so neighbours stay together.
    """
    size = len(kept)
    first, last = np.full(size + 1, len(unknowns)), np.full(size + 1, -1)
    at = np.arange(len(unknowns)).repeat(unknowns.shape[1])
    np.minimum.at(first, unknowns.ravel(), at)
    np.maximum.at(last, unknowns.ravel(), at)
    last[:-1][kept] = len(unknowns)
    last[-1] = -1
    passes: list[Indices] = []
    eliminated: list[Indices] = []
    stage = np.full(size, len(nodes))
    for number, node in enumerate(nodes):
        if node.halves:
            own = np.unique(np.concatenate([passes[half] for half in node.halves]))
        else:
            own = np.unique(unknowns[node.start : node.stop])
            own = own[own >= 0]
        inside = (last[own] < node.stop) & (first[own] >= node.start)
        stage[own[inside]] = number
        eliminated.append(own[inside])
        passes.append(own[~inside])
    rank = np.empty(size, dtype=np.intp)
    rank[np.lexsort((first[:-1], stage))] = np.arange(size)
    # Kept unknowns stay in the order of their own numbers.
    rank[kept] = np.arange(size - np.count_nonzero(kept), size)
    return rank, [(np.sort(rank[one]), np.sort(rank[other])) for one, other in zip(eliminated, passes, strict=True)]
