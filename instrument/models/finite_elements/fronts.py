"""Elimination of the unknowns of a sum of element matrices by dense fronts.

    condense(mesh).stiffness       # against the unknowns that are kept

Unknowns inside one element are eliminated from its own matrix. Then, from the smallest fronts upwards, each adds those
of its two halves, eliminates what no element outside knows (Cholesky), and passes on the rest (multifrontal method:
Duff and Reid 1983). So all work is dense and no sparse matrix is assembled. Nothing has to be kept for later: loads are
eliminated along with the matrix.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements import set_up
from palpate.instrument.models.finite_elements.dissection import Front, Indices, Order, dissected

Array = NDArray[np.float64]
# Of some unknowns, between the rest and them, and of the rest. Only lower triangles of the first and the last count.
_Matrices = tuple[Array, Array, Array]

# Elements whose matrices are made at once: fewer cost more calls, more cost memory.
AT_ONCE = 16
COPIES = 6  # of the kept unknowns' matrix, as its poles are found
# Least share of the machine's memory that is left to everything else.
LEFT = 0.1


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
        inside: function that gives the displacements (size,) of all unknowns from those of the kept ones (kept,), under
            a sum of the loads with these factors (loads,); None: what it needs was not remembered.
    """

    stiffness: Array
    loads: Array
    work: Array
    inside: Callable[[Array, Array], Array] | None = None


def condense(mesh: Mesh, remembers: bool = False) -> Condensed:
    """Eliminate all unknowns that are not kept.

    Args:
        mesh: the elements.
        remembers: whether to keep in memory what gives the displacements of all unknowns later.

    Raises:
        EstimateError: the fronts do not fit into memory, or the stiffness is not positive definite to working
            precision: a part is not held.
    """
    order = dissected(mesh.unknowns, mesh.coordinates, mesh.kept)
    _require_memory(order, mesh, remembers)
    set_up.begin(order.operations, len(mesh.kept))
    elimination = _Elimination(mesh, order, remembers)
    stiffness, loads = elimination.run()
    places = order.rank[mesh.kept] - (len(mesh.kept) - np.count_nonzero(mesh.kept))
    lower = np.tril(stiffness)
    whole = lower + lower.T
    np.fill_diagonal(whole, np.diagonal(stiffness))
    return Condensed(
        stiffness=whole[np.ix_(places, places)],
        loads=loads[places],
        work=elimination.work,
        inside=elimination.inside if remembers else None,
    )


def _require_memory(order: Order, mesh: Mesh, remembers: bool) -> None:
    """Check that the fronts fit into memory. Raises EstimateError."""
    entries = order.entries + 2 * mesh.loads.size + AT_ONCE * mesh.unknowns.shape[1] ** 2
    entries += COPIES * int(np.count_nonzero(mesh.kept)) ** 2
    if remembers:
        entries += sum(front.count * front.size for front in order.fronts)
    needed, has = 8 * entries, machine_memory()
    if has is not None and needed > (1 - LEFT) * has:
        raise EstimateError(
            f"finite elements: {len(mesh.kept)} unknowns need {needed / 1e9:.1f} GB of memory, and this machine has"
            f" {has / 1e9:.1f} GB; give a larger tolerance"
        )


