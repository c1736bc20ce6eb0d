"""What a run and what is calibrated before it take together, for one way of the run and some preparations.

    Purchase.of(0, Way(lines, costs), (films, references), tolerance=0.05, fewest=1).real()

For real numbers the least time is known in closed form: each item gets a share of the variance in proportion to
√(variance of one · its seconds). It is what no plan of whole numbers is below, and near it they are searched.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from palpate.instrument.allocation.allocate import LONGEST, SHORTEST
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit

NEAR, STEPS = (-1, 0, 1, 2), (*range(-5, 0), *range(1, 6))  # of units, by which whole numbers are searched

Numbers = tuple[tuple[str, int], ...]
"""Names of preparations with their numbers of units."""


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
class RunOption:
    """One way of a run, such as its load and frequency: its lines, its costs, and the shortest dwell of a set [s]."""

    lines: Sequence[BudgetLine]
    costs: Costs
    shortest: float = SHORTEST


class _Item(NamedTuple):
    """One of several things whose numbers share a variance: that of one, its seconds, and the least number."""

    variance: float
    seconds: float
    least: float


def _cheapest(free: float, items: Sequence[_Item]) -> tuple[float, list[float]]:
    """Least time of items whose variances add up to what is free; infinite: none is enough. And their real numbers."""
    numbers = [item.least for item in items]
    left, shared = free, list(enumerate(items))
    while shared:  # an item of which the least number is more than its share needs leaves the rest to the others
        if left <= 0:
            return math.inf, numbers
        whole = sum(math.sqrt(item.variance * item.seconds) for _, item in shared) / left
        more = []
        for place, item in shared:
            wanted = math.sqrt(item.variance / item.seconds) * whole if item.seconds else LONGEST
            if wanted > item.least:
                numbers[place] = wanted
                more.append((place, item))
            else:
                numbers[place] = item.least
        if len(more) == len(shared):
            break
        settled = {place for place, _ in shared} - {place for place, _ in more}
        left -= sum(items[place].variance / items[place].least for place in settled)
        shared = more
    if left < 0:
        return math.inf, numbers
    return sum(item.seconds * number for item, number in zip(items, numbers, strict=True)), numbers


class Purchase(NamedTuple):  # a copy with other values is made thousands of times
    """What is left to choose of a way, and what is left of the tolerance for it.

    Attributes:
        way: number of the way.
        made: preparations whose numbers are to be chosen, the dearest first.
        costs, shortest, fewest: of the run.
        free: variance that mountings, sets, dwell and these preparations share.
        mounting, set, second: variances of one of each.
        paid: bench time of the preparations that are chosen already [s].
        chosen: names and numbers of those.
    """

    way: int
    made: tuple[Preparation, ...]
    costs: Costs
    shortest: float
    fewest: int
    free: float
    mounting: float
    set: float
    second: float
    paid: float = 0.0
    chosen: Numbers = ()

    @classmethod
    def of(cls, number: int, way: RunOption, made: tuple[Preparation, ...], tolerance: float, fewest: int) -> Purchase:
        names = {each.name for each in made}
        kept = [line for line in way.lines if line.name not in names]
        mounting, each_set, second, floor = (
            math.fsum(line.u**2 for line in kept if line.per is unit)
            for unit in (RepeatUnit.MOUNTING, RepeatUnit.SET, RepeatUnit.SECOND, RepeatUnit.NOTHING)
        )
        free = tolerance**2 - floor - math.fsum(each.rest**2 for each in made)
        # The dearest has the fewest units. Its whole number is chosen first, and the others make up for the rounding.
        dearest_first = tuple(sorted(made, key=lambda each: -each.each))
        return cls(number, dearest_first, way.costs, way.shortest, fewest, free, mounting, each_set, second)

    @property
    def dear(self) -> bool:
        """Whether a unit of the dearest preparation takes longer than a mounting with a set."""
        return bool(self.made) and self.made[0].each > self.costs.mounting + self.costs.set

    @property
    def dwells_pay(self) -> bool:
        return self.second * self.costs.set > self.shortest**2 * self.set

    def least_mountings(self) -> int:
        """The fewest mountings that leave something of the tolerance, where any do."""
        return 1 + math.floor(self.mounting / self.free)

    def real(self) -> tuple[float, float, float]:
        """The least time with real numbers of all, which no plan is below, and mountings and dearest units in it."""
        if self.free <= 0 or self.mounting / self.free >= LONGEST:
            return math.inf, 0.0, 0.0
        least = self.least_mountings()
        mounted = _Item(self.mounting, self.costs.mounting, least)
        seconds, numbers = _cheapest(self.free, [mounted, *self._items(least)])
        return self._start(0) + seconds, numbers[0], numbers[1]

    def numbers_of_dearest(self) -> tuple[Iterator[int], Iterator[int]]:
        """Numbers of units of the dearest preparation, away from the best real number on both sides."""
        dearest = self.made[0]
        near = max(dearest.least, math.floor(self.real()[2]))
        return iter(range(near, dearest.least - 1, -1)), itertools.count(near + 1)

    def with_dearest(self, number: int) -> Purchase:
        """What is left with so many units of the dearest preparation."""
        dearest = self.made[0]
        return self._replace(
            made=self.made[1:],
            free=self.free - dearest.u**2 / number,
            paid=self.paid + dearest.seconds(number),
            chosen=(*self.chosen, (dearest.name, number)),
        )

    def shares(self, mountings: int) -> tuple[float, list[float]]:
        """Least time with real numbers, and the number of units of each preparation in it."""
        seconds, numbers = _cheapest(self.free - self.mounting / mountings, self._items(mountings))
        return self._start(mountings) + seconds, numbers[: len(self.made)]

    def _start(self, mountings: int) -> float:
        """Bench time that goes with no number of units, sets or seconds."""
        before = self.paid + math.fsum(each.fixed for each in self.made)
        return before + self.costs.start + self.costs.mounting * mountings

    def _items(self, mountings: int) -> list[_Item]:
        """What is to be shared out: units of each preparation, and sets or their dwell."""
        sets = self.fewest * mountings
        items = [_Item(each.u**2, each.each, each.least) for each in self.made]
        if self.dwells_pay:
            return [*items, _Item(self.set, self.costs.set, sets), _Item(self.second, 1.0, self.shortest * sets)]
        return [*items, _Item(self.set + self.second / self.shortest, self.costs.set + self.shortest, sets)]

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

    def units(self, mountings: int, most: float) -> tuple[float, Numbers]:
        """Least bench time in all, and numbers of the preparations in it; infinite: none is below `most`."""
        if not self.made:
            return self.paid + self.run(mountings)[0], self.chosen
        bound, real = self.shares(mountings)
        best: tuple[float, Numbers] = (math.inf, ())
        if bound >= most:
            return best
        least = self.made[0].least
        for number in sorted({max(least, math.floor(real[0]) + step) for step in NEAR}):
            best = min(best, self._with_dearest(number, mountings, min(most, best[0])))
        # Whole sets make the time jump about the best number of the last preparation: it is searched further.
        while best[1] and len(self.made) == 1:
            now = best[1][-1][1]
            others = {max(least, now + step) for step in STEPS} - {now}
            moved = min(self._with_dearest(number, mountings, min(most, best[0])) for number in others)
            if moved >= best:
                break
            best = moved
        return best

    def _with_dearest(self, number: int, mountings: int, most: float) -> tuple[float, Numbers]:
        """As `units`, with so many of the dearest preparation."""
        run = self.costs.seconds(mountings, self.fewest * mountings, self.shortest)
        if self.paid + self.made[0].seconds(number) + run >= most:
            return math.inf, ()
        return self.with_dearest(number).units(mountings, most)
