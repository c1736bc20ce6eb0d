"""The plan for the modulus of an object: the best load, mountings, load sets and dwell, or why there is none.

    ModulusPlans(question, expected(question, 48e3), wanted, target, loads=(2.0, 3.0, 4.0)).prospect().allocation

All plans are rows of one table (`instrument.allocation.table`): what is planned, offered beside it and refused is
looked up there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.preparations import Preparation, prepared
from palpate.instrument.allocation.repeated import MOST
from palpate.instrument.allocation.stopping import RunTimes, run_times
from palpate.instrument.allocation.table import (
    MOST_MOUNTINGS,
    MOST_SETS,
    ROUNDING,
    Allocation,
    OutOfReach,
    RunOption,
    Table,
    dwells,
    half_of,
)
from palpate.instrument.calibration.films import FEWEST
from palpate.instrument.errors import PalpateError, RangeError
from palpate.instrument.findings.film_forces import (
    CALIBRATION,
    NOISE,
    PICKUP,
    PRIOR_FREEDOM,
    SCATTER,
    calibration_u,
    pickup_u,
)
from palpate.instrument.findings.object_modulus import (
    MOST_SENSITIVE,
    ByReferences,
    answering,
    estimate,
    modulus_of_ratio,
    validation_of,
)
from palpate.instrument.models.curve import RatioCurve, corrected, ratio_curve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine, validate
from palpate.instrument.quantity import LARGEST_TOLERANCE, as_asked, as_typed, counted, plus_minus, rounded_up, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.estimate import sine_columns
from palpate.instrument.uncertainty.budget import COVERAGE, Between, coverage_factor
from palpate.procedures.engine.plan import APPROACH, expected_noise, point_seconds
from palpate.procedures.lab.lab import BY_HAND, MOUNTING, Mounts, Target
from palpate.procedures.measurements.prospects import share
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.checks import check_frequency, preload_for
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
# found = expected(question, 48e3)                              # ratio 0.27, sensitivity 2.0
# lines_of(design, found, 3.0, wanted, absolute=False)          # under a load of 3 N

LEAST_SHARE = 0.005  # of the variance; a smaller one is not told
MOUNTED, CURVE, VALIDATION = "mounting scatter", "discretisation", "validation"
EDGE = 1e-9  # distance that an expected ratio keeps from 0 and 1
USUAL = 10.0  # Hz
LONG = 20  # cycles, from which on trend and hum cost nothing of a dwell


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is asked for.

    Attributes:
        tolerance: half-width of the 95 % interval of the modulus, relative; None: as good as the time allows.
        time: bench time [s]; None: as long as the tolerance takes.
        relative: whether the tolerance is about the model's scale, without the validation error.
        frequency: frequency of the load [Hz].
        mountings: number of mountings; None: as many as pay.
        mounted: relative standard deviation of the ratio from mounting to mounting.
        mounted_freedom: its degrees of freedom; infinite where it is known exactly.
        mounted_by: where it comes from, for people.
        mounts: who mounts the object, and how long that takes.
        sample: name of the object, if it is one of the rubber samples; empty: it is none.
    """

    tolerance: float | None
    time: float | None
    relative: bool
    frequency: float
    mountings: int | None
    mounted: float
    mounted_freedom: float
    mounted_by: str
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
    """Lines of the modulus' uncertainty.

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

BOUND_SETS = 3  # that tell a bound


@dataclass(frozen=True, slots=True)
class Prospect:
    """A plan of mountings, sets and dwell, with what it is expected to give.

    Attributes:
        found: what the model expects of the object.
        allocation: the plan; its `u` and `half` are those of the lines of the tolerance.
        scale, absolute: half-widths of the 95 % interval that are expected, on the model's scale and absolute; None:
            not known.
        scale_u, absolute_u: the relative standard uncertainties.
        times: bench times of such runs, on average and at most [s]: how much sets and mountings scatter is known from
            few data, and a run ends at the time that 95 % of them need at most.
    """

    found: ExpectedRatio
    allocation: Allocation
    scale: float | None
    absolute: float | None
    scale_u: float | None
    absolute_u: float | None
    times: RunTimes

    def summary(self) -> dict[str, Any]:
        """The plan under the names of JSON."""
        plan = self.allocation
        return {
            "load_N": plan.load,
            "mountings": plan.mountings,
            "sets": plan.sets,
            "dwell_s": plan.dwell,
            "seconds": self.times.mean,
            "as_known_s": plan.seconds,
            "longest_s": self.times.longest,
            "scale_U95": self.scale,
            "absolute_U95": self.absolute,
            "scale_u": self.scale_u,
            "absolute_u": self.absolute_u,
            "force_ratio": self.found.ratio,
            "sensitivity": self.found.sensitivity,
            "shares": plan.shares,
            "binds": plan.binds,
        }


def has_most_sets(plan: Allocation) -> bool:
    """Whether a run has no more load sets than those of a plan."""
    return plan.sets + plan.mountings > MOST_SETS


def most_sets(prospect: Prospect, wanted: Wanted) -> int:
    """Number of sets with which a run ends in any case."""
    plan = prospect.allocation
    if wanted.tolerance is None:
        return min(plan.sets + MOST[1], MOST_SETS)
    costs, each = costs_of(plan.load, wanted.frequency, wanted.mounts), plan.sets // plan.mountings
    of_mounting = costs.mounting + each * (costs.set + plan.dwell)
    in_time = each * math.ceil(prospect.times.longest / of_mounting) + MOST[1]
    return min(max(MOST[0] * plan.sets + MOST[1], in_time), MOST_SETS)


# --- What is not done by the run itself, with its price ------------------------------------------------
#
# Calibrations of films and model are sessions of their own, as a person stands a pin on the teeth or mounts references,
# and as what they store holds for all later runs.

COMPRESSION = 272.0  # s, of the test that tells the modulus of a reference [M]
REFERENCE = 400.0  # s, with that test and the mounting on the sensor [M]
REFERENCE_U = 0.02  # relative standard uncertainty of the modulus of a reference [A]
REFERENCE_SETS = 6  # load sets of each in palpate calibrate model
REFERENCES = 6  # as many as pay
REFERENCE_OPTION = "--reference 'A: 48 kPa ± 4 %'"  # one for each
FILM_DWELL = 1.0  # s, in palpate calibrate films
FILM_LOADS = 1.5, 4.0  # N, least and greatest of palpate calibrate films
USUAL_POINTS = 6  # on each tooth, of palpate calibrate films
FREQUENCIES = (20.0, 40.0)  # Hz
NEVER_MEASURED = "scatter was never measured"
SCATTER_MOUNTINGS, SCATTER_TOLERANCE = 12, 0.1  # of the run that measures it
MEASURE_MOUNTINGS = f"--mountings {SCATTER_MOUNTINGS} --tolerance '10 %' --relative-to-model"
PAYS, PAYS_ONCE = 0.98, 0.8  # of the bench time or half-width: what saves less, or costs a run before, is not offered
UNITS = {VALIDATION: "reference", CALIBRATION: "film point"}
LEAST_BY_COMPRESSION = 0.04
REMEDIES = {
    CALIBRATION: "calibrate the films at more points: palpate calibrate films",
    PICKUP: "tie the films' cables down, and give the smaller pick-up in the bench file",
    CURVE: "ask a finer model, such as --model auto",
}


def command_of(name: str, number: int) -> str:
    """The command of a preparation, with as many references as are named after it, or film points on each tooth."""
    if name == VALIDATION:
        return f"palpate calibrate model {REFERENCE_OPTION}"
    least, greatest = FILM_LOADS
    step = math.floor((greatest - least) / (number - 1) * 1e4) / 1e4  # rounded down: all points are taken
    return f"palpate calibrate films --loads '{least:g} N:{greatest:g} N:{step:g} N'"


@dataclass(frozen=True, slots=True)
class Alternative:
    """Something that a run does not do by itself.

    Attributes:
        what: "references", "films", "mountings", "frequency", or "quickest": all that makes the whole quickest.
        numbers: how many references, points on each tooth, mountings, or hertz; by name.
        once_s: bench time of it, once, for all later runs [s].
        person_s: the part of it that a person takes [s].
        run_s: mean bench time of the run then [s].
        U95: half-width of the 95 % interval of the modulus then, relative; None: it stays as it is.
        how: what to ask for.
        told: in a sentence, for people.
    """

    what: str
    numbers: dict[str, float]
    once_s: float
    person_s: float
    run_s: float
    U95: float | None
    how: str
    told: str

    def summary(self) -> dict[str, Any]:
        """The alternative for JSON."""
        return asdict(self)


def worth_lines(offered: Sequence[Alternative]) -> list[str]:
    """Alternatives for people, two lines each."""
    return [line for each in offered for line in (f"{each.what:<14} {each.told}", f"{'':<14} {each.how}")]


# --- the plans -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ModulusPlans:
    """All plans for what is wanted of one object on one bench.

    Attributes:
        question: the model that turns the ratio into the modulus.
        found: what it expects of the object.
        wanted: what is asked for.
        target: the bench, with its calibrated films.
        loads: loads among which a plan chooses [N, peak to peak].
    """

    question: RatioQuestion
    found: ExpectedRatio
    wanted: Wanted
    target: Target
    loads: Sequence[float]

    @property
    def design(self) -> Design:
        """The sensor."""
        return self.target.design

    def asking(self, **changes: Any) -> ModulusPlans:
        """The plans for something else that is wanted."""
        return replace(self, wanted=replace(self.wanted, **changes))

    def prospect(self) -> Prospect:
        """The quickest plan for the tolerance, or the most accurate one in the time, or one for a bound.

        Raises RangeError: no plan reaches the tolerance, or fits into the time.
        """
        if self.found.sensitivity is None:
            return self._for_bound()
        if self.wanted.tolerance is not None and self.found.validation.u is None and not self.wanted.relative:
            raise self._not_known()
        try:
            return self.best()
        except OutOfReach as error:
            raise self.refused(error) from None

    @cached_property
    def table(self) -> Table:
        """All plans for a tolerance: loads, dwells, mountings and sets."""
        return self._table(by_time=False)

    def _table(self, *, by_time: bool) -> Table:
        wanted, ways = self.wanted, []
        for load in self.loads:
            for dwell in dwells(self._lines(load), shortest(wanted.frequency)):
                costs = costs_of(load, wanted.frequency, wanted.mounts)
                ways.append(RunOption(self._lines(load, dwell), costs, dwell, load))
        mountings = range(1, MOST_MOUNTINGS + 1) if wanted.mounted else (1,)
        return Table.of(ways, mountings if wanted.mountings is None else (wanted.mountings,), by_time=by_time)

    def _lines(self, load: float, dwell: float = math.inf) -> tuple[BudgetLine, ...]:
        """Lines of what is wanted under a load [N], with a dwell [s]."""
        wanted = self.wanted
        cycles = round(min(dwell * wanted.frequency, LONG))
        return lines_of(self.design, self.found, load, wanted, not wanted.relative, cycles)

    def best(self) -> Prospect:
        """The quickest plan for the tolerance, or the most accurate one in the time; with both, within the time.

        Raises:
            OutOfReach: no plan reaches the tolerance.
            RangeError: no plan fits into the time.
        """
        plan, wanted = None, self.wanted
        if wanted.tolerance is not None:
            plan = self.table.for_tolerance(wanted.tolerance)
        if plan is None or (wanted.time is not None and plan.seconds > wanted.time):
            assert wanted.time is not None
            plan = self._table(by_time=True).for_time(wanted.time)
        return self.by(plan, wanted.tolerance)

    def by(self, plan: Allocation, tolerance: float | None) -> Prospect:
        """What is expected of a plan of the table for a tolerance; None: the time alone is given."""
        wanted, found, by_time = self.wanted, self.found, tolerance is None
        cycles = round(plan.dwell * wanted.frequency)
        both = [lines_of(self.design, found, plan.load, wanted, absolute, cycles) for absolute in (False, True)]
        scale, whole = (half_of(each, plan, by_time=by_time) for each in both)
        scale_u, whole_u = (budget(each, plan.mountings, plan.sets, plan.dwell).u for each in both)
        if tolerance is None or plan.half > tolerance * (1 + ROUNDING):  # the time ends the run
            times = RunTimes(plan.seconds, plan.seconds if wanted.time is None else wanted.time, plan.mountings)
        else:
            costs = costs_of(plan.load, wanted.frequency, wanted.mounts)
            times = run_times(both[not wanted.relative], costs, tolerance, plan, MOST_SETS, wanted.time)
        absolute, absolute_u = (None, None) if found.validation.u is None else (whole, whole_u)
        return Prospect(found, plan, scale, absolute, scale_u, absolute_u, times)

    def _for_bound(self) -> Prospect:
        """The plan for an object of which the model expects no more than a bound: a few sets tell it."""
        wanted, load = self.wanted, self.loads[0]
        costs, dwell = costs_of(load, wanted.frequency, wanted.mounts), shortest(wanted.frequency)
        mountings = wanted.mountings or 1
        sets = BOUND_SETS * mountings
        seconds = costs.seconds(mountings, sets, dwell)
        plan = Allocation(mountings, sets, dwell, seconds, math.inf, math.inf, {}, "", seconds, load)
        return Prospect(self.found, plan, None, None, None, None, RunTimes(seconds, seconds, mountings))

    # --- what is calibrated before a run ---------------------------------------------------------------

    @cached_property
    def _more_references(self) -> Preparation | None:
        """References of the model, with those that there are; None: nothing tells how objects spread."""
        slope, made_before = self.found.sensitivity, self.found.references
        if slope is None:
            return None
        if made_before is not None:
            made, calibration = len(made_before.calibration.references), made_before.calibration
            one, more = calibration.with_more(1), calibration.with_more(10**9)
            if one is None or more is None or one.u is None or more.u is None:
                return None
            u = slope * math.sqrt(max(one.u**2 - more.u**2, 0.0))
            freedom = one.degrees_of_freedom
            return Preparation(VALIDATION, u, -COMPRESSION * made, REFERENCE, made + 1, slope * more.u, freedom)
        try:
            validation = validate(self.question.design, self.question.parameters, self.found.model)
        except PalpateError:  # the thesis' samples do not tell of this model
            return None
        if validation.ln_spread is None:
            return None
        own, spread = slope * self.design.ratio_scatter / math.sqrt(REFERENCE_SETS), slope * validation.ln_spread
        freedom = len(validation.percent) - 1.0
        return Preparation(VALIDATION, math.hypot(spread, REFERENCE_U, own), 0.0, REFERENCE, 1, spread, freedom)

    def _film_points(self) -> Preparation:
        """A calibration of the films, by points on each tooth."""
        design = self.design
        shared = np.array([[len({*a.teeth} & {*b.teeth}) for b in design.films] for a in design.films])
        count = np.array([len(film.teeth) for film in design.films])
        covariance = np.asarray(design.scatter_covariance) * shared / np.outer(count, count)
        u = calibration_u(replace(design, film_covariance=tuple(map(tuple, covariance.tolist()))))
        teeth, point = len(design.teeth), point_seconds(self.wanted.frequency, FILM_DWELL, first=False)
        slope = self.found.sensitivity or MOST_SENSITIVE
        return Preparation(CALIBRATION, slope * u, teeth * (MOUNTING + APPROACH), teeth * point, FEWEST)

    def _person(self, name: str, number: int) -> float:
        """Time of a person for so many references, or points on each tooth [s]."""
        return MOUNTING * (number if name == VALIDATION else len(self.design.teeth))

    def quickest(self) -> Alternative | None:
        """The preparations that make the whole quickest.

        None: there are none, nothing reaches the tolerance, or a time alone is given.
        """
        wanted, found, made = self.wanted, self.found, []
        if wanted.tolerance is None or found.sensitivity is None:
            return None
        if self.design.film_covariance is not None and not (found.films_cancel and not wanted.relative):
            made.append(self._film_points())
        if not wanted.relative and (references := self._more_references) is not None:
            made.append(references)
        best = prepared(self.table, wanted.tolerance, made)
        if best is None or not best.numbers:
            return None
        person = math.fsum(self._person(name, number) for name, number in best.numbers.items())
        what = " and ".join(counted(number, UNITS[name]) for name, number in best.numbers.items())
        gives = f"{what} ({duration(best.once)}, once), then {duration(best.run.mean)}"
        how = "; ".join(command_of(name, number) for name, number in best.numbers.items())
        numbers = {name: float(number) for name, number in best.numbers.items()}
        return Alternative("quickest", numbers, best.once, person, best.run.mean, None, how, gives)

    def references_that_pay(self) -> Alternative | None:
        """What as many references as pay would leave of the model's error; None: not known."""
        if (made := self._more_references) is None:
            return None
        count = max(REFERENCES, made.least)
        line = made.line(count)
        half = line.u * coverage_factor(line.degrees_of_freedom)
        gives = f"{plus_minus(half)} with {count} references ({duration(made.seconds(count))}, once)"
        return self._made("references", made, count, half, math.nan, gives)

    def _made(self, what: str, made: Preparation, count: int, half: float, run: float, gives: str) -> Alternative:
        """So many units of a preparation, with the half-width and the mean bench time of the run then."""
        numbers, person, how = {made.name: float(count)}, self._person(made.name, count), command_of(made.name, count)
        return Alternative(what, numbers, made.seconds(count), person, run, half, how, gives)

    # --- what else pays --------------------------------------------------------------------------------

    def alternatives(self, prospect: Prospect) -> list[Alternative]:
        """What else pays beside a plan, first what makes it quicker; nothing, where only a bound is expected."""
        if self.found.sensitivity is None:
            return []
        found = [
            self.quickest(),
            self._measured_mountings(prospect),
            self._frequency(prospect),
            self._references(prospect),
            self._films(prospect),
        ]
        return [each for each in found if each is not None]

    def _references(self, prospect: Prospect) -> Alternative | None:
        """One more reference."""
        more = self._more_references
        if more is None or self.wanted.relative or VALIDATION not in prospect.allocation.shares:
            return None
        half = self._with(prospect, more.line(more.least))
        count = "one" if more.least == 1 else f"{more.least} in all"
        gives = f"{count} would give {plus_minus(half)}; {duration(more.seconds(more.least))}, once"
        return self._made("references", more, more.least, half, prospect.times.mean, gives)

    def _films(self, prospect: Prospect) -> Alternative | None:
        """Films calibrated at twice as many points; where they are not calibrated, what that would add."""
        plan, films, points = prospect.allocation, self._film_points(), USUAL_POINTS
        calibrated = self.design.film_covariance is not None
        if not calibrated and self.found.references is not None:  # these hold the films' error
            return None
        if calibrated:
            if plan.shares.get(CALIBRATION, 0.0) < LEAST_SHARE:
                return None
            points = max(films.least, math.ceil(2 * films.u**2 / (plan.shares[CALIBRATION] * plan.u**2)))
        half, seconds = self._with(prospect, films.line(points)), duration(films.seconds(points))
        gives = f"{points} points would give {plus_minus(half)}; {seconds}, once"
        if not calibrated:
            gives = (
                f"not calibrated: {plus_minus(plan.half)} leaves their error out; with {points} points ({seconds},"
                f" once) it counts: {plus_minus(half)}"
            )
        return self._made("films", films, points, half, prospect.times.mean, gives)

    def _with(self, prospect: Prospect, line: BudgetLine) -> float:
        """Half-width of a plan with a line in place of the one of its name, or beside the others."""
        plan = prospect.allocation
        kept = [each for each in self._lines(plan.load, plan.dwell) if each.name != line.name]
        return half_of([*kept, line], plan, by_time=self.wanted.tolerance is None)

    def _measured_mountings(self, prospect: Prospect) -> Alternative | None:
        """The scatter of mountings measured once, where it never was and this pays."""
        if not self.wanted.mounted_by.startswith(NEVER_MEASURED) or self.wanted.mountings is not None:
            return None
        once = self.asking(tolerance=SCATTER_TOLERANCE, time=None, relative=True, mountings=SCATTER_MOUNTINGS)
        try:
            first, then = once.best(), self.asking(mounted_freedom=SCATTER_MOUNTINGS - 1.0).best()
        except RangeError:
            return None
        if self._gain(prospect, then) > PAYS_ONCE:
            return None
        seconds, count = first.times.mean, SCATTER_MOUNTINGS
        gives = f"once {count} have told their scatter ({duration(seconds)}), a run would {self._gives(then)}"
        numbers, half = {MOUNTED: float(count)}, then.allocation.half
        person = self.wanted.mounts.person * first.times.mountings
        return Alternative("mountings", numbers, seconds, person, then.times.mean, half, MEASURE_MOUNTINGS, gives)

    def _frequency(self, prospect: Prospect) -> Alternative | None:
        """Another frequency, where the bench can have it and it pays; the modulus is then the one at that frequency."""
        best, least = None, PAYS
        for frequency in FREQUENCIES:
            try:
                check_frequency(frequency, self.target)
                other = self.asking(frequency=frequency).best()
            except PalpateError:
                continue
            if (gain := self._gain(prospect, other)) < least:
                best, least = (frequency, other), gain
        if best is None:
            return None
        frequency, other = best
        gives = f"{show(frequency, 'Hz')} would {self._gives(other)}, for the modulus at that frequency"
        numbers, how = {"frequency_Hz": frequency}, f"--frequency '{show(frequency, 'Hz')}'"
        return Alternative("frequency", numbers, 0.0, 0.0, other.times.mean, other.allocation.half, how, gives)

    def _gain(self, prospect: Prospect, other: Prospect) -> float:
        """Bench time of another plan over that of this one; the half-width, where a time is given."""
        if self.wanted.tolerance is None:
            return other.allocation.half / prospect.allocation.half
        return other.times.mean / prospect.times.mean

    def _gives(self, other: Prospect) -> str:
        """What another plan gives, where a time is given, or takes."""
        if self.wanted.tolerance is None:
            return f"give {plus_minus(other.allocation.half)}"
        return f"take {duration(other.times.mean)}"

    # --- a tolerance that cannot be reached: what binds, the best there is, and other ways there --------

    def refused(self, error: OutOfReach) -> RangeError:
        """The refusal of a tolerance that no plan reaches."""
        wanted, found, tolerance = self.wanted, self.found, self.wanted.tolerance or 0.0
        why = error.why
        if error.binds == VALIDATION and error.floor >= tolerance:
            why = f"the model binds: {why} ({found.validation.source})"
        best = plus_minus(error.best)
        if error.best < LARGEST_TOLERANCE:
            least = rounded_up(error.best)
            best, times = f"--tolerance '{share(least)}'", self.by(self.table.for_tolerance(least), least).times
            if not times.kept:
                best += f", which {share(times.enough)} of runs reach: a run has {MOST_SETS:,} load sets at most"
        ways, way = [], self.quickest()
        if way is not None and (wanted.time is None or way.run_s <= wanted.time):
            ways = [f"or        as asked with {way.told}: {way.how}"]
        elif error.binds == VALIDATION:
            made = self.references_that_pay()
            ways = [] if made is None else [f"or        {made.told}: {made.how}"]
        elif error.binds == MOUNTED and wanted.mountings is not None:
            ways = ["or        leave the number of mountings to the plan, without --mountings"]
        elif error.binds == MOUNTED and wanted.mounted_by.startswith(NEVER_MEASURED):
            ways = [f"or        measure how mountings scatter, once: {MEASURE_MOUNTINGS}"]
        elif remedy := self.remedy(error.binds):
            ways = [f"or        {remedy}"]
        if tolerance >= LEAST_BY_COMPRESSION or error.binds == VALIDATION:
            ways.append(self._by_compression())
        if error.binds == VALIDATION:
            ways += self._on_scale()
        absolute = "" if wanted.relative else " absolute"
        head = f"--tolerance {as_asked(tolerance, 3)[2:]}{absolute} cannot be reached: {why}"
        return RangeError("\n  ".join([head, f"best now  {best}", *ways]))

    def remedy(self, binds: str) -> str:
        """What else lowers a line; empty: nothing is known, as of the error of the finest model."""
        if binds == CURVE and self.found.model == answering(replace(self.question, model="auto")):
            return ""
        return REMEDIES.get(binds, "")

    def _not_known(self) -> RangeError:
        """The refusal of an absolute tolerance where the model's validation error is not known."""
        head = (
            f"--tolerance {share(self.wanted.tolerance or 0.0, 3)} absolute cannot be promised: the validation error of"
            f" {self.found.model!r} is {self.found.validation.source}"
        )
        return RangeError("\n  ".join([head, self._by_compression(), *self._on_scale()]))

    def _by_compression(self) -> str:
        """The compression test of this bench [M]; of an object that is no rubber sample, by one of its size."""
        sample = f"--sample {self.wanted.sample}" if self.wanted.sample else "with --sample for one of its size"
        return f"or        ± 4 to 8 % in {COMPRESSION:.0f} s, where it can be taken off: palpate test modulus {sample}"

    def _on_scale(self) -> list[str]:
        """What the tolerance costs on the model's scale; empty: it is not reached there either."""
        try:
            plan = self.asking(time=None, relative=True).best()
        except RangeError:
            return []
        asked = f"{share(self.wanted.tolerance or 0.0, 3)} on the scale of {self.found.model!r}"
        return [f"or        {asked}, about {duration(plan.times.mean)}: --relative-to-model"]


