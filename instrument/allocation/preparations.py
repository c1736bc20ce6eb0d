"""The quickest way to a tolerance in all: what is calibrated before the run, and the run itself.

    films = Preparation("films' calibration", u=0.03, fixed=90, each=3.1)
    prepare([Way(lines, costs)], 0.05, [films]).numbers           # {"films' calibration": 12}

A preparation has x units, such as points of a calibration or references. They take fixed + each x seconds and leave the
variance u²/x + rest² in place of the line of its name. With it a run takes start + mounting k + set N + D seconds, and
has the variance m/k + s/N + d/D + Σ u²/x + floor. With real numbers the least time is known (purchase.py), and no plan
is below it. Ways of a run (its load, its frequency), preparations that are made or not, and numbers of those of which a
unit takes longer than a mounting are looked at in the order of that time, until it is above that of the best plan so
far. Mountings and the other numbers are searched around the real ones.
"""

from __future__ import annotations

import functools
import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

from palpate.instrument.allocation.allocate import LONGEST, MOST_STEPS, BelowFloor
from palpate.instrument.allocation.lines import RepeatUnit
from palpate.instrument.allocation.purchase import Preparation, Purchase, RunOption
from palpate.instrument.errors import RangeError


@dataclass(frozen=True, slots=True)
class Prepared:
    """What is made before a run, and the run.

    Attributes:
        way: number of the way that it goes.
        numbers: units of each preparation that is made, by its name.
        seconds: bench time in all, of preparations and run.
        run_seconds: that of the run alone.
        mountings, sets, dwell: as in `Allocation`.
    """

    way: int
    numbers: dict[str, int]
    seconds: float
    run_seconds: float
    mountings: int
    sets: int
    dwell: float


def prepare(
    ways: Sequence[RunOption], tolerance: float, preparations: Sequence[Preparation] = (), fewest: int = 1
) -> Prepared:
    """The least bench time in all to a relative standard uncertainty.

    Args:
        ways: ways among which the run may choose.
        tolerance: relative standard uncertainty.
        preparations: those that may be made; a line of such a name counts as it is where its preparation is not made.
        fewest: least number of sets in each mounting.

    Raises:
        BelowFloor: no preparation and no time reach the tolerance.
    """
    branches = _Branches()
    for number, way in enumerate(ways):
        for count in range(len(preparations) + 1):
            for made in combinations(preparations, count):
                branches.add(iter([Purchase.of(number, way, made, tolerance, fewest)]))
    best: Prepared | None = None
    while purchase := branches.next(LONGEST if best is None else best.seconds):
        if purchase.dear:
            for numbers in purchase.numbers_of_dearest():
                branches.add(map(purchase.with_dearest, numbers))
        else:
            best = _better(best, purchase)
    if best is None:
        raise _below(ways[0], preparations, tolerance)
    return best


class _Branches:
    """Purchases in the order of the time that they take at least."""

    def __init__(self) -> None:
        self._queue: list[tuple[float, int, Purchase, Iterator[Purchase]]] = []
        self._order = itertools.count()  # of purchases that take as long

    def add(self, purchases: Iterator[Purchase]) -> None:
        """Purchases of which each takes longer at least than the one before: it is looked at after that one."""
        if first := next(purchases, None):
            heapq.heappush(self._queue, (first.real()[0], next(self._order), first, purchases))

    def next(self, most: float) -> Purchase | None:
        """The purchase that may take the least time, and less than `most`."""
        if not self._queue or not self._queue[0][0] < most:
            return None
        _, _, purchase, others = heapq.heappop(self._queue)
        self.add(others)
        return purchase


def _better(best: Prepared | None, problem: Purchase) -> Prepared | None:
    """The best plan of a purchase if it is better than the best one so far."""
    low = fewest = problem.least_mountings()
    high = max(low + 1, math.ceil(problem.real()[1])) if problem.mounting else low

    @functools.cache
    def bound(mountings: int) -> float:
        return problem.shares(mountings)[0]

    while low < high < LONGEST and bound(high) < bound(high - 1):
        low, high = high, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if bound(middle + 1) < bound(middle) else (low, middle)
    steps = MOST_STEPS if problem.mounting else 1  # where mountings do not scatter, one is enough
    for walk in (range(low, low + steps), range(low - 1, max(fewest, low - MOST_STEPS) - 1, -1)):
        for mountings in walk:
            least = LONGEST if best is None else best.seconds
            if not bound(mountings) < least:
                break
            seconds, chosen = problem.units(mountings, least)
            if seconds < least:
                whole = problem
                for _, number in chosen[len(problem.chosen) :]:
                    whole = whole.with_dearest(number)
                run, sets, dwell = whole.run(mountings)
                best = Prepared(problem.way, dict(chosen), seconds, run, mountings, sets, dwell)
    return best


def _below(way: RunOption, preparations: Sequence[Preparation], tolerance: float) -> RangeError:
    """Why nothing reaches a tolerance: the largest line of what all preparations leave."""
    rests = {each.name: each.rest for each in preparations}
    left = {
        line.name: min(line.u, rests.get(line.name, line.u)) for line in way.lines if line.per is RepeatUnit.NOTHING
    }
    if not left or math.hypot(*left.values()) < tolerance:
        return RangeError(f"a relative standard uncertainty of {tolerance:.3g} takes more than three centuries")
    return BelowFloor(tolerance, math.hypot(*left.values()), max(left, key=lambda name: left[name]))
