"""The quickest way to a tolerance in all: what is calibrated before the run, and the run itself.

    films = Preparation("films' calibration", u=0.03, fixed=90, each=3.1)
    prepare([Way(lines, costs)], 0.05, [films]).numbers           # {"films' calibration": 12}

A preparation has x units, such as points of a calibration or references. They take fixed + each x seconds and leave the
variance u²/x + rest² in place of the line of its name. With it a run takes start + mounting k + set N + D seconds, and
has the variance m/k + s/N + d/D + Σ u²/x + floor. For a given k this is convex in the real numbers N, D and x, and each
gets a share of the variance in proportion to √(variance of one unit · its seconds). The least time is convex in k, too,
so that the best k is found by halving. Whole numbers are searched around it. Whether a preparation is made at all, and
which way a run goes (its load, its frequency), is tried out: there are few of either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from palpate.instrument.allocation.allocate import LONGEST, MOST_STEPS, SHORTEST, BelowFloor
from palpate.instrument.allocation.lines import Costs, Line, Unit
from palpate.instrument.errors import RangeError

NEAR, STEPS = (-1, 0, 1, 2), (-5, -2, -1, 1, 2, 5)  # of units, by which whole numbers are searched


@dataclass(frozen=True, slots=True)
class Preparation:
    """Something that is made once before a run, in units.

    Attributes:
        name: name of the line that it replaces.
        u: relative standard uncertainty of the answer by one unit.
        fixed: bench time that is paid once, whatever the number of units is [s]; below 0: what one has already.
        each: bench time of a unit [s].
        least: least number of units.
        rest: relative standard uncertainty of the answer that no number of units lowers.
    """

    name: str
    u: float
    fixed: float
    each: float
    least: int = 1
    rest: float = 0.0

    def seconds(self, units: int) -> float:
        return self.fixed + self.each * units


@dataclass(frozen=True, slots=True)
class Way:
    """One way of a run, such as its load and frequency: its lines, its costs, and the shortest dwell of a set [s]."""

    lines: Sequence[Line]
    costs: Costs
    shortest: float = SHORTEST


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
    ways: Sequence[Way], tolerance: float, preparations: Sequence[Preparation] = (), fewest: int = 1
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
    best: Prepared | None = None
    for number, way in enumerate(ways):
        for count in range(len(preparations) + 1):
            for made in combinations(preparations, count):
                best = _better(best, _Purchase.of(way, made, tolerance, fewest), number)
    if best is None:
        raise _below(ways[0], preparations, tolerance)
    return best


@dataclass(frozen=True, slots=True)
class _Purchase:
    """Variances of one mounting, one set and one second of dwell, and what is left of the tolerance for all."""

    made: tuple[Preparation, ...]
    costs: Costs
    shortest: float
    fewest: int
    free: float
    mounting: float
    set: float
    second: float

    @classmethod
    def of(cls, way: Way, made: tuple[Preparation, ...], tolerance: float, fewest: int) -> _Purchase:
        names = {each.name for each in made}
        kept = [line for line in way.lines if line.name not in names]
        mounting, each_set, second, floor = (
            math.fsum(line.u**2 for line in kept if line.per is unit)
            for unit in (Unit.MOUNTING, Unit.SET, Unit.SECOND, Unit.NOTHING)
        )
        free = tolerance**2 - floor - math.fsum(each.rest**2 for each in made)
        # The dearest has the fewest units. Its whole number is chosen first, and the others make up for the rounding.
        dearest_first = tuple(sorted(made, key=lambda each: -each.each))
        return cls(dearest_first, way.costs, way.shortest, fewest, free, mounting, each_set, second)

    @property
    def dwells_pay(self) -> bool:
        return self.second * self.costs.set > self.shortest**2 * self.set

    def least_mountings(self) -> int | None:
        """The fewest mountings that leave something of the tolerance; None: none do."""
        if self.free <= 0 or self.mounting / self.free >= LONGEST:
            return None
        return 1 + math.floor(self.mounting / self.free)

    def shares(self, mountings: int) -> tuple[float, list[float]]:
        """Least time with real numbers, and the number of units of each preparation in it."""
        free, sets = self.free - self.mounting / mountings, self.fewest * mountings
        start = self.costs.start + self.costs.mounting * mountings + math.fsum(each.fixed for each in self.made)
        if free <= 0:
            return math.inf, []
        # Each item: variance of one unit, its seconds, the least number of units.
        items = [(each.u**2, each.each, float(each.least)) for each in self.made]
        if self.dwells_pay:
            items += [(self.set, self.costs.set, sets), (self.second, 1.0, self.shortest * sets)]
        else:
            seconds = self.costs.set + self.shortest
            items.append((self.set + self.second / self.shortest, seconds, sets))
        numbers = [least for _, _, least in items]
        open_items = set(range(len(items)))
        while True:  # an item of which the least number is more than its share needs leaves the rest to the others
            left = free - math.fsum(items[i][0] / numbers[i] for i in range(len(items)) if i not in open_items)
            roots = {i: math.sqrt(items[i][0] * items[i][1]) for i in open_items}
            whole = math.fsum(roots.values())
            if not open_items:
                return (start + self._spent(items, numbers) if left >= 0 else math.inf), numbers[: len(self.made)]
            if left <= 0:
                return math.inf, []
            wanted = {i: math.sqrt(items[i][0] / items[i][1]) * whole / left if items[i][1] else LONGEST for i in roots}
            enough = [i for i in open_items if wanted[i] <= items[i][2]]
            if not enough:
                numbers = [wanted.get(i, number) for i, number in enumerate(numbers)]
                return start + self._spent(items, numbers), numbers[: len(self.made)]
            open_items -= set(enough)

    @staticmethod
    def _spent(items: Sequence[tuple[float, float, float]], numbers: Sequence[float]) -> float:
        return math.fsum(seconds * number for (_, seconds, _), number in zip(items, numbers, strict=True))

    def run(self, mountings: int) -> tuple[float, int, float]:
        """Bench time of the quickest run with nothing left to prepare, its sets and their dwell."""
        left = self.free - self.mounting / mountings
        if left <= 0:
            return math.inf, 0, 0.0
        if self.dwells_pay:
            real = (self.set + math.sqrt(self.set * self.second / self.costs.set)) / left if self.costs.set else LONGEST
        else:
            real = (self.set + self.second / self.shortest) / left
        best = (math.inf, 0, 0.0)
        for each in {max(self.fewest, rounded(real / mountings)) for rounded in (math.floor, math.ceil)}:
            sets = each * mountings
            of_noise = left - self.set / sets
            if of_noise < 0 or (of_noise == 0 and self.second):
                continue
            dwell = max(self.shortest, self.second / of_noise / sets) if self.second else self.shortest
            best = min(best, (self.costs.seconds(mountings, sets, dwell), sets, dwell))
        return best

    def units(self, mountings: int, most: float) -> tuple[float, tuple[int, ...]]:
        """Whole numbers of units of the least bench time in all, and that time; infinite: none is below `most`."""
        if not self.made:
            return self.run(mountings)[0], ()
        bound, real = self.shares(mountings)
        if bound >= most:
            return math.inf, ()
        near = {max(self.made[0].least, math.floor(real[0]) + step) for step in NEAR}
        best = min(self._with_first(number, mountings, most) for number in near)
        # Whole sets make the time jump about the best number of the last preparation: it is searched further.
        steps = STEPS if len(self.made) == 1 else ()
        while moved := [
            found
            for by in steps
            if (found := self._with_first(max(self.made[0].least, best[1][0] + by), mountings, most)) < best
        ]:
            best = min(moved)
        return best

    def _with_first(self, number: int, mountings: int, most: float) -> tuple[float, tuple[int, ...]]:
        """As `units`, with so many of the first preparation."""
        before = self.made[0].seconds(number)
        left = replace(self, made=self.made[1:], free=self.free - self.made[0].u ** 2 / number)
        seconds, others = left.units(mountings, most - before)
        return before + seconds, (number, *others)

    def after(self, units: Sequence[int]) -> _Purchase:
        """What is left after the preparations."""
        spent = math.fsum(each.u**2 / number for each, number in zip(self.made, units, strict=True))
        return replace(self, made=(), free=self.free - spent)


def _better(best: Prepared | None, problem: _Purchase, way: int) -> Prepared | None:
    """The best plan of a purchase if it is better than the best one so far."""
    fewest = problem.least_mountings()
    if fewest is None:
        return best

    def bound(mountings: int) -> float:
        return problem.shares(mountings)[0]

    low, high = fewest, 2 * fewest
    while bound(high) < bound(high - 1) and high < LONGEST:
        low, high = high, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if bound(middle + 1) < bound(middle) else (low, middle)
    for walk in (range(low, low + MOST_STEPS), range(low - 1, max(fewest, low - MOST_STEPS) - 1, -1)):
        for mountings in walk:
            if not bound(mountings) < (math.inf if best is None else best.seconds):
                break
            least = LONGEST if best is None else best.seconds
            seconds, units = problem.units(mountings, least)
            if seconds < least:
                run, sets, dwell = problem.after(units).run(mountings)
                numbers = {each.name: number for each, number in zip(problem.made, units, strict=True)}
                best = Prepared(way, numbers, seconds, run, mountings, sets, dwell)
    return best


def _below(way: Way, preparations: Sequence[Preparation], tolerance: float) -> RangeError:
    """Why nothing reaches a tolerance: the largest line of what all preparations leave."""
    rests = {each.name: each.rest for each in preparations}
    left = {line.name: min(line.u, rests.get(line.name, line.u)) for line in way.lines if line.per is Unit.NOTHING}
    if not left or math.hypot(*left.values()) < tolerance:
        return RangeError(f"a relative standard uncertainty of {tolerance:.3g} takes more than three centuries")
    return BelowFloor(tolerance, math.hypot(*left.values()), max(left, key=lambda name: left[name]))
