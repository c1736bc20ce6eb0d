"""What makes the measurement of a modulus shorter or surer, and is not done by the run itself, with its price."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from palpate.instrument.allocation.preparations import Prepared
from palpate.instrument.allocation.purchase import Preparation
from palpate.instrument.errors import PalpateError
from palpate.instrument.findings.mean_ratio import CALIBRATION
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.quantity import counted, show
from palpate.procedures.lab.lab import Target
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.measurements.object_modulus.lines import VALIDATION, Wanted
from palpate.procedures.measurements.object_modulus.preparing import films_of, prepared, references_of
from palpate.procedures.measurements.object_modulus.prospect import Prospect, best_of
from palpate.procedures.measurements.object_modulus.telling import LEAST_SHARE
from palpate.procedures.measurements.repeated_sets import share
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.checks import check_frequency

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
