"""The cheapest plan that reaches a tolerance, and the most accurate plan in a given time.

    allocate(lines, Costs(start=4, mounting=93, set=1.6, person=60), 0.05)

k mountings of n sets, N = k n sets in all with D seconds of dwell in all, take start + mounting k + set N + D seconds
and have the variance m/k + s/N + d/D + floor. With real numbers both are convex, and for a given k the best N and D are
known in closed form. So the best k is found by halving. Whole numbers are searched around it, outwards on both
sides, until even the real optimum of a k is worse than the best plan so far: no better plan of whole numbers is left.
Only plans of several hundred mountings may be some percent from the best one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import as_typed

CLOSE = 1e-4  # relative distance from the real optimum at which the search for whole numbers ends
MOST_STEPS = 500  # of this search, on each side; only plans of more mountings than that need more
ROUNDING = 1e-12
SMALLEST = 1e-9  # tolerance
LONGEST = 1e10  # s, three centuries: a plan that takes longer is none
SHORTEST = 0.1  # s, the usual least dwell of a set: one period at 10 Hz


class BelowFloor(RangeError):
    """A tolerance is not above the floor. `floor`: what no time lowers; `line`: name of its largest line."""

    def __init__(self, tolerance: float, floor: float, line: str) -> None:
        super().__init__(
            f"a relative standard uncertainty of {tolerance:.3g} cannot be reached: {line} leaves {floor:.3g}, which no"
            f" time on the bench lowers; give a greater tolerance than that, or lower the line {line!r} itself"
        )
        self.floor, self.line = floor, line


@dataclass(frozen=True, slots=True)
class Allocation:
    """A plan: `sets` are those of all mountings together, as many in each; `dwell` is that of one set [s].

    Attributes:
        seconds: bench time of the plan.
        u: relative standard uncertainty of the answer, by the lines.
        shares: share of each line, by its name, in the variance.
        binds: the line with the largest share; empty: nothing is uncertain.
        degrees_of_freedom: those of `u`, by Welch and Satterthwaite.
    """

    mountings: int
    sets: int
    dwell: float
    seconds: float
    u: float
    shares: dict[str, float]
    binds: str
    degrees_of_freedom: float = math.inf


@dataclass(frozen=True, slots=True)
class _AllocationProblem:
    """Variances of one mounting, one set, one second of dwell, and of what nothing lowers; what they cost."""

    mounting: float
    set: float
    second: float
    floor: float
    costs: Costs
    shortest: float
    fewest: int

    def variance(self, mountings: float, sets: float, dwell: float) -> float:
        """Variance of a plan; `dwell` is that of one set."""
        return self.floor + self.mounting / mountings + self.set / sets + self.second / (sets * dwell)

    @property
    def dwells_pay(self) -> bool:
        """Whether a set dwells for longer than the shortest time, where the number of sets is free."""
        return self.second * self.costs.set > self.shortest**2 * self.set


def allocate(
    lines: Sequence[BudgetLine], costs: Costs, tolerance: float, shortest: float = SHORTEST, fewest: int = 1
) -> Allocation:
    """The plan of the least bench time whose relative standard uncertainty is not above the tolerance.

    Args:
        lines: lines of the answer's uncertainty, with names of their own.
        costs: what mountings and sets take.
        tolerance: relative standard uncertainty.
        shortest: least dwell of a set [s].
        fewest: least number of sets in each mounting.

    Raises:
        BelowFloor: the tolerance is not above what the lines leave that nothing lowers.
        RangeError: the tolerance, the shortest dwell or the fewest sets are not above 0, there are no lines or two of
            one name, or the plan would take centuries.
    """
    return _allocation(lines, costs, *cheapest(lines, costs, tolerance, shortest, fewest))


def cheapest(
    lines: Sequence[BudgetLine], costs: Costs, tolerance: float, shortest: float = SHORTEST, fewest: int = 1
) -> tuple[int, int, float]:
    """Mountings, sets and dwell of a set [s] of that plan alone, in a fraction of the time; as `allocate`."""
    problem = _problem(lines, costs, shortest, fewest)
    if not (math.isfinite(tolerance) and tolerance > SMALLEST):
        raise RangeError(
            f"tolerance {tolerance:g} is not above {SMALLEST:g}; give a relative standard uncertainty, such as 0.05"
        )
    free = tolerance**2 - problem.floor
    if free <= 0:
        raise _below(lines, tolerance)

    def sets_of(mountings: int) -> float:
        """Best number of sets, real; infinite where the mountings alone are above the tolerance."""
        left = free - problem.mounting / mountings
        if left <= 0:
            return math.inf
        if not problem.dwells_pay:
            return max(fewest * mountings, (problem.set + problem.second / shortest) / left)
        return max(fewest * mountings, (problem.set + math.sqrt(problem.set * problem.second / costs.set)) / left)

    def dwell_of(mountings: int, sets: float) -> float:
        """Dwell of one set that reaches the tolerance; infinite where none does."""
        left = free - problem.mounting / mountings - problem.set / sets
        if left <= 0:
            return math.inf if problem.second or left < -ROUNDING * free else shortest
        return max(shortest, problem.second / left / sets)

    def seconds(mountings: int, sets: float) -> float:
        return costs.seconds(mountings, sets, dwell_of(mountings, sets)) if sets < math.inf else math.inf

    least = max(1, math.floor(min(problem.mounting / free, LONGEST)))
    while least < LONGEST and sets_of(least) == math.inf:
        least += 1
    mountings, sets = _best((least, math.inf), fewest, sets_of, seconds)
    if not (taken := seconds(mountings, sets)) < LONGEST:
        floor = math.sqrt(problem.floor)
        raise RangeError(
            f"a relative standard uncertainty of {tolerance:.3g} takes {taken:.1e} s on the bench, more than three"
            f" centuries (no time lowers {floor:.3g}); give a greater tolerance"
        )
    return mountings, sets, dwell_of(mountings, sets)


def allocate_time(
    lines: Sequence[BudgetLine], costs: Costs, seconds: float, shortest: float = SHORTEST, fewest: int = 1
) -> Allocation:
    """The plan with the least uncertainty that takes no longer than some time on the bench [s].

    Where dwell lowers nothing, the plan may take less.

    Raises:
        RangeError: not even one set fits, the time is not finite, or as for `allocate`.
    """
    problem = _problem(lines, costs, shortest, fewest)
    if not (math.isfinite(seconds) and seconds <= LONGEST):
        raise RangeError(f"a bench time of {seconds:g} s; give a finite one of three centuries at most")
    if (least := costs.seconds(1, fewest, shortest)) > seconds:
        what = "one set takes" if fewest == 1 else f"{fewest} sets take"
        raise RangeError(f"{what} {least:.4g} s on the bench; {as_typed(seconds, 's')} is too short: give more time")

    def rest(mountings: int) -> float:
        return seconds - costs.start - costs.mounting * mountings

    def sets_of(mountings: int) -> float:
        """Best number of sets, real; infinite where the mountings leave no time for one set each."""
        most = rest(mountings) / (costs.set + shortest)
        if most < fewest * mountings * (1 - ROUNDING):
            return math.inf
        if not problem.dwells_pay:
            return most if problem.set else float(fewest * mountings)
        ratio = math.sqrt(problem.second * costs.set / problem.set) if problem.set else math.inf
        return max(fewest * mountings, min(rest(mountings) / (costs.set + ratio), most))

    def dwell_of(mountings: int, sets: float) -> float:
        """Dwell of one set: the time that is left, or the shortest where more of it lowers nothing."""
        left = rest(mountings) - costs.set * sets
        if left < shortest * sets - ROUNDING * seconds:
            return math.inf
        return max(left / sets, shortest) if problem.second else shortest

    def variance(mountings: int, sets: float) -> float:
        dwell = dwell_of(mountings, sets) if sets < math.inf else math.inf
        return problem.variance(mountings, sets, dwell) if dwell < math.inf else math.inf

    most = seconds / (costs.mounting + costs.set + shortest)
    mountings, sets = _best((1, most), fewest, sets_of, variance)
    return _allocation(lines, costs, mountings, sets, dwell_of(mountings, sets))


def _best(
    mountings_between: tuple[int, float],
    fewest: int,
    sets_of: Callable[[int], float],
    price: Callable[[int, float], float],
) -> tuple[int, int]:
    """Whole numbers of mountings and of sets, as many in each mounting, of the least price.

    Args:
        mountings_between: least number of mountings that is possible, and a number that is surely too great.
        fewest: least number of sets in each mounting.
        sets_of: best real number of sets for some mountings; infinite: none is possible.
        price: what is least to be; convex in both numbers, infinite where a plan is impossible.
    """

    def bound(mountings: int) -> float:
        return price(mountings, sets_of(mountings))

    start, most = mountings_between
    low, high = start, 2 * start
    while bound(high) < bound(high - 1) and high < most:
        low, high = high, 2 * high
    while low < high:  # the first mountings to which another one adds nothing
        middle = (low + high) // 2
        low, high = (middle + 1, high) if bound(middle + 1) < bound(middle) else (low, middle)
    least, best, plan = bound(low), math.inf, (low, fewest * low)
    upwards, downwards = range(low, low + MOST_STEPS), range(low - 1, max(start, low - MOST_STEPS) - 1, -1)
    for walk in (upwards, downwards):
        for mountings in walk:
            if best <= least * (1 + CLOSE) or not bound(mountings) < best:
                break
            each = sets_of(mountings) / mountings
            for number in {max(fewest, math.floor(each)), max(fewest, math.ceil(each))}:
                if (found := price(mountings, number * mountings)) < best:
                    best, plan = found, (mountings, number * mountings)
    return plan


def _problem(lines: Sequence[BudgetLine], costs: Costs, shortest: float, fewest: int) -> _AllocationProblem:
    if not lines:
        raise RangeError("an answer without a line of uncertainty has no price; give at least one line")
    names = [line.name for line in lines]
    if twice := [name for name in names if names.count(name) > 1]:
        raise RangeError(f"two lines are named {twice[0]!r}; give each a name of its own")
    if not (math.isfinite(shortest) and shortest > 0):
        raise RangeError(f"a shortest dwell of {shortest:g} s; give a time above 0")
    if fewest < 1:
        raise RangeError(f"at least {fewest} sets in a mounting; give 1 or more")
    mounting, each, second, floor = (
        math.fsum(line.u**2 for line in lines if line.per is unit)
        for unit in (RepeatUnit.MOUNTING, RepeatUnit.SET, RepeatUnit.SECOND, RepeatUnit.NOTHING)
    )
    return _AllocationProblem(mounting, each, second, floor, costs, shortest, fewest)


def _below(lines: Sequence[BudgetLine], tolerance: float) -> BelowFloor:
    fixed = [line for line in lines if line.per is RepeatUnit.NOTHING]
    return BelowFloor(tolerance, math.hypot(*(line.u for line in fixed)), max(fixed, key=lambda line: line.u).name)


def _allocation(lines: Sequence[BudgetLine], costs: Costs, mountings: int, sets: int, dwell: float) -> Allocation:
    found = budget(lines, mountings, sets, dwell)
    shares = {row["name"]: row["share"] for row in found.rows()}
    binds = max(shares, key=lambda name: shares[name]) if found.u > 0 else ""
    seconds = costs.seconds(mountings, sets, dwell)
    return Allocation(mountings, sets, dwell, seconds, found.u, shares, binds, found.degrees_of_freedom)
