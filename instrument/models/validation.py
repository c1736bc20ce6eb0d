"""Validation error: the distance of a sensor model from the experiments of the thesis, which no finer mesh lowers.

    validate("single", "physical", "surface").rms        # 27.8 percent

It is the model less the measured mean, in percent of the measured mean. Models that answer at once are asked each time.
Models that refine take minutes; their answers are kept in `validation.json`.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, Protocol

from palpate.instrument import shipped
from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.evidence import ratio_by
from palpate.instrument.models.parameters import PARAMETER_SETS, get_parameter_set
from palpate.instrument.models.price_list import fingerprint
from palpate.instrument.models.response import response
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.sensor.sample import SAMPLES, Load

STORED = Path(__file__).with_name("validation.json")
SIGN = "model less measured mean, in percent of the measured mean"
# Tolerance of models that refine, by their error estimates; true errors are ten times less, far below these distances.
TOLERANCE = 5e-2
SECONDS = 50.0  # s of processor time that solving all of them anew takes [M]
RENEW = "solve them anew: palpate model validation --store"

Kind = Literal["compared", "input", "none"]


@dataclass(frozen=True, slots=True)
class Validation:
    """Comparison of a model with a parameter set with the experiments on a design.

    Attributes:
        kind: "compared"; "input": the model is the measurement itself, so its distance says nothing; "none": there is
            nothing to compare.
        why: the reason for "input" and "none"; empty for "compared".
        percent: error of each sample by its name, as SIGN says; empty except for "compared".
    """

    design: str
    parameters: str
    model: str
    kind: Kind
    why: str = ""
    percent: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def mean(self) -> float | None:
        """Signed mean over the samples [percent]."""
        return math.fsum(self.percent.values()) / len(self.percent) if self.percent else None

    @property
    def rms(self) -> float | None:
        """Root of the mean square over the samples [percent]."""
        squares = [value**2 for value in self.percent.values()]
        return math.sqrt(math.fsum(squares) / len(squares)) if squares else None

    @property
    def worst_sample(self) -> str | None:
        """The sample with the greatest error."""
        return max(self.percent, key=lambda name: abs(self.percent[name])) if self.percent else None

    @property
    def worst(self) -> float | None:
        """Error at that sample, with its sign [percent]."""
        return None if self.worst_sample is None else self.percent[self.worst_sample]

    @property
    def ln_errors(self) -> list[float]:
        """ln of the model's ratio over the measured mean, for each sample."""
        return [math.log1p(value / 100) for value in self.percent.values()]

    @property
    def ln_mean(self) -> float | None:
        """Mean of `ln_errors`."""
        return math.fsum(self.ln_errors) / len(self.percent) if self.percent else None

    @property
    def ln_spread(self) -> float | None:
        """Standard deviation of `ln_errors` about their mean, with one degree of freedom fewer than there are samples.

        None: there are fewer than two samples.
        """
        mean = self.ln_mean
        if mean is None or len(self.percent) < 2:
            return None
        return math.sqrt(math.fsum((each - mean) ** 2 for each in self.ln_errors) / (len(self.percent) - 1))

    @property
    def ln_rms(self) -> float | None:
        """Root of the mean square of `ln_errors`, with as many degrees of freedom as there are samples."""
        return math.sqrt(math.fsum(each**2 for each in self.ln_errors) / len(self.percent)) if self.percent else None

    def record(self) -> dict[str, Any]:
        """The comparison with the names that JSON has."""
        return {
            "design": self.design,
            "parameters": self.parameters,
            "model": self.model,
            "kind": self.kind,
            "why": self.why,
            "mean_percent": self.mean,
            "rms_percent": self.rms,
            "worst_percent": self.worst,
            "worst_sample": self.worst_sample,
            "samples_percent": dict(self.percent),
            "ln_mean": self.ln_mean,
            "ln_spread": self.ln_spread,
            "ln_rms": self.ln_rms,
        }


@dataclass(frozen=True, slots=True)
class StoredRatios:
    """Force ratio of each sample by a model that refines, or the reason why there is none."""

    design: str
    parameters: str
    model: str
    fingerprint: str
    force_ratios: dict[str, float] = field(default_factory=dict)
    failure: str = ""

    def __post_init__(self) -> None:
        """Check that there is a ratio for every measured sample, or a failure."""
        measured = DESIGNS[self.design].thesis_force_ratio if self.design in DESIGNS else {}
        if not self.failure and self.force_ratios.keys() != measured.keys():
            raise ValueError(f"{self.design}: ratios are not of the samples {', '.join(measured)}")


