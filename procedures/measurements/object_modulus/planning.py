"""The plan of a measurement of a modulus, or why there is none."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.allocation.preparations import Prepared, prepare
from palpate.instrument.allocation.purchase import Preparation, RunOption
from palpate.instrument.calibration.films import FEWEST
from palpate.instrument.errors import PalpateError, RangeError, UsageError
from palpate.instrument.findings.film_forces import calibration_u
from palpate.instrument.findings.mean_ratio import CALIBRATION, PICKUP
from palpate.instrument.findings.object_modulus import ByReferences, answering
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import validate
from palpate.instrument.quantity import LARGEST_TOLERANCE, counted, show
from palpate.instrument.sensor.design import Design
from palpate.procedures.engine.plan import APPROACH, point_seconds
from palpate.procedures.lab.lab import MOUNTING, Target
from palpate.procedures.measurements.object_modulus.prospect import (
    CURVE,
    MOUNTED,
    SHORT,
    VALIDATION,
    ExpectedRatio,
    Prospect,
    Wanted,
    best_of,
    expected,
    fewest_of,
    for_bound,
    sets_of,
    way_of,
)
from palpate.procedures.measurements.object_modulus.telling import LEAST_SHARE
from palpate.procedures.measurements.prospects import MOST_SETS, reachable, share
from palpate.procedures.measurements.prospects import share as percent
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.checks import check_frequency

# -------------------------------------------------------------------------------------------------------
# What other sessions can do for the modulus of an object before its run: calibrate the films, and the model
#
# Both are sessions of their own, as a person stands a pin on the teeth or mounts references, and as what they store
# holds for all later runs. `prepared` finds how much of them makes the whole quickest.

COMPRESSION = 272.0  # s, of the test that tells the modulus of a reference [M]
REFERENCE = 400.0  # s, with that test and the mounting on the sensor [M]
REFERENCE_U = 0.02  # relative standard uncertainty of the modulus of a reference [A]
REFERENCE_SETS = 6  # load sets of each in palpate calibrate model
FILM_DWELL = 1.0  # s, in palpate calibrate films


def references_of(question: RatioQuestion, found: ExpectedRatio, design: Design) -> Preparation | None:
    """References of the model, with those that there are; None: nothing tells how objects spread about a constant."""
    slope, known = found.sensitivity, found.references
    if slope is None:
        return None
    if known is not None:
        made = len(known.calibration.references)
        one, more = known.calibration.with_more(1), known.calibration.with_more(10**9)
        if one is None or more is None or one.u is None or more.u is None:
            return None
        u = slope * math.sqrt(max(one.u**2 - more.u**2, 0.0))
        return Preparation(VALIDATION, u, -COMPRESSION * made, REFERENCE, made + 1, slope * more.u)
    spread = _spread(question.design, question.parameters, found.model)
    if spread is None:
        return None
    own = slope * design.ratio_scatter / math.sqrt(REFERENCE_SETS)
    return Preparation(VALIDATION, math.hypot(slope * spread, REFERENCE_U, own), 0.0, REFERENCE, 1, slope * spread)


@functools.lru_cache(maxsize=16)
def _spread(design: str, parameters: str, model: str) -> float | None:
    """How objects spread about a model's constant, by the thesis' samples; None: they do not tell."""
    try:
        return validate(design, parameters, model).ln_spread
    except PalpateError:
        return None


def films_of(design: Design, found: ExpectedRatio, frequency: float) -> Preparation | None:
    """A calibration of the films, by points on each tooth; None: the ratio only tells a bound of the modulus."""
    if found.sensitivity is None:
        return None
    shared = np.array([[len({*a.teeth} & {*b.teeth}) for b in design.films] for a in design.films])
    count = np.array([len(film.teeth) for film in design.films])
    covariance = np.asarray(design.scatter_covariance) * shared / np.outer(count, count)
    u = calibration_u(replace(design, film_covariance=tuple(map(tuple, covariance.tolist()))))
    teeth, point = len(design.teeth), point_seconds(frequency, FILM_DWELL, first=False)
    return Preparation(CALIBRATION, found.sensitivity * u, teeth * (MOUNTING + APPROACH), teeth * point, FEWEST)


def preparations(question: RatioQuestion, found: ExpectedRatio, wanted: Wanted, design: Design) -> list[Preparation]:
    """Those that replace a line of what is wanted."""
    films = None
    if design.film_covariance is not None and not (found.films_cancel and not wanted.relative):
        films = films_of(design, found, wanted.frequency)
    references = None if wanted.relative else references_of(question, found, design)
    return [each for each in (films, references) if each is not None]


def prepared(
    question: RatioQuestion, found: ExpectedRatio, wanted: Wanted, design: Design, loads: Sequence[float]
) -> Prepared | None:
    """The quickest way to the tolerance in all; None: nothing reaches it, or a time alone is given."""
    if wanted.tolerance is None or found.sensitivity is None:
        return None
    ways: list[RunOption] = [way_of(design, found, wanted, load, cycles) for load in loads for cycles in SHORT]
    try:
        return prepare(ways, wanted.tolerance, preparations(question, found, wanted, design), fewest_of(wanted))
    except RangeError:
        return None


# -------------------------------------------------------------------------------------------------------
# What makes the measurement of a modulus shorter or surer, and is not done by the run itself, with its price

FREQUENCIES = (20.0, 40.0)  # Hz
USUAL_POINTS = 6  # on each tooth, of palpate calibrate films
FILM_LOADS = 1.5, 4.0  # N, least and greatest of palpate calibrate films
PAYS = 0.98  # of the bench time or uncertainty: what saves less is not offered
REFERENCE_OPTION = "--reference 'A: 48 kPa ± 2 %'"  # one for each
UNITS = {VALIDATION: "reference", CALIBRATION: "film point"}


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
        what: "references", "films", "frequency", or "quickest": all that makes the whole quickest.
        numbers: how many references, points on each tooth, or hertz; by name.
        once_s: bench time of it, once, for all later runs [s].
        person_s: the part of it that a person takes [s].
        run_s: bench time of the run then [s].
        u: relative standard uncertainty of the modulus then; None: that of the tolerance, or it stays as it is.
        how: what to ask for.
        told: in a sentence, for people.
    """

    what: str
    numbers: dict[str, float]
    once_s: float
    person_s: float
    run_s: float
    u: float | None
    how: str
    told: str

    def summary(self) -> dict[str, Any]:
        """The alternative for JSON."""
        return asdict(self)


