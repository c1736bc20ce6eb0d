"""Price list: the time that each model takes for its accuracy, measured once and stored, to find the cheapest model.

    choose(get_design("single"), [Load(1.0, get_sample("2"))], tolerance=1e-3).model

A tolerance, and an error that is promised, are relative to the force ratio. The list holds errors of the ratio itself;
each is divided by the smallest ratio of its interval of moduli.

A price holds for one design, for an object like the one with which it was measured, and between the moduli at which it
was measured. For anything else a model with an error estimate of its own answers.
"""

from __future__ import annotations

import bisect
import functools
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from palpate.instrument import shipped
from palpate.instrument.errors import RangeError
from palpate.instrument.models.parameters import CODE_VERSION, fixed, solid_parameters
from palpate.instrument.models.table import MODELS, Response
from palpate.instrument.quantity import check_tolerance, plus_minus, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.sample import Load, through

ROUNDED = 1.001  # ratio of two errors that differ by rounding alone, as those of one curve that was found twice
STORED = Path(__file__).with_name("prices.json")
DATA = "experiment"  # answers with measured means: it solves nothing, so "auto" never takes it
# Tolerance where the caller names none: below the 4 % by which the measured ratio scatters.
AUTO_TOLERANCE = 2e-2
MEASURE_ALL = "measure all designs anew: palpate accuracy numerics --store"


@dataclass(frozen=True, slots=True)
class Machine:
    """Machine and date of the times."""

    cpu: str
    cores: int
    system: str
    python: str
    date: str

    @property
    def described(self) -> str:
        """The machine as text for people, without the date."""
        return f"{self.cpu}, {self.cores} cores, {self.system}, Python {self.python}"

    def provenance(self, here: Machine) -> str:
        """Where and when the times were measured, for people; of another machine than `here` also how long ago."""
        text = f"measured on {self.described}, {self.date}"
        if replace(here, date=self.date) == self:
            return text
        days = (date.fromisoformat(here.date) - date.fromisoformat(self.date)).days
        return f"{text}, {days} {'day' if days == 1 else 'days'} ago; this is another machine: {here.described}"


@dataclass(frozen=True, slots=True)
class ReferenceRatios:
    """The converged force ratios of one design, against which errors are measured.

    Attributes:
        fingerprint: hash of everything on which the finite-element models depend except modulus and force, and of the
            version of their code. Prices with another fingerprint are not used.
        force_ratios, uncertainties: force ratio and its uncertainty at each modulus of the list.
        how: how they were computed and checked.
        seconds: processor time of the meshes that only the reference needs [s].
    """

    design: str
    fingerprint: str
    force_ratios: tuple[float, ...]
    uncertainties: tuple[float, ...]
    how: str
    seconds: float


@dataclass(frozen=True, slots=True)
class Price:
    """Error and time of one model of one design at one refinement.

    Attributes:
        errors: for each interval between two moduli of the list the greatest distance of the ratio from the reference,
            with the reference's uncertainty added. Closed forms and surfaces are compared all along the interval, the
            axisymmetric model at both ends and in the geometric middle, the solid model at both ends. None: the model
            does not answer in the whole interval, or was not asked.
        estimates: the greatest of the model's own error estimates in each interval; None: it has none.
        build_s, solve_s, evaluate_s: processor time of one answer at this refinement, in its parts [s]. A surface is
            built once; its time is wall time.
        answer_s: processor time of an answer with every mesh that its error estimate needs [s]; None: callers do not
            get such an answer.
        failure: why something is missing; empty where nothing is.
    """

    design: str
    model: str
    refinement: str
    errors: tuple[float | None, ...]
    estimates: tuple[float | None, ...]
    build_s: float | None
    solve_s: float | None
    evaluate_s: float | None
    answer_s: float | None
    failure: str = ""

    @property
    def seconds(self) -> float | None:
        """Time for one answer at this refinement alone [s]. What is built once and kept does not count."""
        if self.build_s is None or self.solve_s is None or self.evaluate_s is None:
            return self.evaluate_s
        return self.build_s + self.solve_s + self.evaluate_s

    def bounds(self, intervals: slice) -> list[float]:
        """Greatest error of the ratio in each of some intervals, by reference and by the model's own estimate.

        Empty where one of them is not known.
        """
        asked = list(zip(self.errors[intervals], self.estimates[intervals], strict=True))
        found = [max(error, own or 0.0) for error, own in asked if error is not None]
        return found if len(found) == len(asked) else []


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """A model that meets a tolerance.

    Attributes:
        error: greatest error by its price, relative to the force ratio; None: it was not priced, and its own estimate
            counts.
        seconds: time for each answer [s]; None: it was not priced.
        why: why it was chosen, in one sentence.
        bound: greatest error of the force ratio itself; None as `error`.
    """

    model: str
    error: float | None
    seconds: float | None
    why: str
    bound: float | None = None