def machine_memory() -> int | None:
    """Memory of this machine in bytes; None: it does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


@dataclass(frozen=True, slots=True)
class _Remembered:
    """Numbers of unknowns that were eliminated together, their factor, and their part of the loads' elimination.

    `between` couples them to the unknowns `rest`.
    """

    first: int
    rest: Indices
    factor: Array
    between: Array
    forward: Array


class _Elimination:
    """Elimination of a mesh in an order; `work` as in `Condensed`."""

    def __init__(self, mesh: Mesh, order: Order, remembers: bool) -> None:
        self._mesh, self._order, self._remembers = mesh, order, remembers
        self._remembered: list[_Remembered] = []
        unknowns = mesh.unknowns[order.elements]
        ranked = np.where(unknowns >= 0, order.rank[unknowns], -1)
        self._sequence = np.argsort(ranked, axis=1)
        self._ranked = np.take_along_axis(ranked, self._sequence, axis=1)
        self._fixed = np.count_nonzero(ranked < 0, axis=1)
        self._loads = np.empty_like(mesh.loads)
        self._loads[order.rank] = mesh.loads
        self._made: tuple[int, Array] = (-AT_ONCE, np.empty(0))
        self.work = np.zeros((mesh.loads.shape[1],) * 2)

    def run(self) -> tuple[Array, Array]:
        """Matrix (lower triangle) and loads of the kept unknowns, in the order of elimination."""
        passed: list[tuple[Indices, Array, Array]] = []
        for front in self._order.fronts:
            if front.halves:
                added = _Assembled(front, self._loads.shape[1])
                for half in passed[-len(front.halves) :]:
                    added.add(*half)
                del passed[-len(front.halves) :]
                matrices, loads = (added.own, added.between, added.rest), added.loads
            else:
                matrices, loads = self._elements(front)
            passed.append((front.rest, *self._eliminate(front.first, front.others, matrices, loads)))
        _, stiffness, loads = passed.pop()
        first = len(self._mesh.kept) - len(loads)
        return stiffness, self._loads[first:] + loads

    def _elements(self, front: Front) -> tuple[_Matrices, Array]:
        """Sum of the matrices of a front's own elements, and what these pass on of their loads."""
        numbers = np.concatenate([np.arange(front.first, front.first + front.count), front.others])
        matrix, loads = np.zeros((len(numbers),) * 2, order="F"), np.zeros((len(numbers), self._loads.shape[1]))
        for place in range(front.start, front.stop):
            ranks, own, own_loads = self._element(place)
            at = np.searchsorted(numbers, ranks)
            # Whole columns are added faster than single entries.
            columns = np.zeros((len(numbers), len(at)), order="F")
            columns[at] = own
            matrix.T[at] += columns.T
            loads[at] += own_loads
        return _parted(matrix, front.count), loads

    def _element(self, place: int) -> tuple[Indices, Array, Array]:
        """Unknowns that an element shares, their matrix (lower triangle) and loads.

        Args:
            place: its place in the order of elimination.
        """
        free = slice(self._fixed[place], None)
        ranks, matrix = self._ranked[place, free], self._matrix(place, self._sequence[place, free])
        steps = np.diff(ranks)
        if not steps.all():
            # An unknown that moves several places of one element stands there several times.
            begins = np.concatenate([[0], np.flatnonzero(steps) + 1])
            matrix = np.add.reduceat(np.add.reduceat(matrix, begins, axis=0), begins, axis=1)
            ranks = ranks[begins]
        count = int(np.searchsorted(ranks, self._order.inside))
        loads = np.zeros((len(ranks), self._loads.shape[1]))
        return ranks[count:], *self._eliminate(int(ranks[0]), ranks[count:], _parted(matrix, count), loads)

    def _matrix(self, place: int, unknowns: Indices) -> Array:
        """Matrix of an element, with some of its unknowns in their order."""
        first, matrices = self._made
        if not first <= place < first + AT_ONCE:
            first = place - place % AT_ONCE
            matrices = self._mesh.matrices(self._order.elements[first : first + AT_ONCE])
            self._made = first, matrices
        # One axis after the other: both at once take five times as long.
        found: Array = matrices[place - first][unknowns].take(unknowns, axis=1)
        return found

    def _eliminate(self, first: int, others: Indices, matrices: _Matrices, loads: Array) -> tuple[Array, Array]:
        """Matrix and loads of the others.

        Args:
            first: first of the unknowns that are eliminated.
            others: unknowns on which these act.
            matrices: matrices of both, which are overwritten.
            loads: passed on by what was eliminated before, on all these unknowns.
        """
        own, between, matrix = matrices
        count = len(own)
        rest = loads[count:]
        if not count:
            return matrix, rest
        factor, failed = dpotrf(own, lower=1, clean=0, overwrite_a=1)
        if failed:
            raise EstimateError(
                "finite elements: the stiffness of a part is not positive definite to working precision; bring moduli"
                " and dimensions closer together"
            )
        pushed = self._loads[first : first + count] + loads[:count]
        forward = dtrsm(1.0, factor, np.asfortranarray(pushed), lower=1)
        self.work += forward.T @ forward
        if len(between):
            between = dtrsm(1.0, factor, between, side=1, lower=1, trans_a=1, overwrite_b=1)
            matrix = dsyrk(-1.0, between, beta=1.0, c=matrix, lower=1, overwrite_c=1)
            rest = rest - between @ forward
        if self._remembers:
            self._remembered.append(_Remembered(first, others, factor, between, forward))
        return matrix, rest

    def inside(self, kept: Array, factors: Array) -> Array:
        """Displacements of all unknowns, as in `Condensed`."""
        rank, held = self._order.rank, self._mesh.kept
        moved = np.empty(len(rank))
        moved[rank[held]] = kept
        for each in reversed(self._remembered):
            pull = each.forward @ factors - each.between.T @ moved[each.rest]
            found = dtrsm(1.0, each.factor, pull[:, None], lower=1, trans_a=1)
            moved[each.first : each.first + len(found)] = found[:, 0]
        return moved[rank]


