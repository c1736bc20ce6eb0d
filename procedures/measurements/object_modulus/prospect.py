"""What the modulus of an object will cost: lines of uncertainty and bench times, before anything moves.

found = expected(question, 48e3)                      # ratio 0.27, sensitivity 2.0
lines = lines_of(design, found, load=3.0, mounted=None, absolute=False)
best_of(design, found, wanted, loads=(2.0, 3.0))      # the plan: load, mountings, sets, dwell
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from palpate.instrument.allocation.allocate import Allocation, allocate, allocate_time
from palpate.instrument.allocation.lines import Costs, Line, Unit, budget
from palpate.instrument.allocation.stopping import FIRST, first_sets
from palpate.instrument.allocation.times import Times, times
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import calibration_u, pickup_u
from palpate.instrument.findings.mean_ratio import CALIBRATION, NOISE, PICKUP, PRIOR_FREEDOM, SCATTER
from palpate.instrument.findings.modulus_of_ratio import MOST_SENSITIVE, modulus_of_ratio
from palpate.instrument.findings.object_modulus import ByReferences, estimate, validation_of
from palpate.instrument.models.corrected_curve import corrected
from palpate.instrument.models.curve import RatioCurve, ratio_curve
from palpate.instrument.models.ratio import Question
from palpate.instrument.models.validation_line import ValidationLine
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import expected_noise
from palpate.procedures.measurements.object_modulus.costs import costs_of, shortest

MOUNTED, CURVE, VALIDATION = "mounting scatter", "discretisation", "validation"
MOST = 5, 20  # times the planned sets, and sets besides: a run that needs more ends without its tolerance
MOST_SETS = 10_000  # of a run
ROBUST = 1.02  # what the plan with a greater load may cost over the cheapest one
BOUND_SETS = 3  # that tell a bound
EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1


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
    """

    tolerance: float | None
    time: float | None
    relative: bool
    frequency: float
    mountings: int | None
    mounted: float | None
    mounted_freedom: float = math.inf
    mounted_by: str = ""


@dataclass(frozen=True, slots=True)
class Expected:
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


def curve_of(question: Question, references: ByReferences | None = None) -> RatioCurve:
    """The curve of the question's model, corrected by references if there are some. Raises as `ratio_curve` does."""
    sensor = question.sensor()
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    return curve if references is None else corrected(curve, validation_of(question, curve.model, references).constant)


def sensitivity_at(curve: RatioCurve, ratio: float) -> float | None:
    """Relative change of the modulus over that of the ratio; None: the ratio is only good for a bound."""
    found = modulus_of_ratio(curve, [min(max(ratio, EDGE), 1 - EDGE)])
    slope = float(found.sensitivity[0])
    return slope if slope <= MOST_SENSITIVE and math.isfinite(found.modulus[0]) else None


def expected(question: Question, modulus: float, references: ByReferences | None = None) -> Expected:
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
    return Expected(ratio, sensitivity, row["curve_error"] / math.sqrt(3), line, row["model"], references)


def lines_of(design: Design, found: Expected, load: float, wanted: Wanted, absolute: bool) -> tuple[Line, ...]:
    """Lines of the modulus' uncertainty under a load [N, peak to peak]; `absolute`: with the validation error.

    A scatter of mountings that is not known has no line.
    """
    slope, ratio = found.sensitivity or MOST_SENSITIVE, found.ratio
    films, pickup = calibration_u(design), pickup_u(design) * math.hypot(1.0, 1 / ratio)
    lines = [
        Line(SCATTER, slope * design.ratio_scatter, Unit.SET, PRIOR_FREEDOM),
        Line(NOISE, slope * expected_noise(design, load, ratio), Unit.SECOND),
        Line(CURVE, slope * found.curve_u / ratio, Unit.NOTHING),
    ]
    if wanted.mounted:
        lines.append(Line(MOUNTED, slope * wanted.mounted, Unit.MOUNTING, wanted.mounted_freedom))
    if films and not (absolute and found.films_cancel):
        lines.append(Line(CALIBRATION, slope * films, Unit.NOTHING, design.film_freedom or math.inf))
    if pickup:
        lines.append(Line(PICKUP, slope * pickup, Unit.NOTHING))
    if absolute and found.validation.u is not None:
        validation = found.validation
        lines.append(Line(VALIDATION, slope * (validation.u or 0.0), Unit.NOTHING, validation.degrees_of_freedom))
    return tuple(lines)