@dataclass(frozen=True, slots=True)
class KeptList:
    """All kept answers; `format` is raised with every change of a field's meaning."""

    format: Literal[1] = field(default=1, kw_only=True)
    answers: tuple[StoredRatios, ...]


def validate(design: str, parameters: str, model: str) -> Validation:
    """Distance of a model from the thesis' measured means, by names of design, parameter set and model.

    Raises:
        UnknownName: there is no such design, set or model.
        ConfigError: the kept answers are damaged.
    """
    if model not in MODELS:
        raise UnknownName("model", model, MODELS)
    if parameters not in PARAMETER_SETS:
        raise UnknownName("parameter set", parameters, PARAMETER_SETS)
    measured = get_design(design).thesis_force_ratio
    found = functools.partial(Validation, design, parameters, model)
    if not measured:
        return found("none", f"nothing was measured with design {design!r}")
    try:
        if ratio_by(model, parameters).fitted_to is None:
            return found("input", "the model is given the measured means")
        ask = kept if MODELS[model].default_tolerance else solve
        ratios = ask(design, parameters, model)
    except (RangeError, UnknownName) as error:
        return found("none", str(error))
    return found("compared", percent={name: 100 * (ratios[name] / ratio - 1) for name, ratio in measured.items()})


def validate_all(designs: Sequence[str]) -> list[Validation]:
    """Comparison of every model with each of its parameter sets, for some designs. Raises as `validate` does."""
    return [
        validate(design, parameters, model)
        for design in designs
        for model in MODELS
        for parameters in PARAMETER_SETS
        if has_set(parameters, model)
    ]


def has_set(parameters: str, model: str) -> bool:
    """Whether the set was made for the model."""
    try:
        get_parameter_set(parameters, model)
    except UnknownName:
        return False
    return True


def solve(design: str, parameters: str, model: str) -> dict[str, float]:
    """Force ratio of each measured sample, by the model itself.

    Raises:
        UnknownName: the model has no such parameter set.
        RangeError: the model does not answer for this sensor.
        EstimateError: a linear system cannot be solved accurately.
    """
    sensor, loads = _asked(design, parameters, model)
    tolerance = TOLERANCE if MODELS[model].default_tolerance else None
    return {name: response(sensor, load, model, tolerance).force_ratio for name, load in loads.items()}


def kept(design: str, parameters: str, model: str) -> Mapping[str, float]:
    """Force ratio of each measured sample, as `solve` gave it when the list was made.

    Raises:
        RangeError: the model did not answer for this sensor, or nothing is kept of its present version.
        UnknownName: the model has no such parameter set.
        ConfigError: the list is missing or damaged.
    """
    now = _fingerprint(*_asked(design, parameters, model))
    for answer in stored().answers:
        if (answer.design, answer.parameters, answer.model, answer.fingerprint) == (design, parameters, model, now):
            if answer.failure:
                raise RangeError(answer.failure)
            return answer.force_ratios
    raise RangeError(f"no answers of model {model!r} are kept for these numbers; {RENEW}")


def refining() -> Iterator[tuple[str, str, str]]:
    """Design, parameter set and model of every kept answer: all measured designs with all models that refine."""
    for model, of in MODELS.items():
        for design in measured_designs() if of.default_tolerance else ():
            for parameters in PARAMETER_SETS:
                if has_set(parameters, model):
                    yield design, parameters, model


def measured_designs() -> list[str]:
    """Designs that the thesis has experiments with."""
    return [name for name, design in DESIGNS.items() if design.thesis_force_ratio]


def measure(progress: Callable[[int, int, str], None]) -> KeptList:
    """Solve everything that `refining` lists, which takes some minutes.

    Raises:
        EstimateError: a linear system cannot be solved accurately.
    """
    wanted, answers = list(refining()), []
    for done, (design, parameters, model) in enumerate(wanted):
        progress(done, len(wanted), f"{design} by {model}, {parameters}")
        now = _fingerprint(*_asked(design, parameters, model))
        given: dict[str, Any] = {}
        try:
            given["force_ratios"] = solve(design, parameters, model)
        except RangeError as error:
            given["failure"] = str(error)
        answers.append(StoredRatios(design=design, parameters=parameters, model=model, fingerprint=now, **given))
    return KeptList(answers=tuple(answers))


