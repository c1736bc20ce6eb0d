"""The plan for the modulus of an object: the best load, mountings, load sets and dwell, before anything moves.

best_of(design, found, wanted, loads=(2.0, 3.0)).allocation
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.instrument.allocation.allocate import Allocation, allocate, allocate_time
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.purchase import RunOption
from palpate.instrument.allocation.stopping import FIRST, first_sets
from palpate.instrument.allocation.times import Times, times
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.findings.mean_ratio import CALIBRATION, NOISE, PICKUP, PRIOR_FREEDOM, SCATTER
from palpate.instrument.findings.object_modulus import (
    MOST_SENSITIVE,
    ByReferences,
    estimate,
    modulus_of_ratio,
    validation_of,
)
from palpate.instrument.models.curve import RatioCurve, corrected, ratio_curve
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.sine_columns import sine_columns
from palpate.procedures.engine.plan import expected_noise
from palpate.procedures.lab.lab import BY_HAND, Mounts
from palpate.procedures.measurements import prospects as repeated_sets
from palpate.procedures.measurements.prospects import MOST_SETS
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import SAMPLES_PER_CYCLE, settling_length
from palpate.procedures.steps.servo import READING_INTERVAL, READINGS, RELEASED, window

# --- Bench times of the measurement of a modulus: a mounting, a set, the beginning and the end ---------

ZERO = 1.2  # s, the load cell's zero at the start [M]
END, END_PER_NEWTON = 4.7, 0.6  # s, and s/N of the load: the probe home and the zero again at the end [M]
FIRST_TOUCH, PER_NEWTON = 3.7, 2.2  # s, and s/N of the preload: the quick approach [M]
WITHDRAWAL = 2.1  # s, before each mounting but the first [M]
SERVO_STEPS = 4  # to the load, after each mounting [M]


def costs_of(load: float, frequency: float, mounts: Mounts = BY_HAND) -> Costs:
    """Bench times of the measurement under a load [N, peak to peak] of a frequency [Hz].

    Each mounting is one of an object that lies there already; the first one, where none does, may be quicker.
    """
    reading = (READINGS - 1) * READING_INTERVAL
    servo = SERVO_STEPS * (window(frequency) + READING_INTERVAL + reading) + reading
    approach = FIRST_TOUCH + PER_NEWTON * preload_for((load,))
    again = RELEASED / frequency + 2 * settling_length(frequency, shortest(frequency))
    mounting = mounts.again + approach + servo + WITHDRAWAL
    start = ZERO + end_seconds(load) - WITHDRAWAL - (mounts.again - mounts.seconds)
    return Costs(max(start, 0.0), mounting, again, mounts.person)


def end_seconds(load: float) -> float:
    """Bench time of the end of the measurement under a load [N, peak to peak] [s]."""
    return END + END_PER_NEWTON * load


def shortest(frequency: float) -> float:
    """Least dwell of a set [s]: whole periods of a frequency [Hz], and not below 0.1 s."""
    return max(1.0, math.ceil(0.1 * frequency - 1e-9)) / frequency


# -------------------------------------------------------------------------------------------------------
# What is wanted of an object's modulus, what a model expects of it, and the lines of its uncertainty
#
# found = expected(question, 48e3)                      # ratio 0.27, sensitivity 2.0 lines_of(design, found, 3.0,
# wanted, absolute=False)  # under a load of 3 N

MOUNTED, CURVE, VALIDATION = "mounting scatter", "discretisation", "validation"
EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1
USUAL = 10.0  # Hz
LONG = 20  # cycles, from which on trend and hum cost nothing of a dwell


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is asked for.

    Attributes:
        tolerance: relative standard uncertainty of the modulus; None: as good as the time allows.
        time: bench time [s]; None: as long as the tolerance takes.
        relative: whether the tolerance is about the model's scale, without the validation error.
        frequency: frequency of the load [Hz].
        mountings: number of mountings; None: as many as pay.
        mounted: relative standard deviation of the ratio from mounting to mounting; None: not known.
        mounted_freedom: its degrees of freedom; infinite where it is stated.
        mounted_by: where it comes from, for people; empty: it is stated, or not known.
        mounts: who mounts the object, and how long that takes.
        sample: name of the object, if it is one of the rubber samples; empty: it is none.
    """

    tolerance: float | None
    time: float | None
    relative: bool
    frequency: float
    mountings: int | None
    mounted: float | None
    mounted_freedom: float = math.inf
    mounted_by: str = ""
    mounts: Mounts = BY_HAND
    sample: str = ""