@dataclass(frozen=True, slots=True)
class PriceList:
    """All prices, between rising Young moduli of the object [Pa].

    Attributes:
        format: number that is raised with every change of a field's meaning; lists of another format are refused.
    """

    format: Literal[2] = field(default=2, kw_only=True)
    machine: Machine
    moduli_Pa: tuple[float, ...]
    references: tuple[ReferenceRatios, ...]
    prices: tuple[Price, ...]

    def __post_init__(self) -> None:
        """Check that moduli rise and that every price and reference has a number for each interval or modulus."""
        count = len(self.moduli_Pa)
        if not (count > 1 and self.moduli_Pa[0] > 0 and all(low < high for low, high in pairwise(self.moduli_Pa))):
            raise ValueError("moduli_Pa do not rise from above 0")
        if any({len(price.errors), len(price.estimates)} != {count - 1} for price in self.prices) or any(
            {len(reference.force_ratios), len(reference.uncertainties)} != {count} for reference in self.references
        ):
            raise ValueError(f"a price or reference does not go with {count} moduli")
        if missing := {price.design for price in self.prices} - {each.design for each in self.references}:
            raise ValueError(f"no reference for {', '.join(sorted(missing))}")

    def least(self, design: str) -> tuple[float, ...]:
        """The smallest force ratio of a design in each interval."""
        (reference,) = (each for each in self.references if each.design == design)
        return tuple(map(min, pairwise(reference.force_ratios)))

    def promise(self, price: Price, intervals: slice) -> float | None:
        """Greatest error of an answer over some intervals, relative to the force ratio; None: not known."""
        if not (bounds := price.bounds(intervals)):
            return None
        least = self.least(price.design)[intervals]
        return max(bound / ratio for bound, ratio in zip(bounds, least, strict=True))

    def choose(self, design: str, low: float, high: float, tolerance: float) -> ModelChoice:
        """The cheapest model whose priced error meets the tolerance for objects with moduli from `low` to `high` [Pa].

        Raises:
            RangeError: no price was measured for that design and range, or none meets the tolerance.
        """
        intervals = self._around(low, high)
        offers = self._offers(design, intervals)
        moduli = (
            f"a modulus of {show(low, 'Pa')}" if low == high else f"moduli of {show(low, 'Pa')} to {show(high, 'Pa')}"
        )
        where = f"design {design!r} and {moduli}"
        if not offers:
            raise RangeError(f"no price was measured for {where}; ask a finite-element model itself")
        good = [offer for offer in offers if offer[1] <= tolerance]
        if not good:
            least = min(error for _, error, _ in offers)
            as_good = [offer for offer in offers if offer[1] <= ROUNDED * least]
            _, error, best = min(as_good, key=lambda offer: offer[:2])
            estimated = max(own or 0.0 for own in best.estimates[intervals]) == max(best.bounds(intervals))
            names = sorted({price.design for price in self.prices} - {design})
            others = [each for each in names if any(offer[1] <= tolerance for offer in self._offers(each, intervals))]
            binds = "its mesh" if estimated else "the reference of the prices"
            raise RangeError(
                f"tolerance {tolerance:g}: no model meets it for {where}; the best is {best.model!r},"
                f" {plus_minus(error)} of the force ratio, which {binds} binds; give"
                f" --tolerance {106 * error:.2g}%{''.join(f', or --design {each}' for each in others)};"
                " palpate accuracy numerics lists what each model reaches"
            )
        seconds, error, cheapest = min(good, key=lambda offer: offer[:2])
        count = len({price.model for _, _, price in good})
        rank = "the only model that meets" if count == 1 else f"the cheapest of {count} models that meet"
        return ModelChoice(
            cheapest.model,
            error,
            seconds,
            f"{cheapest.model} ({cheapest.refinement}): {plus_minus(error)} of the force ratio in"
            f" {show(seconds, 's', 3)}, {rank} {tolerance:g} for {where}",
            max(cheapest.bounds(intervals)),
        )

    def _offers(self, design: str, intervals: slice) -> list[tuple[float, float, Price]]:
        """Time, promised error and price of each answer that a caller may get for some intervals."""
        return [
            (price.answer_s, promise, price)
            for price in self.prices
            if price.design == design
            and price.model != DATA
            and price.answer_s is not None
            and (promise := self.promise(price, intervals)) is not None
        ]

    def model_error(self, design: str, model: str, low: float, high: float) -> float | None:
        """Greatest error of a model's ratio on its finest mesh, from modulus `low` to `high` [Pa]; None: not priced."""
        offers = [
            price.errors[self._around(low, high)]
            for price in self.prices
            if (price.design, price.model) == (design, model) and price.answer_s is not None
        ]
        complete = [[error for error in errors if error is not None] for errors in offers if None not in errors]
        return min((max(errors) for errors in complete if errors), default=None)

    def of(self, designs: Sequence[str]) -> PriceList:
        """The part of the list that concerns some designs.

        Raises:
            RangeError: the list has nothing of one of them.
        """
        for design in designs:
            if design not in {price.design for price in self.prices}:
                raise RangeError(
                    f"no price was measured for design {design!r}; measure it: palpate accuracy numerics --store"
                )
        return replace(
            self,
            references=tuple(reference for reference in self.references if reference.design in designs),
            prices=tuple(price for price in self.prices if price.design in designs),
        )

    def require_like(self, machine: Machine, moduli: tuple[float, ...]) -> None:
        """Check that machine and moduli [Pa] are those of this list; dates may differ. Raises RangeError."""
        if replace(machine, date=self.machine.date) != self.machine:
            raise RangeError(
                f"the stored prices are of {self.machine.described}, and this is {machine.described}; {MEASURE_ALL}"
            )
        if moduli != self.moduli_Pa:
            raise RangeError(f"the stored prices are at {self.moduli_Pa} Pa, and not at {moduli} Pa; {MEASURE_ALL}")

    def replaced(self, fresh: PriceList) -> PriceList:
        """This list with the prices of a fresh list's designs replaced by the fresh ones.

        Raises:
            RangeError: the fresh list is from another machine or has other moduli.
        """
        self.require_like(fresh.machine, fresh.moduli_Pa)
        renewed = {price.design for price in fresh.prices}
        sources = {p.design: fresh if p.design in renewed else self for p in (*self.prices, *fresh.prices)}
        return replace(
            self,
            machine=fresh.machine,
            references=tuple(r for name, of in sources.items() for r in of.references if r.design == name),
            prices=tuple(p for name, of in sources.items() for p in of.prices if p.design == name),
        )

    def vouches(self, design: Design, loads: Sequence[Load]) -> bool:
        """Whether prices were measured for this very design, and for such objects and moduli."""
        fingerprints = {reference.design: reference.fingerprint for reference in self.references}
        return DESIGNS.get(design.name) == design and all(
            fingerprint(design, load) == fingerprints.get(design.name)
            and self.moduli_Pa[0] <= load.sensed.modulus <= self.moduli_Pa[-1]
            for load in loads
        )

    def _around(self, low: float, high: float) -> slice:
        """Intervals from the last modulus at or below `low` to the first at or above `high`."""
        if not (self.moduli_Pa[0] <= low <= high <= self.moduli_Pa[-1]):
            return slice(0, 0)
        last = bisect.bisect_left(self.moduli_Pa, high, 1)
        return slice(min(bisect.bisect_right(self.moduli_Pa, low), last) - 1, last)


