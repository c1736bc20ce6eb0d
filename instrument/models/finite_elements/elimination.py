"""Elimination of the unknowns of a sum of element matrices by dense fronts.

    condense(mesh).stiffness       # against the unknowns that are kept

Unknowns inside one element are eliminated from its own matrix. Then, from the smallest fronts upwards, each adds those
of its two halves, eliminates what no element outside knows (Cholesky), and passes on the rest (multifrontal method:
Duff and Reid 1983). So all work is dense and no sparse matrix is assembled. Nothing has to be kept for later: loads are
eliminated along with the matrix.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from ctypes import POINTER, c_char_p, c_double, c_int, c_void_p
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cython_blas, cython_lapack
from scipy.linalg.blas import dtrsm

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.work import Cost, go_on, require_memory

# --- the order: nested dissection ------------------------------------------------------------------------

# Unknowns that belong to one element alone come first. Elements are halved again and again, at the coordinate where the
# two halves have the least to pass on. Unknowns that belong to the same elements are treated as one group.


# Least share of the elements in a half. Of shares from 0.05 to 0.4, with the eliminated part counted once to four times
# in the price of a cut, this one and twice leave `single` and `common_base` with the fewest multiplications.
EDGE = 0.25
# Unknowns of elements that are eliminated together, besides those inside each; smaller fronts cost more calls than they
# save work.
LEAF = 1000


@dataclass(frozen=True, slots=True)
class Front:
    """Unknowns that are eliminated together, with those on which they act.

    Attributes:
        start, stop: elements of this front and of all below it, as places in the order of elimination.
        halves: places of the two fronts below; none: its elements are added directly.
        first, count: first of the unknowns that are eliminated, and their number; in the new order.
        rest: runs (runs, 2) of the unknowns on which these act, from the first one to the one after the last.
    """

    start: int
    stop: int
    halves: tuple[int, ...]
    first: int
    count: int
    rest: Indices

    @property
    def passed(self) -> int:
        """Number of unknowns that are passed on."""
        return int((self.rest[:, 1] - self.rest[:, 0]).sum())

    @property
    def size(self) -> int:
        """Number of all unknowns of the front."""
        return self.count + self.passed


@dataclass(frozen=True, slots=True)
class EliminationOrder:
    """Order of elimination.

    Attributes:
        elements: elements in the order of elimination.
        rank: (unknowns,), new numbers of the unknowns; those that are kept come last.
        inside: number of unknowns inside elements, which come first, one element after the other.
        fronts: the fronts, halves before their sums.
    """

    elements: Indices
    rank: Indices
    inside: int
    fronts: list[Front]

    @property
    def eliminated(self) -> int:
        """Number of all unknowns that are eliminated."""
        return self.inside + sum(front.count for front in self.fronts)

    @property
    def operations(self) -> float:
        """Multiplications of the elimination."""
        return sum(f.count**3 / 6 + f.count**2 * f.passed / 2 + f.count * f.passed**2 / 2 for f in self.fronts)

    @property
    def entries(self) -> int:
        """Greatest number of matrix entries that exist at once."""
        passed: list[int] = []
        most = 0
        for front in self.fronts:
            most = max(most, sum(passed) + front.size**2)
            if front.halves:
                del passed[-len(front.halves) :]
            passed.append(front.passed**2)
        return most


def numbers(runs: Indices) -> Indices:
    """The unknowns of runs."""
    return np.concatenate([np.arange(low, high) for low, high in runs] or [np.empty(0, dtype=np.intp)])


def dissected(unknowns: Indices, coordinates: Floats, kept: NDArray[np.bool_]) -> EliminationOrder:
    """Order of elimination of all unknowns that are not kept.

    Args:
        unknowns: (elements, n), numbers of each element's unknowns; -1 for those that are fixed.
        coordinates: (elements, m), coordinates along which elements may be parted.
        kept: (size,), whether an unknown is kept.
    """
    groups = _Groups(unknowns, kept)
    elements, nodes = _halved(groups, coordinates)
    return _numbered(groups, elements, nodes)


class _Groups:
    """Unknowns by the elements to which they belong.

    Attributes:
        of_unknown: (size,), group of each unknown.
        sizes, kept: (groups,), number of unknowns, and whether they are kept.
        elements: (groups,), number of elements that have them.
        inside: (groups,), whether they belong to one element alone and are not kept.
        shared: (groups,), number of unknowns, 0 for those inside an element.
        starts, members: groups of each element: `members[starts[k]:starts[k + 1]]`.
    """

    def __init__(self, unknowns: Indices, kept: NDArray[np.bool_]) -> None:
        rng = np.random.default_rng(0)
        marks = np.zeros(len(kept) + 1, dtype=np.uint64)
        own = rng.integers(1, 2**63, len(unknowns), dtype=np.uint64)
        np.add.at(marks, unknowns.ravel(), own.repeat(unknowns.shape[1]))
        marks[:-1][kept] ^= np.uint64(2**63)
        _, self.of_unknown, self.sizes = np.unique(marks[:-1], return_inverse=True, return_counts=True)
        count = len(self.sizes)
        self.kept = np.zeros(count, dtype=bool)
        self.kept[self.of_unknown[kept]] = True
        rows = np.sort(np.where(unknowns >= 0, self.of_unknown[unknowns], -1), axis=1)
        new = np.diff(rows, axis=1, prepend=-1) > 0
        self.members = rows[new]
        self.starts = np.concatenate([[0], np.cumsum(np.count_nonzero(new, axis=1))])
        self.elements = np.bincount(self.members, minlength=count)
        self.inside = (self.elements == 1) & ~self.kept
        self.shared = np.where(self.inside, 0, self.sizes)

    def of(self, elements: Indices) -> tuple[Indices, Indices]:
        """Groups of some elements, and the place of the element that each belongs to."""
        counts = self.starts[elements + 1] - self.starts[elements]
        places = np.repeat(np.arange(len(elements)), counts)
        before = np.concatenate([[0], np.cumsum(counts)])[:-1]
        return self.members[np.arange(len(places)) + (self.starts[elements] - before)[places]], places


def _halved(groups: _Groups, coordinates: Floats) -> tuple[Indices, list[tuple[int, int, tuple[int, ...]]]]:
    """Elements in the order of elimination; start, stop and halves of each node of the tree.

    Args:
        groups: the unknowns.
        coordinates: as in `dissected`.
    """
    order: list[Indices] = []
    few = max(2, int(LEAF * len(coordinates) / max(1, groups.shared[groups.members].sum())))
    nodes: list[tuple[int, int, tuple[int, ...]]] = []

    def node(of: Indices, start: int) -> int:
        halves: tuple[int, ...] = ()
        if len(of) > few:
            one, other = _cut(groups, coordinates, of)
            halves = (node(one, start), node(other, start + len(one)))
        else:
            order.append(of)
        nodes.append((start, start + len(of), halves))
        return len(nodes) - 1

    node(np.arange(len(coordinates)), 0)
    return np.concatenate(order), nodes


def _cut(groups: _Groups, coordinates: Floats, of: Indices) -> tuple[Indices, Indices]:
    """Two halves of some elements."""
    members, places = groups.of(of)
    by_group = np.argsort(members, kind="stable")
    members, places = members[by_group], places[by_group]
    begins = np.flatnonzero(np.diff(members, prepend=-1))
    present = members[begins]
    inside = np.diff(np.append(begins, len(members)))
    sizes = groups.shared[present].astype(np.float64)
    outside = (inside < groups.elements[present]) | groups.kept[present]
    count = len(of)
    margin = max(1, int(EDGE * count))
    best, least = None, np.inf
    for values in coordinates[of].T:
        sequence = np.argsort(values, kind="stable")
        apart = np.diff(values[sequence]) > 1e-9 * np.ptp(values)
        cuts = np.flatnonzero(apart) + 1
        middling = cuts[(cuts >= margin) & (cuts <= count - margin)]
        if not len(middling):
            middling = cuts
        if not len(middling):
            continue
        rank = np.empty(count, dtype=np.intp)
        rank[sequence] = np.arange(count)
        at = rank[places]
        low, high = np.minimum.reduceat(at, begins) + 1, np.maximum.reduceat(at, begins) + 1

        def up_to(of_groups: NDArray[np.bool_], ends: Indices) -> Floats:
            return np.bincount(ends[of_groups], sizes[of_groups], count + 1)[: count + 1].cumsum()

        between = up_to(~outside, low) - up_to(~outside, high)
        far = up_to(outside, high)
        one, other = up_to(outside, low) + between, far[-1] - far + between
        whole = far[-1] + between
        price = (one**3 + other**3 + 2 * whole**2 * between)[middling]
        found = int(np.argmin(price))
        if price[found] < least:
            least = price[found]
            best = sequence[: middling[found]], sequence[middling[found] :]
    if best is None:
        return of[: count // 2], of[count // 2 :]
    return of[best[0]], of[best[1]]


def _numbered(groups: _Groups, elements: Indices, nodes: list[tuple[int, int, tuple[int, ...]]]) -> EliminationOrder:
    """New numbers rise with the front that eliminates, then with the first element: so neighbours stay together."""
    count = len(groups.sizes)
    members, places = groups.of(elements)
    first, last = np.full(count, len(elements)), np.full(count, -1)
    np.minimum.at(first, members, places)
    np.maximum.at(last, members, places)
    last[groups.kept] = len(elements)
    stage = np.where(groups.inside, -1, len(nodes))
    passes: list[Indices] = []
    begins = np.concatenate([[0], np.cumsum(np.bincount(places, minlength=len(elements)))])
    for number, (start, stop, halves) in enumerate(nodes):
        parts = [passes[half] for half in halves] if halves else [members[begins[start] : begins[stop]]]
        own = np.unique(np.concatenate(parts))
        own = own if halves else own[~groups.inside[own]]
        inside = (last[own] < stop) & (first[own] >= start)
        stage[own[inside]] = number
        passes.append(own[~inside])
    order = np.lexsort((first, stage))
    offsets = np.empty(count + 1, dtype=np.intp)
    offsets[order] = np.concatenate([[0], np.cumsum(groups.sizes[order])[:-1]])
    offsets[-1] = groups.sizes.sum()
    # Unknowns of a group follow one another in the order of their own numbers.
    by_group = np.argsort(groups.of_unknown, kind="stable")
    within = np.arange(len(by_group)) - np.repeat(np.cumsum(groups.sizes) - groups.sizes, groups.sizes)
    rank = np.empty(len(by_group), dtype=np.intp)
    rank[by_group] = offsets[groups.of_unknown[by_group]] + within
    inside, *eliminated = np.bincount(stage + 1, groups.sizes, len(nodes) + 2).astype(np.intp).tolist()
    starts = np.cumsum([inside, *eliminated])
    fronts = []
    for number, (start, stop, halves) in enumerate(nodes):
        rest = passes[number][np.argsort(offsets[passes[number]])]
        low, high = offsets[rest], offsets[rest] + groups.sizes[rest]
        breaks = np.flatnonzero(low[1:] != high[:-1]) + 1
        ends = np.append(breaks, len(rest)) if len(rest) else breaks
        runs = np.stack([low[np.append(0, breaks)[: len(ends)]], high[ends - 1]], axis=1)
        fronts.append(Front(start, stop, halves, int(starts[number]), eliminated[number], runs))
    return EliminationOrder(elements, rank, inside, fronts)


# --- dense algebra during which other threads of Python go on --------------------------------------------

# scipy's own functions keep Python's lock: with a matrix of 8000 unknowns nobody can interrupt one for half a minute.
# These call the same routines of the same library, so that no digit differs. Matrices should be in Fortran's order;
# others are copied.

_TEXT, _COUNT, _NUMBER, _MATRIX = c_char_p, POINTER(c_int), POINTER(c_double), c_void_p


def _routine(module: Any, name: str, *types: Any) -> Any:
    """A routine of the library with which scipy computes (scipy.linalg.cython_blas tells where it is)."""
    name_of, pointer_of = ctypes.pythonapi.PyCapsule_GetName, ctypes.pythonapi.PyCapsule_GetPointer
    name_of.restype, name_of.argtypes = c_char_p, [ctypes.py_object]
    pointer_of.restype, pointer_of.argtypes = c_void_p, [ctypes.py_object, c_char_p]
    capsule = module.__pyx_capi__[name]
    return ctypes.CFUNCTYPE(None, *types)(pointer_of(capsule, name_of(capsule)))


_DPOTRF = _routine(cython_lapack, "dpotrf", _TEXT, _COUNT, _MATRIX, _COUNT, _COUNT)
_DTRSM = _routine(
    cython_blas, "dtrsm", _TEXT, _TEXT, _TEXT, _TEXT, _COUNT, _COUNT, _NUMBER, _MATRIX, _COUNT, _MATRIX, _COUNT
)
_DSYRK = _routine(
    cython_blas, "dsyrk", _TEXT, _TEXT, _COUNT, _COUNT, _NUMBER, _MATRIX, _COUNT, _NUMBER, _MATRIX, _COUNT
)


def factorised(matrix: Floats) -> Floats | None:
    """Cholesky factor, in the lower triangle, of a symmetric matrix (n, n), of which only the lower triangle counts.

    The matrix is overwritten. None: it is not positive definite to working precision.
    """
    found, failed = np.asfortranarray(matrix), c_int(0)
    if len(found):
        size = c_int(len(found))
        _DPOTRF(b"L", size, found.ctypes.data, size, failed)
    return None if failed.value else found


def solved(factor: Floats, columns: Floats) -> Floats:
    """X (m, n) of X Lᵀ = B, with L in the lower triangle of a factor (n, n); B (m, n) is overwritten."""
    found = np.asfortranarray(columns)
    rows, count = map(c_int, found.shape)
    if found.size:
        _DTRSM(b"R", b"L", b"T", b"N", rows, count, c_double(1.0), factor.ctypes.data, count, found.ctypes.data, rows)
    return found


def less_square(matrix: Floats, of: Floats) -> Floats:
    """A - B Bᵀ in the lower triangle of A (m, m), which is overwritten; B is (m, n)."""
    found, of = np.asfortranarray(matrix), np.asfortranarray(of)
    rows, count = map(c_int, of.shape)
    if of.size:
        places = of.ctypes.data, rows, c_double(1.0), found.ctypes.data, rows
        _DSYRK(b"L", b"N", rows, count, c_double(-1.0), *places)
    return found


# --- sums of the matrices that elements or smaller fronts pass on to a front -----------------------------

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

    def add(self, runs: Indices, matrix: Floats) -> None:
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

    def add_numbers(self, own: Indices, matrix: Floats) -> None:
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

    def _block(self, row: int, column: int) -> Floats:
        count = self._count
        if column >= count:
            return self.rest[row - count :, column - count :]
        return self.own[row:, column:] if row < count else self.between[row - count :, column:]


# --- the elimination by fronts ---------------------------------------------------------------------------

# What else takes time, in the time of so many multiplications [M]: to make one entry of an element's matrix and add it;
# and all that is done with one of the matrix that is left.
OF_ELEMENT, OF_LEFT = 45, 330
# Matrices of the kept unknowns that exist at once while their poles are found.
COPIES = 10
# Elements whose matrices are made at once: fewer cost more calls, more cost memory.
AT_ONCE = 16
BLOCK = 256  # rows


@dataclass(frozen=True, slots=True)
class ElementSystem:
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
    coordinates: Floats
    matrices: Callable[[Indices], Sequence[Floats] | Floats]
    kept: NDArray[np.bool_]
    loads: Floats


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

    stiffness: Floats
    loads: Floats
    work: Floats
    inside: Callable[[Floats, Floats], Floats] | None = None


def condense(mesh: ElementSystem, remembers: bool = False) -> Condensed:
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


def _mirror(matrix: Floats) -> None:
    """Fill the upper triangle of a symmetric matrix from its lower one, in place and by blocks that the cache holds."""
    for row in range(0, len(matrix), BLOCK):
        rows = slice(row, row + BLOCK)
        for column in range(0, row, BLOCK):
            columns = slice(column, column + BLOCK)
            matrix[columns, rows] = matrix[rows, columns].T
        own = matrix[rows, rows]
        own[:] = np.tril(own) + np.tril(own, -1).T


def cost_of(mesh: ElementSystem) -> Cost:
    """The cost of `condense`; of the loads only their number counts, and no matrix is made."""
    return _cost(dissected(mesh.unknowns, mesh.coordinates, mesh.kept), mesh)


def _cost(order: EliminationOrder, mesh: ElementSystem, remembers: bool = False) -> Cost:
    """The cost of an elimination by its order; `remembers`: the factors are kept."""
    count, size = mesh.unknowns.shape
    own = order.inside / count  # unknowns inside an element, on average
    rest = size - own
    unknowns = len(order.rank)
    kept = unknowns - order.eliminated
    operations = order.operations + count * (own**3 / 6 + own**2 * rest / 2 + own * rest**2 / 2)
    entries = order.entries + 2 * unknowns * mesh.loads.shape[1] + min(AT_ONCE, count) * size**2 + COPIES * kept**2
    if remembers:
        entries += sum(front.count * front.size for front in order.fronts)
    return Cost(operations + OF_ELEMENT * count * size**2 + OF_LEFT * kept**2, entries, unknowns)


@dataclass(frozen=True, slots=True)
class _Remembered:
    """First of the unknowns that were eliminated together, their factor, and what couples them to the `rest`.

    Loads are among the rest, as unknowns behind all others.
    """

    first: int
    rest: Indices
    factor: Floats
    between: Floats


class _Elimination:
    """Elimination of a mesh in an order.

    Loads are rows of the matrix behind those of all unknowns: what is left of them there are the loads on the kept
    unknowns and, negative, the work.
    """

    def __init__(self, mesh: ElementSystem, order: EliminationOrder, remembers: bool) -> None:
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
        self._made: tuple[int, Sequence[Floats] | Floats] = (-AT_ONCE, ())

    def run(self) -> tuple[Floats, Floats, Floats]:
        """Matrix (lower triangle) and loads of the kept unknowns, in the order of elimination, and work (the same)."""
        passed: list[tuple[Indices, Floats]] = []
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

    def _element(self, place: int) -> tuple[Indices, Floats]:
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

    def _matrix(self, place: int) -> Floats:
        """Matrix of an element."""
        first, matrices = self._made
        if not first <= place < first + AT_ONCE:
            first = place - place % AT_ONCE
            matrices = self._mesh.matrices(self._order.elements[first : first + AT_ONCE])
            self._made = first, matrices
        found: Floats = matrices[place - first]
        return found

    def _eliminate(self, first: int, others: Indices, own: Floats, between: Floats, rest: Floats) -> Floats:
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

    def inside(self, kept: Floats, factors: Floats) -> Floats:
        """Displacements of all unknowns, as in `Condensed`."""
        rank, held = self._order.rank, self._mesh.kept
        moved = np.append(np.empty(len(rank)), -factors)
        moved[rank[held]] = kept
        for each in reversed(self._remembered):
            pull = -each.between.T @ moved[each.rest]
            found = dtrsm(1.0, each.factor, pull[:, None], lower=1, trans_a=1)
            moved[each.first : each.first + len(found)] = found[:, 0]
        return moved[rank]


# --- bodies that keep their volume -----------------------------------------------------------------------

#     extrapolated(lambda added: condense(mesh_at(compliance + added)), step)
#
# Pressures are eliminated inside each element, which takes a compliance 1/λ above 0. What is condensed is a smooth
# function of that compliance. So it is found at several somewhat greater ones, and extrapolated to the true one.

Number = TypeVar("Number", float, Floats)

# Multiples of the step, and Lagrange's weights at 0.
NODES = ((1.0, 4.0), (2.0, -6.0), (3.0, 4.0), (4.0, -1.0))


def extrapolated(condensed: Callable[[float], Condensed], step: float) -> Condensed:
    """What is left of a mesh at the true compliance 1/λ.

    Args:
        condensed: what is left when this much is added to the compliance, in any unit.
        step: least addition that the elements bear, in that unit.
    """
    found = [(weight, condensed(node * step)) for node, weight in NODES]
    weights = np.array([weight for weight, _ in found])

    def at_true(part: str) -> Floats:
        values: Floats = np.tensordot(weights, [getattr(each, part) for _, each in found], axes=1)
        return values

    return Condensed(
        stiffness=at_true("stiffness"),
        loads=at_true("loads"),
        work=at_true("work"),
    )


def extrapolated_number(value: Callable[[float], Number], step: float) -> Number:
    """Numbers at the true compliance that make sense beside `extrapolated` matrices alone, as their differences do.

    Args:
        value: the numbers when this much is added to the compliance, in any unit.
        step: as in `extrapolated`.
    """
    one, two, three, four = (weight * value(node * step) for node, weight in NODES)
    return one + two + three + four