def alternatives(
    question: RatioQuestion, wanted: Wanted, prospect: Prospect, target: Target, loads: Sequence[float]
) -> list[Alternative]:
    """What else pays beside a plan. Nothing is offered for an object of which only a bound is known."""
    if prospect.found.sensitivity is None:
        return []
    found = [
        _references(question, wanted, prospect, target),
        _films(wanted, prospect, target),
        _frequency(wanted, prospect, target, loads),
        quickest(prepared(question, prospect.found, wanted, target.design, loads), len(target.design.teeth)),
    ]
    return [each for each in found if each is not None]


def worth_lines(offered: Sequence[Alternative]) -> list[str]:
    """Alternatives for people, two lines each."""
    return [line for each in offered for line in (f"{each.what:<14} {each.told}", f"{'':<14} {each.how}")]


def _references(question: RatioQuestion, wanted: Wanted, prospect: Prospect, target: Target) -> Alternative | None:
    """One more reference."""
    plan, found = prospect.allocation, prospect.found
    more = references_of(question, found, target.design)
    if more is None or wanted.relative or VALIDATION not in plan.shares:
        return None
    u = _with(prospect, more, more.least)
    seconds = more.seconds(more.least)
    told = f"{'one' if more.least == 1 else f'{more.least} in all'} would give {share(u)}; {duration(seconds)}, once"
    numbers, person = {VALIDATION: float(more.least)}, MOUNTING * more.least
    return Alternative(
        "references", numbers, seconds, person, plan.seconds, u, command_of(VALIDATION, more.least), told
    )


