"""When a run has measured enough, and what its answer is worth: Stein's two stages.

    plan = allocate(lines, costs, 0.02, fewest=FIRST)
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

from palpate.instrument.allocation.allocate import Allocation, cheapest
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, merged
from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import Budget, Floats

FIRST = 10  # least number of sets whose scatter decides
REFUTED = 0.01  # probability with which a prior that is true is called refuted
ROUNDING = 1e-9
SETS = "sets"  # name of the estimate of how much sets scatter
FEWEST_MOUNTINGS = 3  # that tell how much mountings scatter

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
    return max(FIRST, math.ceil(plan.sets / plan.mountings / 2))


def enough(
    lines: Sequence[BudgetLine], costs: Costs, tolerance: float, plan: Allocation, sensitivity: float, ratios: Ratios
) -> StoppingVerdict:
    """Whether a run has measured enough for a tolerance, and how much it needs in all.

    What is needed follows the sensitivity, which moves with the mean ratio. So the best plan may come to be fewer
    mountings of more sets than were made. Mountings that are done count as they are: sets of one do not make up for
    those that another lacks, so that another mounting follows where the last one is full.

    Args:
        lines, costs, tolerance: those from which the plan was made.
        plan: what was planned before the run; its dwell holds for all sets.
        sensitivity: relative change of the answer over that of the ratio, d ln E / d ln R for a modulus.
        ratios: ratios of each mounting's sets so far.

    Raises:
        RangeError: a ratio or the sensitivity is not above 0, or the run would take centuries with the scatter found.
    """
    first = first_sets(plan)
    done = [len(each) for each in ratios]
    if sum(done) < first:
        return StoppingVerdict(plan.mountings, max(plan.sets, first * plan.mountings), "")
    batch = _first(ratios, first)
    found = _learned(lines, plan.dwell, sensitivity, batch, batch)
    mountings, sets_of_all, _ = cheapest(merged(found.lines, plan.dwell), costs, tolerance, plan.dwell, first)
    each = sets_of_all // mountings
    whole = [sets for sets in ratios if len(sets) >= each]
    found = _learned(lines, plan.dwell, sensitivity, batch, whole or batch)
    if found.mountings_refuted:  # sets in each mounting stay as they are: only the number of mountings follows
        free = tolerance**2 - sum(line.u**2 for line in found.lines if line.per is RepeatUnit.NOTHING)
        of_one = sum(line.u**2 for line in found.lines if line.per is RepeatUnit.MOUNTING)
        of_one += sum(line.u**2 for line in merged(found.lines, plan.dwell) if line.per is RepeatUnit.SET) / each
        mountings = max(FEWEST_MOUNTINGS, math.ceil(of_one / free))
    reached = answer(lines, plan, sensitivity, ratios)
    fewest = FEWEST_MOUNTINGS if found.mountings_refuted else 1
    if reached.u <= tolerance * (1 + ROUNDING) and len(done) >= fewest:
        told = f"{100 * reached.u:.2g} % reached, {100 * tolerance:.2g} % was asked for"
        return StoppingVerdict(len(done), sum(done), told)
    mountings = max(mountings, len(done) + (done[-1] >= each))
    return StoppingVerdict(mountings, mountings * each, "")


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
    falling = [line for line in lines if line.per is not RepeatUnit.NOTHING]
    inverse = [1 / budget(falling, 1, number, dwell).u ** 2 for number in sets]
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
    prior = _prior(of_sets, dwell)
    sets = pooled(prior.u / sensitivity, prior.degrees_of_freedom, *batch)
    own = sum(len(each) for each in batch) >= FIRST and math.isfinite(prior.degrees_of_freedom)
    told = pooled(0.0, 0.0, *batch) if own else sets
    scattered = _scaled(of_sets, SETS, sensitivity * told.u, prior.u, told.degrees_of_freedom, RepeatUnit.SET)

    known = _prior(of_mountings, dwell)
    of_mean = sensitivity * told.u * math.sqrt(math.fsum(1 / len(each) for each in mountings) / len(mountings))
    both = [BudgetLine("mounting", known.u, RepeatUnit.SET, known.degrees_of_freedom)]
    both += [BudgetLine("mean of sets", of_mean, RepeatUnit.SET, told.degrees_of_freedom)]
    expected = budget(both, 1, 1, dwell)
    means = [math.exp(float(_logs(each).mean())) for each in mountings]
    between = pooled(expected.u / sensitivity, expected.degrees_of_freedom, means)
    if between.refuted:
        u = math.sqrt(max(0.0, (sensitivity * between.u) ** 2 - of_mean**2))
        of_mountings = _scaled(of_mountings, "mountings", u, known.u, between.degrees_of_freedom, RepeatUnit.MOUNTING)
    return _Learned([*scattered, *of_mountings, *rest], sets.refuted, between.refuted)


def _prior(lines: Sequence[BudgetLine], dwell: float) -> Budget:
    """What some lines together add to one set of one mounting."""
    return budget(lines, 1, 1, dwell)


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
