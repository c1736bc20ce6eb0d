"""Calibration of a sensor model by references, objects of known modulus: a constant and the spread about it.

    found.line(same_films=True)              # what is left of the model's validation error

The curve of the model is divided by the constant. `fit_model` finds it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field

from palpate.instrument.calibration.calibration import Calibration
from palpate.instrument.config import Config, Name, NotNegative, Positive, check
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.models.validation import Validation, ValidationLine, remedy
from palpate.instrument.quantity import counted, show

if TYPE_CHECKING:
    from palpate.instrument.models.response import RatioQuestion


# --- the calibration -----------------------------------------------------------------------------------


REACH = 3.0  # factor between moduli


class CalibratedReference(Config):
    """A reference as the calibration keeps it: see MeasuredReference."""

    model_config = ConfigDict(strict=True)

    name: Name
    modulus_Pa: Positive
    modulus_u: Positive
    source: Name
    force_ratio: Positive
    force_ratio_u: NotNegative
    films_u: NotNegative
    pickup_u: NotNegative
    model_force_ratio: Positive
    sensitivity: Positive
    ln_error: float
    ln_error_u: NotNegative


class ModelCalibration(Calibration):
    """Calibration of a model for one sensor. The field names are the keys of the calibration file.

    Args:
        design, model, parameters, thickness_m: sensor, model and its parameter set, and thickness of the references.
        constant: ln of the model's ratio over the measured one.
        constant_u: its standard uncertainty by moduli, scatter and noise of the references; 0 where `spread` holds it.
        films_u, pickup_u: parts of its uncertainty by the films' calibration and by pick-up, which do not average out.
        films_degrees_of_freedom: degrees of freedom of `films_u`; None: infinitely many.
        spread, spread_degrees_of_freedom: standard deviation of objects about the constant; None: not known.
        weight: share of the spread's variance that the constant has: 1 over the number of equal references.
        prior: what the spread rests on, in words.
        film_calibration: SHA-256 of the films' calibration; None: the design's sensitivities held.
        device: serial number of the sensor node.
    """

    file: ClassVar[str] = "calibration of a model"
    kind: ClassVar[str] = "model"
    make: ClassVar[str] = "run palpate calibrate model"

    design: Name
    model: Name
    parameters: Name
    thickness_m: Positive
    references: Annotated[tuple[CalibratedReference, ...], Field(min_length=1)]
    constant: float
    constant_u: NotNegative
    films_u: NotNegative
    films_degrees_of_freedom: Positive | None = None
    pickup_u: NotNegative
    spread: NotNegative | None = None
    spread_degrees_of_freedom: Positive | None = None
    weight: Positive
    prior: Name
    film_calibration: Name | None = None

    @property
    def of(self) -> tuple[str, ...]:
        return self.design, self.model, self.parameters, show(self.thickness_m, "m")

    def line(self, same_films: bool) -> ValidationLine:
        """What is left of the validation error, for the ratio of an object.

        Args:
            same_films: whether the object is measured with the films' calibration of the references; it then cancels.
        """
        evidence = f"{counted(len(self.references), 'reference')} of {self.source}{self.marks()}"
        if self.spread is None or self.spread_degrees_of_freedom is None:
            why = f"{evidence} gives a constant, and nothing tells the spread about it"
            return ValidationLine(self.constant, None, math.inf, f"not known: {why}; {remedy(self.model)}, two or more")
        evidence = f"{evidence}, {self.prior}"
        if self.film_calibration is not None:
            evidence += (
                "; the films' calibration is the same and cancels"
                if same_films
                else "; their films' calibration counts"
            )
        films = 0.0 if same_films else self.films_u
        spread = self.spread * math.sqrt(1 + self.weight)
        u = math.hypot(spread, self.constant_u, self.pickup_u, films)
        spent = spread**4 / self.spread_degrees_of_freedom + films**4 / (self.films_degrees_of_freedom or math.inf)
        return ValidationLine(self.constant, u, u**4 / spent if spent > 0 else math.inf, evidence)

    def with_more(self, references: int) -> ValidationLine | None:
        """The line if there were so many references, like the present ones and of the same spread; None: not known."""
        count = len(self.references)
        if self.spread is None or self.spread_degrees_of_freedom is None:
            return None
        spread = self.spread * math.sqrt(1 + 1 / references)
        one = math.fsum(each.ln_error_u**2 for each in self.references) / count if self.constant_u else 0.0
        u = math.hypot(spread, math.sqrt(one / references), self.pickup_u)
        freedom = self.spread_degrees_of_freedom + (references - count) * telling(self.spread, one)
        freedom_of_all = u**4 * freedom / spread**4 if spread > 0 else math.inf
        return ValidationLine(self.constant, u, freedom_of_all, counted(references, "reference"))

    def reaches(self, moduli: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether the constant is taken to hold at some moduli [Pa]: up to three times beyond the references' own."""
        moduli_of_references = [each.modulus_Pa for each in self.references]
        return (moduli >= min(moduli_of_references) / REACH) & (moduli <= max(moduli_of_references) * REACH)

    def check_question(self, question: RatioQuestion, model: str) -> None:
        """Check that the calibration is of the model that answers a question, and its sensor and object.

        Raises ConfigError.
        """
        modulus = question.sensor().ring.material.modulus
        plain = replace(question, settings={}, at=None)
        load = plain.load(modulus)
        own = self.design, self.model, self.parameters
        if own != (question.design, model, question.parameters):
            asked = f"design {question.design}, model {model}, set {question.parameters}"
            raise ConfigError(
                f"the calibration of a model by {self.source} is for design {self.design}, model {self.model}, set"
                f" {self.parameters}, not for {asked}; {self.make}"
            )
        alike = replace(load, sensed=replace(load.sensed, thickness=self.thickness_m))
        if question.sensor() != plain.sensor() or question.load(modulus) != alike:
            raise ConfigError(
                f"the calibration of a model by {self.source} is for the parameter set as it stands and objects of"
                f" {show(self.thickness_m, 'm')}; leave out {', '.join(question.changed) or 'the settings'}, or give"
                " that thickness"
            )

    def check_films(self, films: str | None) -> None:
        """Check that the constant holds with a films' calibration of that SHA-256. Raises ConfigError.

        What the design's sensitivities are off by is in the constant of uncalibrated films, and not in others.
        """
        if (self.film_calibration is None) != (films is None):
            then, now = ("no", "one") if films is not None else ("one", "none")
            raise ConfigError(
                f"was made with {then} calibration of the films, and now there is {now}; {self.make}, or delete it"
            )