# --- Words for what is wanted, what is planned, and what is expected of it -----------------------------


def wanted_line(wanted: Wanted, model: str) -> str:
    """What was asked for, in words."""
    scale = f"on the scale of {model!r}" if wanted.relative else "absolute"
    if wanted.tolerance is None:
        return f"as good as {as_typed(wanted.time or 0.0, 's')} allow, {scale}"
    within = "" if wanted.time is None else f", within {as_typed(wanted.time, 's')}"
    return f"{as_asked(wanted.tolerance)} {scale}{within}"


def missed_by(wanted: Wanted, reached: float | None) -> str:
    """What was reached instead of the tolerance, to end a sentence; empty: it was reached, or none was asked for."""
    if wanted.tolerance is None or reached is None or reached <= wanted.tolerance * (1 + ROUNDING):
        return ""
    return f": {plus_minus(reached)} reached, {as_asked(wanted.tolerance)} was asked for"


def _end(wanted: Wanted, prospect: Prospect) -> str:
    """When a run ends at the latest."""
    plan, bound = prospect.allocation, f"{prospect.times.longest:.0f} s"
    if wanted.tolerance is None and has_most_sets(plan):
        return f"with the {plan.sets:,} load sets that a run has at most; more time buys nothing"
    if wanted.tolerance is None or prospect.times.longest == wanted.time:
        return f"ends at {bound}"
    runs = f"{share(prospect.times.enough)} of runs"
    most = "" if prospect.times.enough == COVERAGE else f", as it has {MOST_SETS:,} load sets at most"
    if wanted.time is not None:
        return f"{runs} need no more than {bound}{most}"
    return f"ends at {bound}, which are enough for {runs}{most}"