def _parted(matrix: Array, count: int) -> _Matrices:
    """Copies of the parts of a matrix: of the first unknowns, of the rest with them, and of the rest."""
    own, between, rest = matrix[:count, :count], matrix[count:, :count], matrix[count:, count:]
    return np.array(own, order="F"), np.array(between, order="F"), np.array(rest, order="F")


class _Assembled:
    """Dense matrices of a front: of what is eliminated, of the rest, and between both. Lower triangles only."""

    def __init__(self, front: Front, loads: int) -> None:
        self.front = front
        count, rest = front.count, front.passed
        self.own, self.rest = (np.zeros((size, size), order="F") for size in (count, rest))
        self.between = np.zeros((rest, count), order="F")
        self.loads = np.zeros((count + rest, loads))
        lengths = front.rest[:, 1] - front.rest[:, 0]
        self._starts = np.concatenate([[front.first], front.rest[:, 0]])
        self._offsets = np.concatenate([[0], count + np.cumsum(lengths) - lengths])

    def add(self, runs: Indices, matrix: Array, loads: Array) -> None:
        """Add a matrix and loads of runs of unknowns (runs, 2)."""
        end = self.front.first + self.front.count
        split = np.flatnonzero((runs[:, 0] < end) & (end < runs[:, 1]))
        if len(split):  # at most one is eliminated in part
            runs = np.insert(runs, split + 1, [[end, runs[split[0], 1]]], axis=0)
            runs[split, 1] = end
        where = np.searchsorted(self._starts, runs[:, 0], side="right") - 1
        to = (self._offsets[where] + runs[:, 0] - self._starts[where]).tolist()
        lengths = runs[:, 1] - runs[:, 0]
        stops = np.cumsum(lengths).tolist()
        pieces = list(zip(to, [0, *stops], stops, strict=False))
        for row, (place, low, high) in enumerate(pieces):
            if loads.shape[1]:
                self.loads[place : place + high - low] += loads[low:high]
            for beside, first, last in pieces[: row + 1]:
                self._block(place, beside)[: high - low, : last - first] += matrix[low:high, first:last]

    def _block(self, row: int, column: int) -> Array:
        count = self.front.count
        if column >= count:
            return self.rest[row - count :, column - count :]
        return self.own[row:, column:] if row < count else self.between[row - count :, column:]