def telling(spread: float, variance: float) -> float:
    """Degrees of freedom that one more reference of some variance of its own gives a spread: 1 if it has none.

    The variance of an estimate of spread² grows with (spread² + variance)².
    """
    return (spread**2 / (spread**2 + variance)) ** 2


# --- the fit -------------------------------------------------------------------------------------------

#     measured = [MeasuredReference("A", 48e3, 0.02, "stated", 0.21, 0.017, 0.0, 0.0, 0.26, 2.0), ...]
#     fit_model(measured, validate("single", "physical", "surface"), origin)
#
# References tell how much objects differ about the constant. Their spread is pooled with that of the thesis' samples,
# unless they refute it. References that no spread explains are refused.


REFUTED = 0.01  # probability of a chi2 by chance below which the thesis' spread is dropped
CONTRADICTION = 1e-4  # probability of a chi2 by chance below which references are refused
# Where the thesis tells nothing of a model: a spread of ratios, and a distance of the curve, that no chi2 should call a
# contradiction. They serve to refuse references, and enter no uncertainty.
UNTOLD_SPREAD, UNTOLD_DISTANCE = 0.25, 0.5


@dataclass(frozen=True, slots=True)
class MeasuredReference:
    """A reference with its measured force ratio. All uncertainties are relative standard uncertainties.

    Attributes:
        name: name of the reference.
        modulus_Pa, modulus_u: its Young modulus.
        source: where the modulus comes from.
        force_ratio: mean measured ratio.
        force_ratio_u: part of the ratio's uncertainty that is its own: scatter of the gains, and noise.
        films_u, pickup_u: parts that all references share: the films' calibration, and pick-up.
        model_force_ratio: ratio of the model for this modulus.
        sensitivity: d ln E / d ln R of the model there.
    """

    name: str
    modulus_Pa: float
    modulus_u: float
    source: str
    force_ratio: float
    force_ratio_u: float
    films_u: float
    pickup_u: float
    model_force_ratio: float
    sensitivity: float

    @property
    def ln_error(self) -> float:
        """ln of the model's ratio over the measured one."""
        return math.log(self.model_force_ratio / self.force_ratio)

    @property
    def ln_error_u(self) -> float:
        """Standard uncertainty of it that this reference alone has."""
        return math.hypot(self.force_ratio_u, self.modulus_u / self.sensitivity)


