"""The quickest way to a tolerance in all: what is calibrated before the run, and the run itself.

    films = Preparation("films' calibration", u=0.03, fixed=90, each=3.1)
    prepared(table, 0.05, [films]).numbers           # {"films' calibration": 12}

A preparation has units, such as points of a calibration or references. Those worth making are found by themselves: no
other ones are as quick and leave as small a variance. Each is combined with the plans of the run that no other beats.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, RepeatUnit, half_widths
from palpate.instrument.allocation.table import ROUNDING, Allocation, Table, allocation, freedom_of_sets, known_freedom

STEP, MOST = 1.1, 500  # ratio of neighbouring numbers of units, and the most of them
RUNS_STEP = 1.15  # ratio of neighbouring numbers of mountings


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
        freedom: degrees of freedom of what is left.
    """

    name: str
    u: float
    fixed: float
    each: float
    least: int = 1
    rest: float = 0.0
    freedom: float = math.inf

    def seconds(self, units: int) -> float:
        """Bench time of so many units [s]."""
        return self.fixed + self.each * units

    def line(self, units: int) -> BudgetLine:
        """What so many units leave."""
        left = math.hypot(self.u / math.sqrt(units), self.rest)
        return BudgetLine(self.name, left, RepeatUnit.NOTHING, self.freedom)

    @property
    def choices(self) -> list[int]:
        """Numbers of units among which a plan chooses."""
        steps = self.least * STEP ** np.arange(math.log(max(1.0, MOST / self.least)) / math.log(STEP) + 1)
        return sorted({math.ceil(step) for step in steps})


@dataclass(frozen=True, slots=True)
class Prepared:
    """What is made before a run, and the run.

    Attributes:
        numbers: units of each preparation that is made, by its name.
        once: bench time of the preparations [s].
        run: the plan of the run then; its `mean` is the bench time on average.
    """

    numbers: dict[str, int]
    once: float
    run: Allocation


def prepared(table: Table, tolerance: float, preparations: Sequence[Preparation]) -> Prepared | None:
    """The least bench time in all to a tolerance, a half-width of the 95 % interval; None: nothing reaches it.

    Args:
        table: plans of the run.
        tolerance: half-width of the 95 % interval.
        preparations: those that may be made; a line of such a name counts as it is where its preparation is not made.
    """
    way = table.ways[Counter(table.way[table.front_rows()].tolist()).most_common(1)[0][0]]
    some = np.isin(table.mountings, np.ceil(RUNS_STEP ** np.arange(40))) & (table.each % 2 == 0)
    rows = np.flatnonzero(some & np.array([each is way for each in table.ways])[table.way])
    k, n = table.mountings[rows].astype(np.float64), table.each[rows].astype(np.float64)
    before = known_freedom(way.lines, way.dwell)
    of_sets = freedom_of_sets(table.mountings[rows], table.each[rows], before, by_time=False)
    best: Prepared | None = None
    for units in _worth_making(preparations):
        made = {each.name: each.line(number) for each, number in units}
        lines = [made.get(line.name, line) for line in way.lines]
        once = math.fsum(each.seconds(number) for each, number in units)
        halves = half_widths(lines, k, n, way.dwell, of_sets)
        good = np.flatnonzero(halves <= tolerance * (1 + ROUNDING))
        if not good.size:
            continue
        row = int(good[np.argmin(table.mean[rows][good])])
        mean = float(table.mean[rows][row])
        if best is None or once + mean < best.once + best.run.mean:
            sets = int(k[row] * n[row])
            run = allocation(lines, way.costs, int(k[row]), sets, way.dwell, float(halves[row]), mean, way.load)
            best = Prepared({each.name: number for each, number in units}, once, run)
    return best


def _worth_making(preparations: Sequence[Preparation]) -> list[tuple[tuple[Preparation, int], ...]]:
    """Preparations that no others beat: none is as quick and leaves as small a variance; the first one is none."""
    kept: list[tuple[tuple[Preparation, int], ...]] = [()]
    for count in range(1, len(preparations) + 1):
        for some in itertools.combinations(preparations, count):
            found = [tuple(zip(some, units, strict=True)) for units in itertools.product(*(p.choices for p in some))]
            found.sort(key=lambda each: math.fsum(p.seconds(number) for p, number in each))
            least = math.inf
            for each in found:
                if (left := math.fsum(p.line(number).u ** 2 for p, number in each)) < least:
                    least = left
                    kept.append(each)
    return kept
