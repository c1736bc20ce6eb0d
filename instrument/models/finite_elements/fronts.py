"""Elimination of the unknowns of a sum of element matrices by dense fronts.

    condense(mesh).stiffness       # against the unknowns that are kept

From the smallest fronts upwards, each adds those of its two halves, eliminates what no element outside knows
(Cholesky), and passes on the rest (multifrontal method: Duff and Reid 1983). So all work is dense and no sparse matrix
is assembled. Nothing has to be kept for later: loads are eliminated along with the matrix.
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
from palpate.instrument.models.finite_elements import notice
from palpate.instrument.models.finite_elements.dissection import Front, Indices, Order, dissected

Array = NDArray[np.float64]

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
    notice.begin(order.operations, len(mesh.kept))
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
    """Factor of a front, its coupling to the rest, and its part of the forward elimination of the loads."""

    front: Front
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
        self._loads = np.empty_like(mesh.loads)
        self._loads[order.rank] = mesh.loads
        self._made: tuple[int, Array] = (-AT_ONCE, np.empty(0))
        self.work = np.zeros((mesh.loads.shape[1],) * 2)

    def run(self) -> tuple[Array, Array]:
        """Matrix (lower triangle) and loads of the kept unknowns, in the order of elimination."""
        passed: list[tuple[Indices, Array, Array]] = []
        for front in self._order.fronts:
            assembled = _Assembled(front, self._loads.shape[1])
            if front.halves:
                for half in passed[-len(front.halves) :]:
                    assembled.add(*half)
                del passed[-len(front.halves) :]
            else:
                for place in range(front.start, front.stop):
                    self._fill(assembled, place)
            passed.append((front.rest, *self._eliminate(assembled)))
        _, stiffness, loads = passed.pop()
        first = len(self._mesh.kept) - len(loads)
        return stiffness, self._loads[first:] + loads

    def _fill(self, assembled: _Assembled, place: int) -> None:
        """Add an element, by its place in the order of elimination."""
        ranks, sequence = self._ranked[place], self._sequence[place]
        fixed = int(np.searchsorted(ranks, 0))
        matrix = self._matrix(place)[np.ix_(sequence[fixed:], sequence[fixed:])]
        ranks = ranks[fixed:]
        steps = np.diff(ranks)
        if not steps.all():
            # An unknown that moves several places of one element stands there several times.
            begins = np.concatenate([[0], np.flatnonzero(steps) + 1])
            matrix = np.add.reduceat(np.add.reduceat(matrix, begins, axis=0), begins, axis=1)
            ranks = ranks[begins]
            steps = np.diff(ranks)
        begins = np.concatenate([[0], np.flatnonzero(steps != 1) + 1])
        ends = np.append(begins[1:], len(ranks))
        runs = np.stack([ranks[begins], ranks[ends - 1] + 1], axis=1)
        assembled.add(runs, matrix, np.zeros((len(ranks), 0)))

    def _matrix(self, place: int) -> Array:
        first, matrices = self._made
        if not first <= place < first + AT_ONCE:
            first = place - place % AT_ONCE
            matrices = self._mesh.matrices(self._order.elements[first : first + AT_ONCE])
            self._made = first, matrices
        found: Array = matrices[place - first]
        return found

    def _eliminate(self, assembled: _Assembled) -> tuple[Array, Array]:
        """Matrix and loads of the rest."""
        front, rest = assembled.front, assembled.loads[assembled.front.count :]
        if not front.count:
            return assembled.rest, rest
        factor, failed = dpotrf(assembled.own, lower=1, clean=0, overwrite_a=1)
        if failed:
            raise EstimateError(
                "finite elements: the stiffness of a part is not positive definite to working precision; bring moduli"
                " and dimensions closer together"
            )
        own = self._loads[front.first : front.first + front.count] + assembled.loads[: front.count]
        forward = dtrsm(1.0, factor, np.asfortranarray(own), lower=1)
        self.work += forward.T @ forward
        between, matrix = assembled.between, assembled.rest
        if len(between):
            between = dtrsm(1.0, factor, between, side=1, lower=1, trans_a=1, overwrite_b=1)
            matrix = dsyrk(-1.0, between, beta=1.0, c=matrix, lower=1, overwrite_c=1)
            rest = rest - between @ forward
        if self._remembers:
            self._remembered.append(_Remembered(front, factor, between, forward))
        return matrix, rest

    def inside(self, kept: Array, factors: Array) -> Array:
        """Displacements of all unknowns, as in `Condensed`."""
        rank, held = self._order.rank, self._mesh.kept
        moved = np.empty(len(rank))
        moved[rank[held]] = kept
        for each in reversed(self._remembered):
            front = each.front
            pull = each.forward @ factors
            if len(each.between):
                pull = pull - each.between.T @ np.concatenate([moved[low:high] for low, high in front.rest])
            found = dtrsm(1.0, each.factor, pull[:, None], lower=1, trans_a=1)
            moved[front.first : front.first + front.count] = found[:, 0]
        return moved[rank]


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