def fit_model(
    references: Sequence[MeasuredReference], validation: Validation, origin: Mapping[str, Any]
) -> ModelCalibration:
    """Fit the constant of a model and its spread to measured references.

    Args:
        references: at least one.
        validation: the model's errors against the thesis' experiments.
        origin: the other fields of `ModelCalibration`.

    Raises:
        EstimateError: references contradict each other or the curve, beyond chi2 of a chance of 1e-4.
    """
    errors, variances = [r.ln_error for r in references], [r.ln_error_u**2 for r in references]
    _check_curve(references, validation)
    _check_each_other(references, validation)
    found = _spread(references, validation)
    spread = found.u or 0.0
    weights = [1 / (spread**2 + (0.0 if found.holds_all else each)) for each in variances]
    shares = [each / math.fsum(weights) for each in weights]

    def mean(values: Sequence[float]) -> float:
        return math.fsum(share * value for share, value in zip(shares, values, strict=True))

    fields = {
        "references": [{**asdict(r), "ln_error": r.ln_error, "ln_error_u": r.ln_error_u} for r in references],
        "constant": mean(errors),
        "constant_u": 0.0
        if found.holds_all
        else math.sqrt(mean([s * v for s, v in zip(shares, variances, strict=True)])),
        "films_u": mean([r.films_u for r in references]),
        "pickup_u": mean([r.pickup_u for r in references]),
        "spread": found.u,
        "spread_degrees_of_freedom": found.degrees_of_freedom,
        "weight": math.fsum(share**2 for share in shares),
        "prior": found.basis,
        **origin,
    }
    return check(fields, ModelCalibration, "model calibration")


def expected_u(validation: Validation, moduli_u: Sequence[float], scatter_u: float) -> float | None:
    """Standard uncertainty of ln of an object's ratio that references are expected to leave.

    Args:
        validation: the model's errors against the thesis' experiments; the references are expected to spread as much.
        moduli_u: uncertainty of each reference's ln ratio by its modulus.
        scatter_u: that by its load sets.

    Returns:
        None: the thesis tells no spread.
    """
    spread = validation.ln_spread
    if spread is None:
        return None
    weights = [1 / (spread**2 + each**2 + scatter_u**2) for each in moduli_u]
    return math.sqrt(spread**2 + 1 / math.fsum(weights))


@dataclass(frozen=True, slots=True)
class _Spread:
    """Standard deviation of objects about the constant; None: not known.

    Attributes:
        basis: what it rests on, in words.
        holds_all: whether it holds the references' own uncertainties, too.
    """

    u: float | None
    degrees_of_freedom: float | None
    basis: str
    holds_all: bool = False