def _films(wanted: Wanted, prospect: Prospect, target: Target) -> Alternative | None:
    """Films calibrated at twice as many points; where they are not calibrated, what that would add."""
    plan, found, design = prospect.allocation, prospect.found, target.design
    films = films_of(design, found, wanted.frequency)
    if films is None:
        return None
    person = MOUNTING * len(design.teeth)
    if design.film_covariance is None:
        if found.references is not None:  # they hold the films' error, and would have to be measured anew
            return None
        added, seconds = films.u / math.sqrt(USUAL_POINTS), films.seconds(USUAL_POINTS)
        told = (
            f"not calibrated: no interval counts it; {USUAL_POINTS} points ({duration(seconds)}) leave {share(added)}"
        )
        points, u = USUAL_POINTS, math.hypot(plan.u, added)
    else:
        if plan.shares.get(CALIBRATION, 0.0) < LEAST_SHARE:
            return None
        now = plan.shares[CALIBRATION] * plan.u**2
        points = max(films.least, math.ceil(2 * films.u**2 / now))
        u, seconds = _with(prospect, films, points), films.seconds(points)
        told = f"{points} points would give {share(u)}; {duration(seconds)}, once"
    how = command_of(CALIBRATION, points)
    return Alternative("films", {CALIBRATION: float(points)}, seconds, person, plan.seconds, u, how, told)


def _frequency(wanted: Wanted, prospect: Prospect, target: Target, loads: Sequence[float]) -> Alternative | None:
    """Another frequency, where the bench can have it and it pays; the modulus is then the one at that frequency."""
    by_time, best, least = wanted.tolerance is None, None, PAYS
    for frequency in FREQUENCIES:
        try:
            check_frequency(frequency, target)
            other = best_of(target.design, prospect.found, replace(wanted, frequency=frequency), loads)
        except PalpateError:
            continue
        ratio = other.allocation.u / prospect.allocation.u if by_time else other.times.mean / prospect.times.mean
        if ratio < least:
            best, least = (frequency, other), ratio
    if best is None:
        return None
    frequency, other = best
    gives = f"give {share(other.allocation.u)}" if by_time else f"take {other.times.mean:.0f} s"
    told = f"{show(frequency, 'Hz')} would {gives}, for the modulus at that frequency"
    numbers, how = {"frequency_Hz": frequency}, f"--frequency '{show(frequency, 'Hz')}'"
    return Alternative("frequency", numbers, 0.0, 0.0, other.allocation.seconds, other.allocation.u, how, told)


def quickest(found: Prepared | None, teeth: int) -> Alternative | None:
    """The preparations that make the whole quickest; None: there are none, or nothing reaches the tolerance."""
    if found is None or not found.numbers:
        return None
    before = found.seconds - found.run_seconds
    each = {VALIDATION: MOUNTING, CALIBRATION: 0.0}
    person = math.fsum(each[name] * number for name, number in found.numbers.items())
    person += MOUNTING * teeth * (CALIBRATION in found.numbers)
    what = " and ".join(counted(number, UNITS[name]) for name, number in found.numbers.items())
    told = f"{what} ({duration(before)}, once), then {duration(found.run_seconds)}"
    how = "; ".join(command_of(name, number) for name, number in found.numbers.items())
    numbers = {name: float(number) for name, number in found.numbers.items()}
    return Alternative("quickest", numbers, before, person, found.run_seconds, None, how, told)


def _with(prospect: Prospect, made: Preparation, units: int) -> float:
    """Uncertainty of a plan with a preparation in place of the line that it replaces."""
    plan = prospect.allocation
    now = plan.shares.get(made.name, 0.0) * plan.u**2
    return math.sqrt(max(plan.u**2 - now, 0.0) + made.rest**2 + made.u**2 / units)