def _asked(design: str, parameters: str, model: str) -> tuple[Design, dict[str, Load]]:
    """The sensor, and a load of 1 N through each sample that was measured with it."""
    chosen = get_parameter_set(parameters, model)
    plain = get_design(design)
    loads = {name: chosen.load(SAMPLES[name].modulus) for name in plain.thesis_force_ratio}
    return chosen.design(plain), loads


def _fingerprint(sensor: Design, loads: Mapping[str, Load]) -> str:
    """SHA-256 of everything on which finite elements depend, and of the version of their code."""
    parts = [f"{name} {load.sensed.modulus!r} {fingerprint(sensor, load)}" for name, load in loads.items()]
    return hashlib.sha256(f"{TOLERANCE};{sensor.disc_radius!r};{';'.join(parts)}".encode()).hexdigest()


@functools.cache
def stored() -> KeptList:
    """The answers that come with palpate. Raises ConfigError: the file is missing or damaged."""
    return shipped.read(STORED, KeptList, "list of answers", RENEW)


# --- the validation error as one line of an uncertainty budget -------------------------------------------

#     line = validation_u("single", "physical", "surface")
#     line.u, line.degrees_of_freedom          # 0.245, 6: standard uncertainty of ln of the force ratio
#
# Without references it is the rms of the model's errors against the experiments of the thesis, their mean included: one
# more object on one more bench may lie as far off as those samples do. References, objects of known modulus, replace it
# by a constant and its uncertainty (`palpate calibrate model`). Where neither is known, nothing is assumed.


def remedy(model: str) -> str:
    """What would tell the validation error of a model."""
    return f"measure references: palpate calibrate model --model {model}"


@dataclass(frozen=True, slots=True)
class ValidationLine:
    """What is known of the distance between a model's curve and real force ratios.

    Attributes:
        constant: ln of the model's ratio over the measured one, by which the curve is corrected; 0 without references.
        u: standard uncertainty that is left of ln of the ratio; None: not known.
        degrees_of_freedom: degrees of freedom of `u`.
        source: where it comes from; where `u` is None, why it is not known and what would tell it.
    """

    constant: float
    u: float | None
    degrees_of_freedom: float
    source: str

    def summary(self) -> dict[str, Any]:
        """Under the names of JSON; None for infinitely many degrees of freedom, or none."""
        freedom = self.degrees_of_freedom if self.u is not None and math.isfinite(self.degrees_of_freedom) else None
        return {**asdict(self), "degrees_of_freedom": freedom}


class Calibrated(Protocol):
    """A calibration of a model by references."""

    def line(self, same_films: bool) -> ValidationLine:
        """Constant and validation error that the references found."""


def validation_u(
    design: str,
    parameters: str,
    model: str,
    calibration: Calibrated | None = None,
    changed: Sequence[str] = (),
    same_films: bool = False,
) -> ValidationLine:
    """Validation error of a model with a parameter set on a design.

    Args:
        design, parameters, model: names.
        calibration: calibration of this model by references; None: the experiments of the thesis tell.
        changed: names of settings by which the sensor or the object differ from those of the thesis.
        same_films: whether the references were measured with the films' calibration of the object, which then cancels.

    Raises:
        UnknownName: there is no such design, set or model.
        ConfigError: kept answers of the models are damaged.
    """
    if calibration is not None:
        return calibration.line(same_films)
    if changed:
        return _unknown(model, f"the thesis has no experiment with other values of {', '.join(changed)}")

    found = validate(design, parameters, model)
    if found.kind == "input":
        return _unknown(
            model,
            f"model {model!r} is the thesis' measurement itself, and moduli of its samples are known by catalogue"
            " ranges alone",
        )
    if found.ln_rms is None:
        return _unknown(model, found.why)
    count = len(found.percent)
    return ValidationLine(0.0, found.ln_rms, count, f"rms distance from {count} samples of the thesis")


def _unknown(model: str, why: str) -> ValidationLine:
    return ValidationLine(0.0, None, math.inf, f"not known: {why}; {remedy(model)}")