def _spread(references: Sequence[MeasuredReference], validation: Validation) -> _Spread:
    """The spread of references and thesis, pooled as variances.

    What the references' own uncertainties explain is taken off. Where nothing else tells the spread, it stays in: then
    Student's factor for the few references holds for all of it.
    """
    errors, variances = [r.ln_error for r in references], [r.ln_error_u**2 for r in references]
    count, more = len(errors), len(errors) - 1
    explained = math.fsum(variances) / count
    own = math.fsum((each - math.fsum(errors) / count) ** 2 for each in errors) / more if more else 0.0
    whole = math.sqrt(max(own, explained))
    prior = validation.ln_spread
    if prior is None:
        return _Spread(whole, more, "their own spread", True) if more else _Spread(None, None, "no spread is known")
    freedom = len(validation.percent) - 1
    thesis = f"the thesis' {100 * prior:.2g} % ({freedom} degrees of freedom)"
    by_thesis = [prior**2 + each for each in variances]
    if more and _chi2(errors, by_thesis) > _quantile(REFUTED, more):
        worst = _farthest(references, by_thesis)
        which = f"; {worst!r} lies farthest from the others" if worst else ""
        return _Spread(whole, more, f"their own spread, which refutes {thesis}{which}", True)
    tell = more * telling(prior, explained)
    pooled = math.sqrt((freedom * prior**2 + tell * max(own - explained, 0.0)) / (freedom + tell))
    return _Spread(pooled, freedom + tell, f"spread pooled with {thesis}" if more else f"spread of {thesis}")


def _check_curve(references: Sequence[MeasuredReference], validation: Validation) -> None:
    distance = UNTOLD_DISTANCE if validation.ln_rms is None else validation.ln_rms
    limit = _quantile(CONTRADICTION, 1)
    for each in references:
        chi2 = each.ln_error**2 / (distance**2 + each.ln_error_u**2)
        if chi2 > limit:
            raise EstimateError(
                f"reference {each.name!r} contradicts the curve: its ratio is {each.force_ratio:.4g}, and the model"
                f" gives {each.model_force_ratio:.4g} for {show(each.modulus_Pa, 'Pa')}; chi2 {chi2:.1f} is above"
                f" {limit:.1f}. Check its modulus and its mounting, or take another model"
            )


def _check_each_other(references: Sequence[MeasuredReference], validation: Validation) -> None:
    spread = _greatest_spread(validation)
    errors, variances = [r.ln_error for r in references], [spread**2 + r.ln_error_u**2 for r in references]
    if len(references) < 2 or (chi2 := _chi2(errors, variances)) <= (
        limit := _quantile(CONTRADICTION, len(references) - 1)
    ):
        return

    worst = _farthest(references, variances)
    both = " and ".join(repr(r.name) for r in references)
    who = f"reference {worst!r} and the others" if worst else f"references {both}"
    which = f"{worst!r}" if worst else "one of them"
    lines = ", ".join(f"{r.name}: {math.exp(r.ln_error):.3f}" for r in references)
    raise EstimateError(
        f"{who} contradict each other: the model's ratio over the measured one is {lines}; chi2 {chi2:.1f} is above"
        f" {limit:.1f}. Measure {which} again or leave it out, or take another model"
    )


def _farthest(references: Sequence[MeasuredReference], variances: Sequence[float]) -> str:
    """Name of the reference without which the others agree best; empty for two, which differ alike."""
    if len(references) < 3:
        return ""

    def without(left_out: int) -> float:
        left = [(r.ln_error, v) for i, (r, v) in enumerate(zip(references, variances, strict=True)) if i != left_out]
        return _chi2(*zip(*left, strict=True))

    return references[min(range(len(references)), key=without)].name


def _greatest_spread(validation: Validation) -> float:
    """The upper end of the one-sided 95 % interval of the thesis' spread, whose degrees of freedom are few."""
    from scipy.special import chdtri

    if validation.ln_spread is None:
        return UNTOLD_SPREAD
    freedom = len(validation.percent) - 1
    return float(validation.ln_spread * math.sqrt(freedom / chdtri(freedom, 0.95)))


def _chi2(values: Sequence[float], variances: Sequence[float]) -> float:
    """Sum of squares about the weighted mean, each over its variance."""
    weights = [1 / each for each in variances]
    mean = math.fsum(w * v for w, v in zip(weights, values, strict=True)) / math.fsum(weights)
    return math.fsum(w * (v - mean) ** 2 for w, v in zip(weights, values, strict=True))


def _quantile(chance: float, freedom: int) -> float:
    """The chi2 that a chance exceeds."""
    from scipy.special import chdtri

    return float(chdtri(freedom, chance))