@dataclass(frozen=True, slots=True)
class ExpectedRatio:
    """What a model expects of an object.

    Attributes:
        ratio: force ratio.
        sensitivity: relative change of the modulus over that of the ratio; None: the ratio says too little of it.
        curve_u: standard uncertainty of the ratio by the model's discretisation.
        validation: the model's validation error.
        model: name of the model that answers.
        references: the model's calibration by references; None: there is none.
    """

    ratio: float
    sensitivity: float | None
    curve_u: float
    validation: ValidationLine
    model: str
    references: ByReferences | None = None

    @property
    def films_cancel(self) -> bool:
        """Whether the error of the films' calibration cancels in the absolute modulus, because references share it."""
        return self.references is not None and self.references.same_films


def curve_of(question: RatioQuestion, references: ByReferences | None = None) -> RatioCurve:
    """The curve of the question's model, corrected by references if there are some. Raises as `ratio_curve` does."""
    sensor = question.sensor()
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    return curve if references is None else corrected(curve, validation_of(question, curve.model, references).constant)


def sensitivity_at(curve: RatioCurve, ratio: float) -> float | None:
    """Relative change of the modulus over that of the ratio; None: the ratio is only good for a bound."""
    found = modulus_of_ratio(curve, [min(max(ratio, EDGE), 1 - EDGE)])
    slope = float(found.sensitivity[0])
    return slope if slope <= MOST_SENSITIVE and math.isfinite(found.modulus[0]) else None


def expected(question: RatioQuestion, modulus: float, references: ByReferences | None = None) -> ExpectedRatio:
    """What the question's model expects of an object of a Young modulus [Pa].

    Raises:
        RangeError: the model does not answer for this sensor. EstimateError: a system cannot be solved accurately.
    """
    curve = curve_of(question, references)
    low, high = curve.moduli
    ratio = float(curve.force_ratio([min(max(modulus, low), high)])[0])
    ratio = min(max(ratio, EDGE), 1 - EDGE)
    (row,) = estimate(question, [ratio], EDGE, references=references)
    sensitivity = sensitivity_at(curve, ratio) if low <= modulus <= high else None
    line = validation_of(question, row["model"], references)
    return ExpectedRatio(ratio, sensitivity, row["curve_error"] / math.sqrt(3), line, row["model"], references)


def lines_of(
    design: Design, found: ExpectedRatio, load: float, wanted: Wanted, absolute: bool, cycles: int = LONG
) -> tuple[BudgetLine, ...]:
    """Lines of the modulus' uncertainty. A scatter of mountings that is not known has no line.

    Args:
        design: the sensor.
        found: what the model expects of the object.
        load: load, peak to peak [N].
        wanted: what is asked for.
        absolute: whether the validation error counts.
        cycles: number of cycles of the load in a dwell.
    """
    slope, ratio = found.sensitivity or MOST_SENSITIVE, found.ratio
    films, pickup = calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio)
    noise = expected_noise(design, load, ratio) * cost_of_trend(min(cycles, LONG))
    lines = [
        BudgetLine(SCATTER, slope * design.ratio_scatter, RepeatUnit.SET, PRIOR_FREEDOM),
        BudgetLine(NOISE, slope * noise, RepeatUnit.SECOND),
        BudgetLine(CURVE, slope * found.curve_u / ratio, RepeatUnit.NOTHING),
    ]
    if wanted.mounted:
        lines.append(BudgetLine(MOUNTED, slope * wanted.mounted, RepeatUnit.MOUNTING, wanted.mounted_freedom))
    if films and not (absolute and found.films_cancel):
        lines.append(BudgetLine(CALIBRATION, slope * films, RepeatUnit.NOTHING, design.film_freedom or math.inf))
    if pickup:
        lines.append(BudgetLine(PICKUP, slope * pickup, RepeatUnit.NOTHING))
    if absolute and found.validation.u is not None:
        validation = found.validation
        lines.append(
            BudgetLine(VALIDATION, slope * (validation.u or 0.0), RepeatUnit.NOTHING, validation.degrees_of_freedom)
        )
    return tuple(lines)


@functools.cache
def cost_of_trend(cycles: int) -> float:
    """Noise of an amplitude that is fitted to some cycles, over that which falls with the square root of their number.

    Trend and hum are fitted, too, and one cycle alone hardly tells them from the drive.
    """
    weights = sine_columns(np.arange(cycles * SAMPLES_PER_CYCLE) / SAMPLES_PER_CYCLE / USUAL, USUAL).weights()
    return float(np.linalg.norm(weights)) * math.sqrt(cycles * SAMPLES_PER_CYCLE) / 2


# --- the prospect --------------------------------------------------------------------------------------

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