def scatter_told(found: Between) -> str:
    """What is known of the scatter of mountings beyond that of sets, to follow the word mountings."""
    if found.significant:
        return f"scatter by {share(found.u)} of the ratio, at most {share(found.bound_u)} (95 %)"
    return f"scatter no more than their sets let expect, at most {share(found.bound_u)} of the ratio (95 %)"


def mounting_lines(wanted: Wanted) -> list[str]:
    """What is known of the scatter of mountings, and what counts of it."""
    counted_as = f"the plan counts {share(wanted.mounted)}"
    if math.isfinite(wanted.mounted_freedom):
        counted_as += f", {counted(round(wanted.mounted_freedom), 'degree')} of freedom"
    return [f"mountings      {wanted.mounted_by}", f"               {counted_as}"]


def planned_lines(wanted: Wanted, prospect: Prospect) -> list[str]:
    """What is planned and what is expected of it."""
    plan, found = prospect.allocation, prospect.found
    expected = prospect.scale if wanted.relative else prospect.absolute
    person = wanted.mounts.described(plan.mountings, again=True)
    counts = f"{counted(plan.mountings, 'mounting')}, {counted(plan.sets, 'set')}"
    each = f"{show(plan.load, 'N')}, {show(wanted.frequency, 'Hz')}, {show(plan.dwell, 's')}"
    lines = [
        f"wanted         {wanted_line(wanted, found.model)}",
        f"plan           {counts}, {each} ({person})",
        f"lasts          {prospect.times.mean:.0f} s on average; {_end(wanted, prospect)}",
    ]
    lines += mounting_lines(wanted)
    if found.sensitivity is None:
        return [*lines, f"expected       only a bound: model {found.model!r} cannot tell such an object from its ratio"]
    half_text = "not known" if expected is None else plus_minus(expected)
    if not wanted.relative and prospect.scale is not None:
        half_text += f" ({plus_minus(prospect.scale)} on the scale)"
    cancel = found.films_cancel and not wanted.relative
    uncalibrated = "" if cancel or CALIBRATION in plan.shares else ", films not calibrated"
    lines.append(f"expected       {half_text}; u: {parts_of(plan.shares, plan.u)}{uncalibrated}")
    if wanted.tolerance is None and math.isfinite(wanted.mounted_freedom):
        lines.append("               wider where mountings scatter more; a run for a tolerance goes on until it is met")
    return lines


def parts_of(shares: Mapping[str, float], u: float) -> str:
    """The lines of a budget, with what each adds to the uncertainty, the largest first."""
    order = sorted(shares, key=lambda name: -shares[name])
    greatest = [name for name in order if shares[name] >= LEAST_SHARE] or order[:1]
    return ", ".join(f"{name} {share(u * max(shares[name], 0.0) ** 0.5)}" for name in greatest)
