"""Order in which the unknowns of elements are eliminated: nested dissection.

Unknowns that belong to one element alone come first. Elements are halved again and again, at the coordinate where the
two halves have the least to pass on. Unknowns that belong to the same elements are treated as one group.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

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
class Order:
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


def dissected(unknowns: Indices, coordinates: Array, kept: NDArray[np.bool_]) -> Order:
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


def _halved(groups: _Groups, coordinates: Array) -> tuple[Indices, list[tuple[int, int, tuple[int, ...]]]]:
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


def _cut(groups: _Groups, coordinates: Array, of: Indices) -> tuple[Indices, Indices]:
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

        def up_to(of_groups: NDArray[np.bool_], ends: Indices) -> Array:
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


def _numbered(groups: _Groups, elements: Indices, nodes: list[tuple[int, int, tuple[int, ...]]]) -> Order:
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
    return Order(elements, rank, inside, fronts)
