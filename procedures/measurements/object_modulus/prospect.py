"""The plan for the modulus of an object: the best load, mountings, load sets and dwell, before anything moves.

best_of(design, found, wanted, loads=(2.0, 3.0)).allocation
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from palpate.instrument.allocation.allocate import Allocation, allocate, allocate_time
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.purchase import RunOption
from palpate.instrument.allocation.stopping import FIRST, first_sets
from palpate.instrument.allocation.times import Times, times
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.design import Design
from palpate.procedures.measurements import repeated_sets
from palpate.procedures.measurements.object_modulus.costs import costs_of, shortest
from palpate.procedures.measurements.object_modulus.lines import ExpectedRatio, Wanted, lines_of
from palpate.procedures.measurements.repeated_sets import MOST_SETS

ROBUST = 1.02  # what the plan with a greater load may cost over the cheapest one
BOUND_SETS = 3  # that tell a bound
SHORT = 1, 2, 4  # cycles: a dwell of fewer than four costs noise, as trend and hum are fitted, too


@dataclass(frozen=True, slots=True)
class Prospect:
    """A plan of mountings, sets and dwell, with what it is expected to give.

    Attributes:
        load: load, peak to peak [N].
        found: what the model expects of the object.
        allocation: the plan; its `u` is that of the lines of the tolerance.
        scale_u, absolute_u: relative standard uncertainties that are expected; None: not known.
        times: bench times of such runs, on average and at most [s]: how much sets scatter is known from few data, and a
            run ends at the time that 95 % of them need at most.
    """

    load: float
    found: ExpectedRatio
    allocation: Allocation
    scale_u: float | None
    absolute_u: float | None
    times: Times

    def summary(self) -> dict[str, Any]:
        """The plan under the names of JSON."""
        plan = self.allocation
        return {
            "load_N": self.load,
            "mountings": plan.mountings,
            "sets": plan.sets,
            "dwell_s": plan.dwell,
            "seconds": self.times.mean,
            "as_known_s": plan.seconds,
            "longest_s": self.times.longest,
            "scale_u": self.scale_u,
            "absolute_u": self.absolute_u,
            "force_ratio": self.found.ratio,
            "sensitivity": self.found.sensitivity,
            "shares": plan.shares,
            "binds": plan.binds,
        }


def best_of(design: Design, found: ExpectedRatio, wanted: Wanted, loads: Sequence[float]) -> Prospect:
    """The quickest plan for a tolerance, or the most accurate one in a time; with both, not longer than the time.

    Of the loads, the greatest is taken whose plan costs little more than the best one: what no plan knows, such as
    more noise than usual, disturbs a greater load less.

    Raises:
        BelowFloor: no time on the bench reaches the tolerance.
        RangeError: not one set fits into the time.
    """
    best = _best(design, found, wanted, loads)
    plan, cycles = best.plan, round(best.plan.dwell * wanted.frequency)
    scale, whole = (
        budget(lines_of(design, found, best.load, wanted, both, cycles), plan.mountings, plan.sets, plan.dwell).u
        for both in (False, True)
    )
    absolute = None if found.validation.u is None else whole
    return Prospect(best.load, found, plan, scale, absolute, _times(best, wanted))


def sets_of(design: Design, found: ExpectedRatio, wanted: Wanted, loads: Sequence[float]) -> int:
    """Number of load sets of that plan. Raises as `best_of`."""
    return _best(design, found, wanted, loads).plan.sets


def _best(design: Design, found: ExpectedRatio, wanted: Wanted, loads: Sequence[float]) -> _Planned:
    """The plan of `best_of`."""
    plans, refused = [], []
    for load in loads:
        for cycles in SHORT:
            try:
                plans.append(_planned(design, found, wanted, load, cycles))
            except RangeError as error:  # a greater load takes longer to press: a time may hold a smaller one alone
                refused.append(error)

    def price(each: _Planned) -> float:
        return each.plan.u if wanted.tolerance is None else each.plan.seconds

    if not plans:
        raise refused[0]
    least = min(map(price, plans))
    good = [each for each in plans if price(each) <= ROBUST * least]
    # Where a time holds more sets than a run has, it is not used up: then the quickest plan is best.
    if wanted.tolerance is None and any(has_most_sets(each.plan) for each in good):
        return max(good, key=lambda each: (each.load, -each.plan.seconds))
    return max(good, key=lambda each: (each.load, -price(each)))


def for_bound(found: ExpectedRatio, wanted: Wanted, load: float) -> Prospect:
    """The plan for an object of which a model expects no more than a bound: a few sets tell it."""
    costs, dwell = costs_of(load, wanted.frequency, wanted.mounts), shortest(wanted.frequency)
    mountings = wanted.mountings or 1
    sets = BOUND_SETS * mountings
    seconds = costs.seconds(mountings, sets, dwell)
    plan = Allocation(mountings, sets, dwell, seconds, math.inf, {}, "")
    return Prospect(load, found, plan, None, None, Times(seconds, seconds))


def has_most_sets(plan: Allocation) -> bool:
    """Whether a run has no more load sets than those of a plan."""
    return plan.sets + plan.mountings > MOST_SETS


def most_sets(plan: Allocation, wanted: Wanted) -> int:
    """Number of sets with which a run ends in any case."""
    by_time = plan.sets + repeated_sets.MOST[1]
    return min(by_time if wanted.tolerance is None else repeated_sets.most_sets(plan), MOST_SETS)


@dataclass(frozen=True, slots=True)
class _Planned:
    """The plan for one load [N, peak to peak], and the lines and costs from which it was made."""

    load: float
    plan: Allocation
    lines: tuple[BudgetLine, ...]
    costs: Costs


def _times(planned: _Planned, wanted: Wanted) -> Times:
    """Bench times of the runs of a plan."""
    plan = planned.plan
    if wanted.tolerance is None or plan.u > wanted.tolerance:  # the time ends them
        return Times(plan.seconds, plan.seconds if wanted.time is None else wanted.time)
    sets = first_sets(plan) * (wanted.mountings or 1), most_sets(plan, wanted)  # given mountings are paid at the start
    return times(planned.lines, planned.costs, wanted.tolerance, plan, sets, wanted.time)


def way_of(design: Design, found: ExpectedRatio, wanted: Wanted, load: float, cycles: int) -> RunOption:
    """Lines and costs of runs under a load [N, peak to peak] with a dwell of some cycles or more."""
    least = max(shortest(wanted.frequency), cycles / wanted.frequency)
    lines = lines_of(design, found, load, wanted, not wanted.relative, round(least * wanted.frequency))
    costs = costs_of(load, wanted.frequency, wanted.mounts)
    if wanted.mountings is None:
        return RunOption(lines, costs, least)
    given = tuple(  # they are paid whatever the sets are, and lower their own line once
        replace(line, u=line.u / math.sqrt(wanted.mountings), per=RepeatUnit.NOTHING)
        if line.per is RepeatUnit.MOUNTING
        else line
        for line in lines
    )
    return RunOption(given, Costs(costs.start + wanted.mountings * costs.mounting, 0.0, costs.set), least)


def fewest_of(wanted: Wanted) -> int:
    """Least number of sets in each mounting, or in all of a given number of them."""
    return FIRST * (wanted.mountings or 1)


def _of_most_sets(way: RunOption, mountings: int, seconds: float) -> Allocation:
    """The plan of as many sets as a run has, in a time [s]; it dwells no longer than lowers the uncertainty."""
    sets = MOST_SETS // mountings * mountings
    longest = (seconds - way.costs.seconds(mountings, sets, 0.0)) / sets
    least = ROBUST * budget(way.lines, mountings, sets, longest).u
    dwell = way.shortest
    while (u := budget(way.lines, mountings, sets, dwell).u) > least:
        dwell = min(2 * dwell, longest)
    return Allocation(mountings, sets, dwell, way.costs.seconds(mountings, sets, dwell), u, {}, "")


def _planned(design: Design, found: ExpectedRatio, wanted: Wanted, load: float, cycles: int) -> _Planned:
    """The plan for one load, with a dwell of some cycles or more and as many sets in each mounting."""
    way = way_of(design, found, wanted, load, cycles)
    given, paid, least = tuple(way.lines), way.costs, way.shortest
    lines = lines_of(design, found, load, wanted, not wanted.relative, round(least * wanted.frequency))
    costs, plan = costs_of(load, wanted.frequency, wanted.mounts), None
    if wanted.tolerance is not None:
        plan = allocate(given, paid, wanted.tolerance, least, fewest_of(wanted))
    if plan is None or (wanted.time is not None and plan.seconds > wanted.time):
        assert wanted.time is not None
        plan = allocate_time(given, paid, wanted.time, least)
        if plan.sets > MOST_SETS:
            plan = _of_most_sets(way, wanted.mountings or plan.mountings, wanted.time)
        periods = math.floor(plan.dwell * wanted.frequency + 1e-9)
    else:
        periods = math.ceil(plan.dwell * wanted.frequency - 1e-9)
    dwell = max(least, periods / wanted.frequency)
    mountings = wanted.mountings or plan.mountings
    sets = mountings * max(1, math.ceil(plan.sets / mountings))
    total = budget(lines, mountings, sets, dwell)
    shares = {row["name"]: row["share"] for row in total.rows()}
    binds = max(shares, key=lambda name: shares[name])
    seconds = costs.seconds(mountings, sets, dwell)
    whole = Allocation(mountings, sets, dwell, seconds, total.u, shares, binds, total.degrees_of_freedom)
    return _Planned(load, whole, given, paid)