def choose(design: Design, loads: Sequence[Load], tolerance: float) -> ModelChoice:
    """The cheapest model that meets a tolerance, relative to the force ratio, under each of some loads.

    Raises:
        RangeError: the tolerance is not above 0 or is above 0.5, or no model meets it.
    """
    check_tolerance(tolerance, f"tolerance {tolerance:g}")
    prices = stored()
    if prices.vouches(design, loads):
        moduli = [load.sensed.modulus for load in loads]
        return prices.choose(design.name, min(moduli), max(moduli), tolerance)
    if _shipped_meet(design, loads, tolerance):
        why = f"surface: no prices were measured for this range, but its own error estimate meets {tolerance:g}"
        return ModelChoice("surface", None, None, why)
    uniform = all(load.at is None for load in loads)
    model = "axisymmetric" if design.outline == "round" and uniform else "solid"
    return ModelChoice(
        model,
        None,
        None,
        f"{model}: no prices were measured for this sensor, object or range, so that the model that knows its own"
        f" error refines until its estimate meets {tolerance:g}",
    )


def _shipped_meet(design: Design, loads: Sequence[Load], tolerance: float) -> bool:
    """Whether the curves of model "surface" are of this sensor, and meet the tolerance by their own estimate."""
    from palpate.instrument.models import surface

    try:
        found = [surface.find(design, load).relative(np.array([load.sensed.modulus])) for load in loads]
    except RangeError:
        return False
    return bool(np.max(found) <= tolerance)


