"""Elimination of the unknowns of a sum of element matrices by dense fronts.

    condense(mesh).stiffness       # against the unknowns that are kept

Unknowns inside one element are eliminated from its own matrix. Then, from the smallest fronts upwards, each adds those
of its two halves, eliminates what no element outside knows (Cholesky), and passes on the rest (multifrontal method:
Duff and Reid 1983). So all work is dense and no sparse matrix is assembled. Nothing has to be kept for later: loads are
eliminated along with the matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.assembled import Assembled
from palpate.instrument.models.finite_elements.cost import Cost, of_elimination, require_memory
from palpate.instrument.models.finite_elements.dense import factorised, less_square, solved
from palpate.instrument.models.finite_elements.dissection import Indices, Order, dissected, numbers
from palpate.instrument.models.finite_elements.threads import go_on

Array = NDArray[np.float64]

# Elements whose matrices are made at once: fewer cost more calls, more cost memory.
AT_ONCE = 16
BLOCK = 256  # rows


@dataclass(frozen=True, slots=True)
class Mesh:
    """Elements whose matrices are to be added.

    Attributes:
        unknowns: (elements, n), numbers of each element's unknowns; -1 for those that are fixed to zero.
        coordinates: (elements, m), coordinates along which elements may be parted.
        matrices: function that gives the stiffness of each of some elements, by their numbers; of its unknowns up to
            the last that is not fixed. Only upper triangles count.
        kept: (size,), whether an unknown is kept.
        loads: (size, loads), forces on the unknowns.
    """

    unknowns: Indices
    coordinates: Array
    matrices: Callable[[Indices], Sequence[Array] | Array]
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
    require_memory(_cost(order, mesh, remembers), "give a larger tolerance")
    elimination = _Elimination(mesh, order, remembers)
    stiffness, loads, work = elimination.run()
    places = order.rank[mesh.kept] - (len(mesh.kept) - np.count_nonzero(mesh.kept))
    _mirror(stiffness)
    _mirror(work)
    return Condensed(
        stiffness=stiffness[places].take(places, axis=1, mode="clip"),
        loads=loads[places],
        work=work,
        inside=elimination.inside if remembers else None,
    )


def _mirror(matrix: Array) -> None:
    """Fill the upper triangle of a symmetric matrix from its lower one, in place and by blocks that the cache holds."""
    for row in range(0, len(matrix), BLOCK):
        rows = slice(row, row + BLOCK)
        for column in range(0, row, BLOCK):
            columns = slice(column, column + BLOCK)
            matrix[columns, rows] = matrix[rows, columns].T
        own = matrix[rows, rows]
        own[:] = np.tril(own) + np.tril(own, -1).T


def cost_of(mesh: Mesh) -> Cost:
    """The cost of `condense`; of the loads only their number counts, and no matrix is made."""
    return _cost(dissected(mesh.unknowns, mesh.coordinates, mesh.kept), mesh)


def _cost(order: Order, mesh: Mesh, remembers: bool = False) -> Cost:
    elements, unknowns = mesh.unknowns.shape
    return of_elimination(order, (elements, unknowns), mesh.loads.shape[1], AT_ONCE, remembers)


@dataclass(frozen=True, slots=True)
class _Remembered:
    """First of the unknowns that were eliminated together, their factor, and what couples them to the `rest`.

    Loads are among the rest, as unknowns behind all others.
    """

    first: int
    rest: Indices
    factor: Array
    between: Array


class _Elimination:
    """Elimination of a mesh in an order.

    Loads are rows of the matrix behind those of all unknowns: what is left of them there are the loads on the kept
    unknowns and, negative, the work.
    """

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
        self._behind = len(mesh.kept) + np.array([[0, mesh.loads.shape[1]]])
        self._made: tuple[int, Sequence[Array] | Array] = (-AT_ONCE, ())

    def run(self) -> tuple[Array, Array, Array]:
        """Matrix (lower triangle) and loads of the kept unknowns, in the order of elimination, and work (the same)."""
        passed: list[tuple[Indices, Array]] = []
        for front in self._order.fronts:
            go_on()
            runs = np.concatenate([front.rest, self._behind])
            added = Assembled(front, runs)
            if front.halves:
                for half in passed[-len(front.halves) :]:
                    added.add(*half)
                del passed[-len(front.halves) :]
            else:
                for place in range(front.start, front.stop):
                    added.add_numbers(*self._element(place))
            below = len(added.between) - self._loads.shape[1]
            added.between[below:] += self._loads[front.first : front.first + front.count].T
            passed.append((runs, self._eliminate(front.first, numbers(runs), added.own, added.between, added.rest)))
        _, matrix = passed.pop()
        kept = len(matrix) - self._loads.shape[1]
        return (
            matrix[:kept, :kept],
            self._loads[len(self._loads) - kept :] + matrix[kept:, :kept].T,
            -matrix[kept:, kept:],
        )

    def _element(self, place: int) -> tuple[Indices, Array]:
        """Unknowns that an element shares, and their matrix (lower triangle).

        Args:
            place: its place in the order of elimination.
        """
        free = slice(self._fixed[place], None)
        ranks, columns = self._ranked[place, free], self._sequence[place, free]
        rows = self._matrix(place)[columns]
        steps = np.diff(ranks)
        if not steps.all():
            # An unknown that moves several places of one element stands there several times.
            begins = np.flatnonzero(np.append(1, steps))
            again = np.flatnonzero(steps == 0) + 1
            for first, place in zip(begins[np.searchsorted(begins, again) - 1].tolist(), again.tolist(), strict=True):
                rows[first] += rows[place]
                rows[:, columns[first]] += rows[:, columns[place]]
            rows, ranks, columns = rows[begins], ranks[begins], columns[begins]
        count = int(np.searchsorted(ranks, self._order.inside))
        others = ranks[count:]
        # Transposed, the parts of the upper triangle are those of the lower one, as LAPACK wants them.
        own, between, rest = (
            of.take(at, axis=1, mode="clip").T
            for of, at in (
                (rows[:count], columns[:count]),
                (rows[:count], columns[count:]),
                (rows[count:], columns[count:]),
            )
        )
        if not count:
            return others, rest
        loads = self._loads[ranks[0] : ranks[0] + count]
        if loads.any():
            others, between = np.concatenate([others, numbers(self._behind)]), np.concatenate([between, loads.T])
            whole = np.zeros((len(others), len(others)), order="F")
            whole[: len(rest), : len(rest)] = rest
            rest = whole
        return others, self._eliminate(int(ranks[0]), others, own, between, rest)

    def _matrix(self, place: int) -> Array:
        """Matrix of an element."""
        first, matrices = self._made
        if not first <= place < first + AT_ONCE:
            first = place - place % AT_ONCE
            matrices = self._mesh.matrices(self._order.elements[first : first + AT_ONCE])
            self._made = first, matrices
        found: Array = matrices[place - first]
        return found

    def _eliminate(self, first: int, others: Indices, own: Array, between: Array, rest: Array) -> Array:
        """Matrix of the rest without the eliminated unknowns.

        Args:
            first: first of the unknowns that are eliminated.
            others: unknowns of the rest.
            own, between, rest: matrices of the eliminated ones, of the rest with them, and of the rest, which are
                overwritten. Only lower triangles of the first and the last count.
        """
        if not len(own):
            return rest
        factor = factorised(own)
        if factor is None:
            raise EstimateError(
                "finite elements: the stiffness of a part is not positive definite to working precision; bring moduli"
                " and dimensions closer together"
            )
        if len(between):
            between = solved(factor, between)
            rest = less_square(rest, between)
        if self._remembers:
            self._remembered.append(_Remembered(first, others, factor, between))
        return rest

    def inside(self, kept: Array, factors: Array) -> Array:
        """Displacements of all unknowns, as in `Condensed`."""
        rank, held = self._order.rank, self._mesh.kept
        moved = np.append(np.empty(len(rank)), -factors)
        moved[rank[held]] = kept
        for each in reversed(self._remembered):
            pull = -each.between.T @ moved[each.rest]
            found = dtrsm(1.0, each.factor, pull[:, None], lower=1, trans_a=1)
            moved[each.first : each.first + len(found)] = found[:, 0]
        return moved[rank]