# --- A target that cannot be reached: which line binds, the best there is, and other ways there --------

NEEDS_MOUNTINGS = 0.05  # tolerance below which the scatter of mountings must be known
REFERENCES = 6  # as many as pay
LEAST_BY_COMPRESSION = 0.02
LEAST_TOLERANCE = 1e-6
CLOSE_TO = 1.002  # the ratio of two tolerances that are told alike
REMEDIES = {
    CALIBRATION: "calibrate the films at more points: palpate calibrate films",
    PICKUP: "tie the films' cables down, and give the smaller pick-up in the bench file",
    CURVE: "ask a finer model, such as --model auto",
    MOUNTED: "leave the number of mountings to the plan, without --mountings",
}


def below_floor(
    wanted: Wanted,
    question: RatioQuestion,
    found: ExpectedRatio,
    design: Design,
    loads: Sequence[float],
    error: BelowFloor,
) -> RangeError:
    """The refusal of a tolerance below the floor."""
    best = f"best now  {reachable(_least_tolerance(design, found, _free(wanted), tuple(loads), error.floor))}"
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    if error.line != VALIDATION:
        ways = _prepared(wanted, question, found, design, loads)
        if not ways and not (error.line == CURVE and found.model == answering(replace(question, model="auto"))):
            ways = [f"or        {REMEDIES[error.line]}"]
        if (wanted.tolerance or 0.0) >= LEAST_BY_COMPRESSION:
            ways = [*ways, _by_compression(wanted)]
        told_floor = f"{error.line} leaves {percent(error.floor)}, which no time on the bench lowers"
        return RangeError("\n  ".join([f"--tolerance {share} cannot be reached: {told_floor}", best, *ways]))
    factor = math.exp((found.sensitivity or 1.0) * (found.validation.u or 0.0))
    lines = [
        f"--tolerance {share} absolute cannot be reached: the model binds: {error.line} of {found.model!r} leaves"
        f" {percent(error.floor)}, a factor of {factor:.2g} ({found.validation.source})",
        best,
        *(_prepared(wanted, question, found, design, loads) or _with_references(question, found, design)),
        _by_compression(wanted),
        *_on_scale(wanted, found, design, loads),
    ]
    return RangeError("\n  ".join(lines))


def too_many_sets(
    wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float], prospect: Prospect
) -> RangeError:
    """The refusal of a tolerance above the floor that takes more load sets than a run has."""
    plan = prospect.allocation
    least = _least_tolerance(design, found, _free(wanted), tuple(loads), 0.0)
    return RangeError(
        f"--tolerance {100 * (wanted.tolerance or 0.0):.3g} % cannot be reached: {plan.binds} binds: it takes"
        f" {plan.sets:,} load sets, above the {MOST_SETS:,} of a run\n  best now  {reachable(least)}"
    )


def _free(wanted: Wanted) -> Wanted:
    """What is wanted, whatever the tolerance and the time."""
    return replace(wanted, tolerance=None, time=None)


@functools.lru_cache(maxsize=64)
def _least_tolerance(
    design: Design, found: ExpectedRatio, wanted: Wanted, loads: tuple[float, ...], floor: float
) -> float:
    """The least tolerance whose plan has no more load sets than a run; it is above `floor`, which no time lowers."""
    low, high = max(floor, LEAST_TOLERANCE), max(LARGEST_TOLERANCE, 2 * floor)
    while high > CLOSE_TO * low:
        middle = math.sqrt(low * high)
        try:
            sets = sets_of(design, found, replace(wanted, tolerance=middle), loads)
        except RangeError:  # so little above the floor that it takes centuries
            sets = MOST_SETS + 1
        low, high = (low, middle) if sets <= MOST_SETS else (middle, high)
    return high


def not_known(wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float]) -> RangeError:
    """The refusal of an absolute tolerance where the model's validation error is not known."""
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    lines = [
        f"--tolerance {share} absolute cannot be promised: the validation error of {found.model!r} is"
        f" {found.validation.source}",
        _by_compression(wanted),
        *_on_scale(wanted, found, design, loads),
    ]
    return RangeError("\n  ".join(lines))


