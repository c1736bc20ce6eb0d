"""Every plan of repeated load sets, and the best of them: for a tolerance, in a time, and all that no other one beats.

    table = Table.of([RunOption(lines, Costs(start=4, mounting=93, set=1.6), dwell=0.1)], mountings=range(1, 61))
    table.for_tolerance(0.05), table.for_time(240.0), table.front_rows()

A plan is a way of the run (its load and dwell), k mountings, and n sets in each. All plans of a grid are rows of one
table, with the half-width of the 95 % interval of their answers and their bench times. What is planned for a
tolerance, what is planned for a time, what is drawn and what is refused are looked up in the same rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from palpate.instrument.allocation.lines import MOST_FREEDOM, BudgetLine, Costs, RepeatUnit, budget, half_widths
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import LARGEST_SHARE, as_typed, counted, plus_minus, rounded_up

Numbers = npt.NDArray[np.int64]

FIRST = 10  # least number of sets whose scatter decides how many there are in all
MOST_SETS = 10_000  # of a plan, and of a run
MOST_MOUNTINGS = 60  # of a plan that chooses their number
STEP = 1.02  # ratio of neighbouring numbers of sets
PARTS = 25  # of equal probability, at whose middles it is asked how much sets may scatter
PREFERRED = 1.02  # what a plan with the greatest load may cost over one with a smaller load
LONGER = 12  # times that a dwell is doubled at most, from the shortest one on
PAYS = 0.05  # share of noise in the scatter of a set below which a longer dwell buys nothing
ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class RunOption:
    """One way of a run.

    Attributes:
        lines: lines of the answer's uncertainty.
        costs: bench times.
        dwell: dwell of a set [s].
        load: load, peak to peak [N]; of plans that are nearly as quick, the one with the greatest load is taken,
            because what no plan knows disturbs it least.
    """

    lines: Sequence[BudgetLine]
    costs: Costs
    dwell: float
    load: float = 0.0


@dataclass(frozen=True, slots=True)
class Allocation:
    """A plan: `sets` are those of all mountings together, as many in each; `dwell` is that of one set [s].

    Attributes:
        seconds: bench time of the plan, if sets scatter as they are known to.
        u: relative standard uncertainty of the answer, by the lines.
        half: half-width of its 95 % interval, relative.
        shares: share of each line in the variance, by its name.
        binds: the line with the largest share; empty: nothing is uncertain.
        mean: bench time on average over what sets may scatter [s]; it is above `seconds`.
        load: load, peak to peak [N], where the plan chooses it.
    """

    mountings: int
    sets: int
    dwell: float
    seconds: float
    u: float
    half: float
    shares: dict[str, float]
    binds: str
    mean: float = math.nan
    load: float = 0.0

    def summary(self) -> dict[str, Any]:
        """What it takes and gives, for JSON."""
        return {name: getattr(self, name) for name in ("seconds", "u", "half", "binds", "shares")}


class OutOfReach(RangeError):
    """No plan reaches a tolerance.

    Attributes:
        best: the least half-width of all plans.
        floor: half-width that no number of mountings and sets lowers.
        binds: name of the line that binds: the largest of what nothing lowers, or else of the best plan.
        why: why no plan reaches it, for people; rounded as the best is, to which it may be equal.
    """

    def __init__(self, tolerance: float, best: Allocation, floor: float, binds: str, mountings: int = 1) -> None:
        self.best, self.floor, self.binds = best.half, floor, binds
        if floor >= tolerance:
            least = rounded_up(floor) if floor <= LARGEST_SHARE else floor
            self.why = f"{binds} leaves {plus_minus(least)}, which no longer run lowers"
        else:
            more = f" and {mountings} mountings" if mountings > 1 else ""
            self.why = f"{binds} binds, and a run has {MOST_SETS:,} load sets{more} at most"
        super().__init__(f"± {100 * tolerance:.3g} % cannot be reached: {self.why}")


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of plans: numbers of their ways, mountings, sets in each mounting, half-widths and bench times [s].

    Attributes:
        ways: the ways.
        way, mountings, each: number of the way of each row, of its mountings, and of the sets in each of these.
        half: half-width of the 95 % interval.
        seconds: bench time, if sets scatter as they are known to.
        mean: bench time on average over what they may scatter.
    """

    ways: Sequence[RunOption]
    way: Numbers
    mountings: Numbers
    each: Numbers
    half: Floats
    seconds: Floats
    mean: Floats

    @classmethod
    def of(
        cls,
        ways: Sequence[RunOption],
        mountings: Iterable[int] = (1,),
        *,
        rounds: int = 1,
        fewest: int = FIRST,
        most: int = MOST_SETS,
        by_time: bool = False,
    ) -> Self:
        """All plans.

        Args:
            ways: the ways.
            mountings: numbers of mountings.
            rounds: sets come in whole rounds of so many.
            fewest: least number of sets in each mounting.
            most: greatest number of sets in all.
            by_time: the number of sets is fixed by a time, and all of them tell how much they scatter; else the first
                ones do, and it follows from that.

        Raises:
            RangeError: there is no way, or one without lines or with two of one name.
        """
        _check(ways)
        numbers = np.array(sorted({*mountings}), dtype=np.int64)
        largest = max(fewest, most // int(numbers[0]))
        steps = fewest * STEP ** np.arange(math.ceil(math.log(largest / fewest) / math.log(STEP)) + 1)
        sets = np.unique(rounds * np.ceil(np.minimum(steps, largest) / rounds)).astype(np.int64)
        k, n = (axis.ravel() for axis in np.meshgrid(numbers, sets, indexing="ij"))
        kept = (k * n <= max(most, rounds * math.ceil(fewest / rounds) * int(numbers[0]))) & (n <= largest + rounds)
        k, n = k[kept], n[kept]
        parts = []
        for number, way in enumerate(ways):
            freedom = known_freedom(way.lines, way.dwell)
            expected = n.astype(np.float64) if by_time else _expected(sets, freedom)[np.searchsorted(sets, n)]
            of_sets = freedom_of_sets(k, n, freedom, by_time)
            half = half_widths(way.lines, k.astype(np.float64), n.astype(np.float64), way.dwell, of_sets)
            seconds, mean = (way.costs.start + way.costs.mounting * k + (way.costs.set + way.dwell) * k * each
                             for each in (n, expected))  # fmt: skip
            parts.append((np.full(k.size, number), k, n, half, seconds, mean))
        return cls(ways, *(np.concatenate(column) for column in zip(*parts, strict=True)))

    def for_tolerance(self, tolerance: float) -> Allocation:
        """The plan of the least mean bench time whose half-width is not above the tolerance.

        Raises:
            OutOfReach: there is none.
            RangeError: the tolerance is not above 0 and finite.
        """
        if not (math.isfinite(tolerance) and tolerance > 0):
            raise RangeError(f"tolerance {tolerance:g}; give a relative half-width of the 95 % interval, such as 0.05")
        good = np.flatnonzero(self.half <= tolerance * (1 + ROUNDING))
        if not good.size:
            raise self._out_of_reach(tolerance)
        return self.row(int(good[np.argmin(self._preferring(self.mean)[good])]))

    def for_time(self, seconds: float) -> Allocation:
        """The plan of the least half-width that takes no longer than a bench time [s]; of such ones the quickest.

        Raises:
            RangeError: no plan fits into the time, or it is not finite.
        """
        good = np.flatnonzero(self.seconds <= seconds * (1 + ROUNDING)) if math.isfinite(seconds) else np.array([])
        if not good.size:
            least = int(np.argmin(self.seconds))
            sets = counted(int(self.each[least] * self.mountings[least]), "load set")
            typed = as_typed(seconds, "s") if math.isfinite(seconds) else f"{seconds:g} s"
            raise RangeError(
                f"the least plan, of {sets}, takes {self.seconds[least]:.4g} s on the bench; {typed} is too short, or"
                " no time: give more"
            )
        halves = self._preferring(self.half)[good]
        best = good[halves <= halves.min() * (1 + ROUNDING)]
        return self.row(int(best[np.argmin(self.seconds[best])]))

    def front_rows(self) -> list[int]:
        """Numbers of the rows that no other beats: none is quicker on average and has as small a half-width.

        The quickest one is the first.
        """
        order = np.lexsort((self.half, self._preferring(self.mean)))
        least = np.minimum.accumulate(self.half[order])
        better = np.concatenate(([True], least[1:] < least[:-1]))
        return [int(number) for number in order[better]]

    def row(self, number: int) -> Allocation:
        """The plan of a row."""
        way, k, n = self.ways[self.way[number]], int(self.mountings[number]), int(self.each[number])
        half, mean = float(self.half[number]), float(self.mean[number])
        return allocation(way.lines, way.costs, k, k * n, way.dwell, half, mean, way.load)

    def _preferring(self, values: Floats) -> Floats:
        """Values of the rows, a little greater where the load is not the greatest one."""
        loads = np.array([way.load for way in self.ways])[self.way]
        return np.where(loads == loads.max(), values, PREFERRED * values)

    def _out_of_reach(self, tolerance: float) -> OutOfReach:
        best = self.row(int(np.argmin(self.half)))
        way = max(self.ways, key=lambda each: each.load)
        fixed = [line for line in way.lines if line.per is RepeatUnit.NOTHING]
        # Alone these have fewer effective degrees of freedom than with noise beside them, and so a wider interval.
        floor = min(budget(fixed, 1, 1, 1).expanded(), best.half) if fixed else 0.0
        binds = max(fixed, key=lambda line: line.u).name if fixed and floor >= tolerance else best.binds
        return OutOfReach(tolerance, best, floor, binds, int(self.mountings.max()))


def allocation(
    lines: Sequence[BudgetLine],
    costs: Costs,
    mountings: int,
    sets: int,
    dwell: float,
    half: float | None = None,
    mean: float = math.nan,
    load: float = 0.0,
) -> Allocation:
    """The plan of so many mountings and sets in all. `half` None: their number is fixed, all tell their scatter."""
    reached = budget(lines, mountings, sets, dwell)
    shares = {row["name"]: row["share"] for row in reached.rows()}
    binds = max(shares, key=lambda name: shares[name], default="")
    seconds = costs.seconds(mountings, sets, dwell)
    plan = Allocation(mountings, sets, dwell, seconds, reached.u, math.inf, shares, binds, mean, load)
    return replace(plan, half=half_of(lines, plan, by_time=True) if half is None else half)


def half_of(lines: Sequence[BudgetLine], plan: Allocation, *, by_time: bool) -> float:
    """Half-width of the 95 % interval that some lines leave of a plan. `by_time`: as for `Table.of`."""
    k, n = np.array([plan.mountings]), np.array([plan.sets // plan.mountings])
    of_sets = freedom_of_sets(k, n, known_freedom(lines, plan.dwell), by_time)
    return float(half_widths(lines, k.astype(np.float64), n.astype(np.float64), plan.dwell, of_sets)[0])


def dwells(
    lines: Sequence[BudgetLine], shortest: float, whole: Callable[[float], float] = lambda dwell: dwell
) -> list[float]:
    """Dwells among which a plan chooses [s]: the shortest one, doubled until noise is a small part of a set's scatter.

    Args:
        lines: lines of the answer's uncertainty.
        shortest: the shortest dwell [s].
        whole: makes a dwell one that can be measured, such as whole steps.
    """
    of_set, of_second = (
        sum(line.u**2 for line in lines if line.per is unit) for unit in (RepeatUnit.SET, RepeatUnit.SECOND)
    )
    found = [whole(shortest)]
    while len(found) <= LONGER and of_second / found[-1] > PAYS * of_set:
        found.append(whole(2 * found[-1]))
    return found


def first_of(each: Numbers) -> Numbers:
    """Number of first sets, whose scatter decides how many there are in all, where so many are planned a mounting."""
    found: Numbers = np.maximum(FIRST, -(-each // 2))
    return found


def known_freedom(lines: Sequence[BudgetLine], dwell: float) -> float:
    """Degrees of freedom of what is known of the scatter of a set before a run."""
    of_sets = [line for line in lines if line.per in (RepeatUnit.SET, RepeatUnit.SECOND)]
    return min(budget(of_sets, 1, 1, dwell).degrees_of_freedom, MOST_FREEDOM) if of_sets else MOST_FREEDOM


def scatter_factors(first: Numbers, freedom: float, parts: int = PARTS) -> Floats:
    """Variance of sets over the known one, as the first ones may tell it: middles of parts of equal probability.

    It is distributed as F, because what is known is an estimate, too; its mean is above 1. Of numbers of first sets
    (n,) an array (n, parts).
    """
    from scipy.special import fdtri

    drawn = fdtri(first[:, None] - 1, freedom, (np.arange(parts) + 0.5) / parts)
    return np.asarray(drawn, dtype=np.float64)


def _expected(sets: Numbers, freedom: float) -> Floats:
    """Number of sets that a mounting has on average, where so many are planned."""
    if freedom >= MOST_FREEDOM:  # their scatter is known
        return sets.astype(np.float64)
    first = first_of(sets)
    drawn = np.maximum(first[:, None], np.ceil(sets[:, None] * scatter_factors(first, freedom)))
    return np.asarray(drawn.mean(axis=1), dtype=np.float64)


def freedom_of_sets(mountings: Numbers, each: Numbers, freedom: float, by_time: bool) -> Floats:
    """Degrees of freedom of the scatter of sets in the answer's interval."""
    if freedom >= MOST_FREEDOM:
        return np.full(mountings.shape, MOST_FREEDOM)
    if not by_time:
        return first_of(each).astype(np.float64) - 1.0
    own = (mountings * (each - 1)).astype(np.float64)
    few = mountings * each < FIRST
    return np.asarray(np.where(few, freedom + own, np.maximum(own, 1.0)), dtype=np.float64)


def _check(ways: Sequence[RunOption]) -> None:
    if not ways or not all(way.lines for way in ways):
        raise RangeError("an answer without a line of uncertainty has no price; give at least one line")
    for way in ways:
        names = [line.name for line in way.lines]
        if twice := [name for name in names if names.count(name) > 1]:
            raise RangeError(f"two lines are named {twice[0]!r}; give each a name of its own")
