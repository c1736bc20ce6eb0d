"""When a run has measured enough, and what its answer is worth: Stein's two stages.

    plan = Table.of([RunOption(lines, costs, 0.1)]).for_tolerance(0.02)
    while not (verdict := enough(lines, costs, 0.02, plan, sensitivity, ratios)).why: ...  # one more set
    answer(lines, plan, sensitivity, ratios).u

The first sets of a run, ten or half of those planned, tell how much sets scatter. That scatter fixes how many sets
there are in all, and it is the one in the answer's interval. The scatter of some sets and their mean are independent,
so that Student's interval holds with its probability whatever the true scatter is (C. Stein, Ann. Math. Statist. 16,
243, 1945). To look again after every set, or to trust a prior that is too small, would make the interval too narrow:
both stop where the scatter happens to be small.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, falling, half_widths, halves_of
from palpate.instrument.allocation.table import (
    FIRST,
    MOST_MOUNTINGS,
    MOST_SETS,
    ROUNDING,
    STEP,
    Allocation,
    RunOption,
    Table,
    first_of,
    known_freedom,
    scatter_factors,
)
from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import COVERAGE, Budget

REFUTED = 0.01  # probability with which a prior that is true is called refuted
SETS, MOUNTINGS = "sets", "mountings"  # names of the estimates of how much they scatter
RUNS = 500  # that are drawn to tell how long runs take
MORE = 3, 20  # times the planned mountings, and mountings besides: what a drawn run has at most

Ratios = Sequence[Sequence[float]]
"""Ratios of the sets of each mounting, in the order in which they were measured."""


@dataclass(frozen=True, slots=True)
class Scatter:
    """Relative standard deviation of one of several repeats, and whether they refute what was known before."""

    u: float
    degrees_of_freedom: float
    refuted: bool


@dataclass(frozen=True, slots=True)
class StoppingVerdict:
    """Whether a run has measured enough.

    Attributes:
        mountings, sets: how many the run has at its end, in all, by what is known now; as many sets in each mounting.
        why: why it has enough, for people; empty: go on.
    """

    mountings: int
    sets: int
    why: str


@dataclass(frozen=True, slots=True)
class RunRatio:
    """The ratio of a run: the geometric mean over mountings of the geometric mean of their sets.

    Mountings count alike, unless they have unlike numbers of sets, as after an interruption: then by their variances.

    Attributes:
        ratio: the mean ratio.
        budget: relative uncertainty of what is derived from it: `u`, `degrees_of_freedom`, `expanded()`, `rows()`.
        sets_refuted, mountings_refuted: whether sets, or mountings, scatter more than was known before.
    """

    ratio: float
    budget: Budget
    sets_refuted: bool
    mountings_refuted: bool

    @property
    def u(self) -> float:
        return self.budget.u

    @property
    def degrees_of_freedom(self) -> float:
        return self.budget.degrees_of_freedom


def pooled(prior_u: float, prior_freedom: float, *ratios: Sequence[float]) -> Scatter:
    """Scatter of a ratio by what was known before and by ratios, each group of them about a mean of its own.

    Where the ratios scatter more than the prior allows (χ² at 1 %), the prior is dropped.

    Args:
        prior_u: relative standard deviation that was known before.
        prior_freedom: its degrees of freedom; 0: nothing was known, infinite: it is certain.
        ratios: groups of ratios above 0.

    Raises:
        RangeError: a ratio is not above 0, the prior is negative, or neither it nor the ratios tell a scatter.
    """
    if not (math.isfinite(prior_u) and prior_u >= 0 and prior_freedom >= 0):
        raise RangeError(f"prior scatter {prior_u:g} of {prior_freedom:g} degrees of freedom; give 0 or more of both")
    squares, freedom = 0.0, 0
    for group in ratios:
        logs = _logs(group)
        squares += float(((logs - logs.mean()) ** 2).sum()) if logs.size else 0.0
        freedom += max(0, logs.size - 1)
    if prior_freedom + freedom == 0:
        raise RangeError("one ratio alone tells no scatter; give two or more, or a prior")
    if freedom and prior_freedom > 0 and squares > prior_u**2 * _chi_square(freedom):
        return Scatter(math.sqrt(squares / freedom), freedom, refuted=True)
    if math.isinf(prior_freedom):
        return Scatter(prior_u, math.inf, refuted=False)
    variance = (prior_freedom * prior_u**2 + squares) / (prior_freedom + freedom)
    return Scatter(math.sqrt(variance), prior_freedom + freedom, refuted=False)


def _chi_square(freedom: int) -> float:
    """Value that a sum of squares passes with the probability REFUTED."""
    from scipy.special import chdtri

    return float(chdtri(freedom, REFUTED))


def first_sets(plan: Allocation) -> int:
    """Number of a run's first sets, whose scatter decides how many there are in all."""
    return int(first_of(np.array([plan.sets // plan.mountings]))[0])


def enough(
    lines: Sequence[BudgetLine], costs: Costs, tolerance: float, plan: Allocation, sensitivity: float, ratios: Ratios
) -> StoppingVerdict:
    """Whether a run has measured enough for a tolerance, and how much it needs in all.

    What is needed follows the sensitivity, which moves with the mean ratio. Mountings that are done count as they are:
    sets of one do not make up for those that another lacks, so that another mounting follows where the last one is
    full. No run ends before its planned number of mountings: to end early where they happen to agree would make the
    interval too narrow.

    Args:
        lines, costs: those from which the plan was made.
        tolerance: half-width of the 95 % interval, relative.
        plan: what was planned before the run; its dwell holds for all sets.
        sensitivity: relative change of the answer over that of the ratio, d ln E / d ln R for a modulus.
        ratios: ratios of each mounting's sets so far.

    Raises:
        RangeError: a ratio or the sensitivity is not above 0. OutOfReach: by the scatter found, no run is enough.
    """
    first = first_sets(plan)
    done = [len(each) for each in ratios]
    if sum(done) < first:
        return StoppingVerdict(plan.mountings, max(plan.sets, first * plan.mountings), "")
    batch = _first(ratios, first)
    found = _learned(lines, plan.dwell, sensitivity, batch, batch[:1])
    mountings, each = _needed(found.lines, costs, tolerance, plan, first)
    reached = answer(lines, plan, sensitivity, ratios).budget.expanded()
    if reached <= tolerance * (1 + ROUNDING) and len(done) >= plan.mountings:
        outcome = f"± {100 * reached:.2g} % reached, ± {100 * tolerance:.2g} % was asked for"
        return StoppingVerdict(len(done), sum(done), outcome)
    mountings = max(mountings, len(done) + (done[-1] >= each))
    return StoppingVerdict(mountings, mountings * each, "")


def _needed(
    lines: Sequence[BudgetLine], costs: Costs, tolerance: float, plan: Allocation, first: int
) -> tuple[int, int]:
    """Mountings and sets in each of a run whose sets scatter as the first ones: as many mountings as were planned.

    Only where no number of sets in these is enough, there are more mountings.
    """
    most = max(first, MOST_SETS // plan.mountings)
    sets = np.unique(np.minimum(np.ceil(first * STEP ** np.arange(math.log(most / first) / math.log(STEP) + 1)), most))
    freedom = np.full(sets.shape, first - 1.0)
    halves = half_widths(lines, np.full(sets.shape, float(plan.mountings)), sets, plan.dwell, freedom)
    if (good := np.flatnonzero(halves <= tolerance * (1 + ROUNDING))).size:
        return plan.mountings, int(sets[good[0]])
    numbers = [plan.mountings]
    if any(line.u for line in lines if line.per is RepeatUnit.MOUNTING):
        numbers = list(range(plan.mountings, max(plan.mountings, MOST_MOUNTINGS) + 1))
    wanted = Table.of([RunOption(lines, costs, plan.dwell)], numbers, fewest=first).for_tolerance(tolerance)
    return wanted.mountings, wanted.sets // wanted.mountings


def answer(
    lines: Sequence[BudgetLine], plan: Allocation, sensitivity: float, ratios: Ratios, *, by_time: bool = False
) -> RunRatio:
    """The mean ratio of a run, with the uncertainty of what is derived from it.

    Args:
        lines, plan, sensitivity, ratios: as for `enough`.
        by_time: the number of sets was fixed by time, not by their scatter: all of them tell the scatter.

    With fewer than ten sets, the prior of the lines and the sets tell the scatter together.

    Raises:
        RangeError: there is no ratio, or one or the sensitivity is not above 0.
    """
    taken = [each for each in ratios if each]
    if not taken:
        raise RangeError("no set is measured: there is no answer yet")
    batch = taken if by_time else _first(taken, first_sets(plan))
    found = _learned(lines, plan.dwell, sensitivity, batch, taken)
    means, sets = [float(_logs(each).mean()) for each in taken], [len(each) for each in taken]
    weights = _weights(found.lines, plan.dwell, sets)
    mean = math.fsum(map(operator.mul, weights, means))
    # As many mountings and sets, all alike, would give the mean this variance.
    mountings = max(1.0, 1 / math.fsum(weight**2 for weight in weights))
    alike = 1 / math.fsum(weight**2 / number for weight, number in zip(weights, sets, strict=True))
    reached = budget(found.lines, mountings, alike, plan.dwell)
    return RunRatio(math.exp(mean), reached, found.sets_refuted, found.mountings_refuted)


def _first(ratios: Ratios, first: int) -> list[Sequence[float]]:
    """The first sets of a run, by mountings; after an interruption they are those of two mountings or more."""
    found: list[Sequence[float]] = []
    for each in ratios:
        if left := first - sum(map(len, found)):
            found.append(each[:left])
    return found


def _weights(lines: Sequence[BudgetLine], dwell: float, sets: Sequence[int]) -> list[float]:
    """Weights of the means of mountings with so many sets, by the variance of each mean; equal for as many sets."""
    if len({*sets}) == 1:
        return [1 / len(sets)] * len(sets)
    inverse = [1 / budget(falling(lines), 1, number, dwell).u ** 2 for number in sets]
    return [each / math.fsum(inverse) for each in inverse]


@dataclass(frozen=True, slots=True)
class _Learned:
    """Lines of an answer with what a run has learned of them."""

    lines: list[BudgetLine]
    sets_refuted: bool
    mountings_refuted: bool


def _learned(
    lines: Sequence[BudgetLine], dwell: float, sensitivity: float, batch: Ratios, mountings: Ratios
) -> _Learned:
    """The lines after a run: `batch` tells how much sets scatter, the means of `mountings` how much those do."""
    if not (math.isfinite(sensitivity) and sensitivity > 0):
        raise RangeError(f"sensitivity {sensitivity:g}; give the change of the answer over that of the ratio, above 0")
    of_sets = [line for line in lines if line.per in (RepeatUnit.SET, RepeatUnit.SECOND)]
    of_mountings = [line for line in lines if line.per is RepeatUnit.MOUNTING]
    rest = [line for line in lines if line.per is RepeatUnit.NOTHING]
    prior = budget(of_sets, 1, 1, dwell)
    sets = pooled(prior.u / sensitivity, prior.degrees_of_freedom, *batch)
    own = sum(len(each) for each in batch) >= FIRST and math.isfinite(prior.degrees_of_freedom)
    spread = pooled(0.0, 0.0, *batch) if own else sets
    scattered = _scaled(of_sets, SETS, sensitivity * spread.u, prior.u, spread.degrees_of_freedom, RepeatUnit.SET)

    mounted, refuted = _mounted(of_mountings, sensitivity, spread, mountings)
    return _Learned([*scattered, *mounted, *rest], sets.refuted, refuted)


def _mounted(
    lines: Sequence[BudgetLine], sensitivity: float, sets: Scatter, mountings: Ratios
) -> tuple[list[BudgetLine], bool]:
    """The lines of mountings with what these tell of their scatter, and whether that refutes what was stated.

    A prior is pooled with them, upwards and downwards: what their means scatter more than their sets explain has as
    many degrees of freedom as there are further mountings. A stated scatter stands, unless they refute it.
    """
    u = math.hypot(*(line.u for line in lines))
    freedom = min((line.degrees_of_freedom for line in lines), default=math.inf)
    means = [math.fsum(_logs(each)) / len(each) for each in mountings]
    more, of_mean = len(means) - 1, sets.u**2 * math.fsum(1 / len(each) for each in mountings) / len(mountings)
    squares = math.fsum((each - math.fsum(means) / len(means)) ** 2 for each in means)
    if not more:
        return list(lines), False
    if math.isfinite(freedom):
        beyond = sensitivity**2 * max(0.0, squares - more * of_mean)
        scatter = math.sqrt((freedom * u**2 + beyond) / (freedom + more))
        return _scaled(lines, MOUNTINGS, scatter, u, freedom + more, RepeatUnit.MOUNTING), False
    stated = (u / sensitivity) ** 2 + of_mean
    if squares <= stated * _chi_square(more):
        return list(lines), False
    scatter = sensitivity * math.sqrt(max(0.0, squares / more - of_mean))
    return _scaled(lines, MOUNTINGS, scatter, u, more, RepeatUnit.MOUNTING), True


def _scaled(
    lines: Sequence[BudgetLine], name: str, u: float, prior_u: float, freedom: float, per: RepeatUnit
) -> list[BudgetLine]:
    """Lines that shared the uncertainty `prior_u`, scaled so that they share `u`; a new line where there was none."""
    if prior_u == 0:
        return [BudgetLine(f"scatter of {name}", u, per, freedom)]
    return [replace(line, u=line.u * u / prior_u, degrees_of_freedom=freedom, estimate=name) for line in lines]


def _logs(ratios: Sequence[float]) -> Floats:
    """Natural logarithms. Raises RangeError: a ratio is not above 0 and finite."""
    if wrong := [each for each in ratios if not (math.isfinite(each) and each > 0)]:
        raise RangeError(f"ratio {wrong[0]:g}; a ratio is above 0 and finite")
    return np.log(np.asarray(ratios, dtype=np.float64))


# -------------------------------------------------------------------------------------------------------
# How long a run takes that ends by the scatter of its own sets and mountings: on average, and at most
#
# run_times(lines, costs, 0.02, plan, most=10_000).mean


@dataclass(frozen=True, slots=True)
class RunTimes:
    """Bench times of the runs of one plan [s].

    Attributes:
        mean: their mean.
        longest: the bound, at which a run ends whether or not it has reached its tolerance.
        mountings: their mean number of mountings.
        enough: share of runs that reach it within the bound, where no other limit of time ends them.
    """

    mean: float
    longest: float
    mountings: float
    enough: float = COVERAGE

    @property
    def kept(self) -> bool:
        """Whether as many runs reach it as the bound is made for."""
        return round(self.enough, 2) >= COVERAGE


def run_times(
    lines: Sequence[BudgetLine],
    costs: Costs,
    tolerance: float,
    plan: Allocation,
    most: int = MOST_SETS,
    limit: float | None = None,
) -> RunTimes:
    """Bench times before it is known how much sets and mountings scatter in this run.

    Runs are drawn, always the same ones: their true scatter of mountings from its prior, the scatter of their first
    sets from F, and the means of their mountings. Each ends by the rule of `enough`. The bound is the time that 95 % of
    them need at most, and no run goes on beyond it.

    Args:
        lines, costs, tolerance: those from which the plan was made.
        plan: the plan.
        most: number of sets with which a run ends in any case.
        limit: bench time that ends a run instead of the bound [s]; None: the bound ends it.
    """
    chance = np.random.default_rng(0)
    planned, first = plan.sets // plan.mountings, first_sets(plan)
    factors = scatter_factors(np.array([first]), known_freedom(lines, plan.dwell), RUNS)[0]
    each = np.maximum(first, np.ceil(planned * factors))
    of_mountings = [line for line in lines if line.per is RepeatUnit.MOUNTING]
    prior = budget(of_mountings, 1, 1, 1) if of_mountings else None
    count = np.full(RUNS, float(plan.mountings))
    if prior is not None and prior.u > 0 and math.isfinite(freedom := prior.degrees_of_freedom):
        numbers = np.arange(1, plan.mountings * MORE[0] + MORE[1], dtype=np.float64)
        of_sets = [line for line in lines if line.per in (RepeatUnit.SET, RepeatUnit.SECOND)]
        of_mean = budget(of_sets, 1, 1, plan.dwell).u ** 2 * factors / each
        true = freedom * prior.u**2 / chance.chisquare(freedom, RUNS)
        shape = (RUNS, numbers.size)
        means = chance.standard_normal(shape) * np.sqrt(true + of_mean)[:, None]
        squares = np.cumsum(means**2, axis=1) - np.cumsum(means, axis=1) ** 2 / numbers
        pooled = freedom * prior.u**2 + np.maximum(0.0, squares - (numbers - 1) * of_mean[:, None])
        all_freedom = freedom + numbers - 1
        halves = halves_of(lines, pooled / all_freedom / numbers, all_freedom, of_mean[:, None] / numbers, first - 1)
        good = (halves <= tolerance * (1 + ROUNDING)) & (numbers >= plan.mountings)
        count = np.where(good.any(axis=1), numbers[good.argmax(axis=1)], numbers[-1]).astype(np.float64)
    sets = count * each
    seconds = costs.start + costs.mounting * count + (costs.set + plan.dwell) * np.minimum(sets, most)
    bound = max(plan.seconds, float(np.quantile(seconds, COVERAGE)))
    end = bound if limit is None else limit
    reached = float(np.mean((sets <= most) & (seconds <= bound)))
    enough_of = COVERAGE if reached >= COVERAGE * (1 - 2 / RUNS) else reached
    spent = np.minimum(seconds, end)
    begun = np.ceil(count * (spent - costs.start) / (seconds - costs.start) - ROUNDING)
    return RunTimes(float(spent.mean()), min(bound, end), float(begun.mean()), enough_of)