def check_mountings(wanted: Wanted, found: ExpectedRatio, tolerance: float) -> None:
    """Refuse a tolerance that needs the scatter of mountings where that was never measured. Raises UsageError."""
    if tolerance >= NEEDS_MOUNTINGS or wanted.mounted is not None or (wanted.mountings or 1) >= 3:
        return
    percent = (found.sensitivity or 1.0) * 0.01
    raise UsageError(
        f"--tolerance {100 * tolerance:.3g} % needs the scatter of the ratio from mounting to mounting, which was never"
        f" measured: 1 % of it alone makes {100 * percent:.2g} % of the modulus with one mounting\n"
        "  either  --mountings 3, which measures it, and stores it for this sensor; its two degrees of freedom make"
        " the interval twice as wide\n"
        "  or      --mounting-scatter '1 %', if an earlier measurement told it; '0 %' takes none for granted"
    )


def _by_compression(wanted: Wanted) -> str:
    """The compression test of this bench [M]; of an object that is no rubber sample, by the name of one of its size."""
    sample = f"--sample {wanted.sample}" if wanted.sample else "with --sample for one of its size"
    return f"or        2 to 4 % in {COMPRESSION:.0f} s, where it can be taken off: palpate test modulus {sample}"


def _with_references(question: RatioQuestion, found: ExpectedRatio, design: Design) -> list[str]:
    """What as many references as pay would leave; empty: not known."""
    made = references_of(question, found, design)
    if made is None:
        return []
    count = max(REFERENCES, made.least)
    left, seconds = math.hypot(made.rest, made.u / math.sqrt(count)), duration(made.seconds(count))
    how = command_of(VALIDATION, count)
    return [f"or        {100 * left:.2g} % with {count} references ({seconds}, once): {how}"]


def _prepared(
    wanted: Wanted, question: RatioQuestion, found: ExpectedRatio, design: Design, loads: Sequence[float]
) -> list[str]:
    """What other sessions make the tolerance reachable, as quickly as can be; empty: none do."""
    best = quickest(prepared(question, found, wanted, design, loads), len(design.teeth))
    if best is None or (wanted.time is not None and best.run_s > wanted.time):
        return []
    return [f"or        as asked with {best.told}: {best.how}"]


def _on_scale(wanted: Wanted, found: ExpectedRatio, design: Design, loads: Sequence[float]) -> list[str]:
    """What the tolerance costs on the model's scale; empty: it is not reached there either."""
    try:
        plan = best_of(design, found, replace(wanted, time=None, relative=True), loads)
    except RangeError:
        return []
    share = f"{100 * (wanted.tolerance or 0.0):.3g} %"
    seconds = duration(plan.times.mean)
    return [f"or        {share} on the scale of {found.model!r}, about {seconds}: --relative-to-model"]


# --- the plan ------------------------------------------------------------------------------------------


def prospect_of(
    question: RatioQuestion,
    modulus: float,
    design: Design,
    loads: tuple[float, ...],
    references: ByReferences | None,
    wanted: Wanted,
) -> Prospect:
    """The plan for an object of which a Young modulus [Pa] is expected, under one of some loads [N]."""
    found, tolerance = expected(question, modulus, references), wanted.tolerance
    if found.sensitivity is None:
        return for_bound(found, wanted, loads[0])
    if tolerance is not None and found.validation.u is None and not wanted.relative:
        raise not_known(wanted, found, design, loads)
    try:
        prospect = best_of(design, found, wanted, loads)
    except BelowFloor as error:
        raise below_floor(wanted, question, found, design, loads, error) from None
    if tolerance is not None:
        check_mountings(wanted, found, tolerance)
    if prospect.allocation.sets > MOST_SETS:
        raise too_many_sets(wanted, found, design, loads, prospect)
    return prospect