@dataclass(frozen=True, slots=True)
class Prospect:
    """A plan of mountings, sets and dwell, with what it is expected to give.

    Attributes:
        load: load, peak to peak [N].
        found: what the model expects of the object.
        allocation: the plan; its `u` is that of the lines of the tolerance.
        scale_u, absolute_u: relative standard uncertainties that are expected; None: not known.
        times: bench times of such runs, on average and what 95 % of them do not pass [s]: how much sets scatter is
            known from few data.
    """

    load: float
    found: Expected
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
            "seconds": plan.seconds,
            "mean_s": self.times.mean,
            "longest_s": self.times.longest,
            "scale_u": self.scale_u,
            "absolute_u": self.absolute_u,
            "force_ratio": self.found.ratio,
            "sensitivity": self.found.sensitivity,
            "shares": plan.shares,
            "binds": plan.binds,
        }


def best_of(design: Design, found: Expected, wanted: Wanted, loads: Sequence[float]) -> Prospect:
    """The quickest plan for a tolerance, or the most accurate one in a time; with both, not longer than the time.

    Of the loads, the greatest is taken whose plan costs little more than the best one: what no plan knows, such as
    more noise than usual, disturbs a greater load less.

    Raises:
        BelowFloor: no time on the bench reaches the tolerance.
        RangeError: not one set fits into the time.
    """
    plans, refused = [], []
    for load in loads:
        try:
            plans.append(_planned(design, found, wanted, load))
        except RangeError as error:  # a greater load takes longer to press: a time may hold a smaller one alone
            refused.append(error)

    def price(each: _Planned) -> float:
        return each.plan.u if wanted.tolerance is None else each.plan.seconds

    if not plans:
        raise refused[0]
    least = min(map(price, plans))
    best = max((each for each in plans if price(each) <= ROBUST * least), key=lambda each: each.load)
    plan = best.plan
    scale, whole = (
        budget(lines_of(design, found, best.load, wanted, both), plan.mountings, plan.sets, plan.dwell).u
        for both in (False, True)
    )
    absolute = None if found.validation.u is None else whole
    return Prospect(best.load, found, plan, scale, absolute, _times(best, wanted))


def for_bound(found: Expected, wanted: Wanted, load: float) -> Prospect:
    """The plan for an object of which a model expects no more than a bound: a few sets tell it."""
    costs, dwell, mountings = costs_of(load, wanted.frequency), shortest(wanted.frequency), wanted.mountings or 1
    sets = BOUND_SETS * mountings
    seconds = costs.seconds(mountings, sets, dwell)
    plan = Allocation(mountings, sets, dwell, seconds, math.inf, {}, "")
    return Prospect(load, found, plan, None, None, Times(seconds, seconds))


def most_sets(plan: Allocation, wanted: Wanted) -> int:
    """Number of sets with which a run ends in any case."""
    return min((MOST[0] if wanted.tolerance is not None else 1) * plan.sets + MOST[1], MOST_SETS)


@dataclass(frozen=True, slots=True)
class _Planned:
    """The plan for one load [N, peak to peak], and the lines and costs from which it was made."""

    load: float
    plan: Allocation
    lines: tuple[Line, ...]
    costs: Costs


def _times(planned: _Planned, wanted: Wanted) -> Times:
    """Bench times of the runs of a plan."""
    plan = planned.plan
    if wanted.tolerance is None or plan.u > wanted.tolerance:  # the time ends them
        return Times(plan.seconds, plan.seconds if wanted.time is None else wanted.time)
    sets = first_sets(plan) * (wanted.mountings or 1), most_sets(plan, wanted)  # given mountings are paid at the start
    found = times(planned.lines, planned.costs, wanted.tolerance, plan, sets)
    most = math.inf if wanted.time is None else wanted.time
    return Times(min(most, found.mean), min(most, max(plan.seconds, found.longest)))


def _planned(design: Design, found: Expected, wanted: Wanted, load: float) -> _Planned:
    """The plan for one load, with a dwell of whole periods and as many sets in each mounting."""
    lines, costs = lines_of(design, found, load, wanted, not wanted.relative), costs_of(load, wanted.frequency)
    given, paid, fewest = lines, costs, FIRST
    if wanted.mountings is not None:  # they are paid whatever the sets are, and lower their own line once
        given = tuple(
            replace(line, u=line.u / math.sqrt(wanted.mountings), per=Unit.NOTHING)
            if line.per is Unit.MOUNTING
            else line
            for line in lines
        )
        paid = Costs(costs.start + wanted.mountings * costs.mounting, 0.0, costs.set)
        fewest = FIRST * wanted.mountings
    least = shortest(wanted.frequency)
    plan = None if wanted.tolerance is None else allocate(given, paid, wanted.tolerance, least, fewest)
    if plan is None or (wanted.time is not None and plan.seconds > wanted.time):
        assert wanted.time is not None
        plan = allocate_time(given, paid, wanted.time, least)
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