def answers_cheapest(design: Design, loads: Sequence[Load], tolerance: float | None) -> list[Response]:
    """For each load the response by the cheapest model that meets the tolerance; None: 1e-2.

    Its error estimate is never below the priced error. A model is asked once for all its loads.

    Raises:
        RangeError: the tolerance is not above 0 or is above 0.5, or no model meets it.
        EstimateError: a linear system cannot be solved accurately.
    """
    asked = AUTO_TOLERANCE if tolerance is None else tolerance
    choices = [choose(design, [load], asked) for load in loads]
    found: dict[int, Response] = {}
    for name in dict.fromkeys(choice.model for choice in choices):
        model = MODELS[name]
        places = [place for place, choice in enumerate(choices) if choice.model == name]
        own = None if model.default_tolerance is None else asked
        for place, given in zip(places, model.answers(design, [loads[place] for place in places], own), strict=True):
            errors = [error for error in (choices[place].error, given.error_estimate) if error is not None]
            found[place] = replace(given, error_estimate=max(errors), why=choices[place].why)
    return [found[place] for place in range(len(loads))]


def model_error(design: Design, load: Load, model: str, low: float, high: float) -> float | None:
    """Greatest distance of a model's force ratio from the priced reference, on whatever mesh, in units of the ratio.

    Args:
        design: the sensor.
        load: load through an object, whose modulus has no effect.
        model: name of the model.
        low, high: moduli of the object between which the distance is the greatest [Pa].

    Returns:
        None where nothing was priced, and for the experiment, which is no approximation of a model.
    """
    prices = stored()
    ends = [through(load, modulus) for modulus in (low, high)]
    if model == DATA or not prices.vouches(design, ends):
        return None
    return prices.model_error(design.name, model, low, high)


def model_errors(design: Design, loads: Sequence[Load], models: Sequence[str]) -> list[float | None]:
    """`model_error` at the modulus of each of some loads, which differ in nothing else, by a model for each."""
    prices = stored()
    vouched = prices.vouches(design, [through(loads[0], prices.moduli_Pa[0])])
    moduli = [load.sensed.modulus for load in loads]
    return [
        prices.model_error(design.name, model, modulus, modulus) if vouched and model != DATA else None
        for model, modulus in zip(models, moduli, strict=True)
    ]


def fingerprint(design: Design, load: Load) -> str:
    """SHA-256 of everything but modulus and force on which the finite-element models depend, and their version."""
    return _fingerprint(CODE_VERSION, design, replace(through(load, design.ring.material.modulus), force=1.0))


@functools.lru_cache(maxsize=64)
def _fingerprint(version: int, design: Design, load: Load) -> str:
    text = f"code {version};{fixed(solid_parameters(design, load))}"
    return hashlib.sha256(text.encode()).hexdigest()


@functools.cache
def stored() -> PriceList:
    """The prices that come with palpate.

    Raises:
        ConfigError: the file is missing or damaged.
    """
    return shipped.read(STORED, PriceList, "price list", MEASURE_ALL)
