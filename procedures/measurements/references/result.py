"""The result of a model's calibration by references: their mean ratios, and the calibration."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.calibration.model_fit import MeasuredReference, fit_model
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.findings.mean_ratio import CALIBRATION, NOISE, PICKUP, SCATTER, mean_ratio
from palpate.instrument.findings.modulus_of_ratio import MOST_SENSITIVE
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import ValidationLine, validate
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor
from palpate.procedures.measurements.references.reference import Reference
from palpate.procedures.measurements.softness.result import SoftnessPoint
from palpate.procedures.records.columns import Column

MODULUS = "modulus of an object"


@dataclass(frozen=True, slots=True)
class Worth:
    """What a number of references is worth for the modulus of an object."""

    references: Annotated[int | None, Column("their number; null: so many that more change nothing")]
    modulus_u: Annotated[float, Column("relative standard uncertainty of a modulus by the calibration alone")]
    half_width: Annotated[float, Column("half of the 95 % interval of ln of the modulus")]


@dataclass(frozen=True, slots=True)
class ReferencesResult:
    """A calibrated model.

    Attributes:
        points: the points.
        calibration: the calibration.
        line: what is left of the validation error for objects that are measured with the same films' calibration.
        worth: what the references are worth now, with another one, and with any number; empty: the spread is not known.
        budgets: budgets of the references' mean ratios, and of the constant.
    """

    points: Sequence[SoftnessPoint]
    calibration: ModelCalibration
    line: ValidationLine
    worth: tuple[Worth, ...]
    budgets: Sequence[Budget]

    @property
    def achieved_u(self) -> float | None:
        """Relative standard uncertainty of a modulus by the calibration alone; None: the spread is not known."""
        return self.worth[0].modulus_u if self.worth else None

    @property
    def unbudgeted(self) -> dict[str, tuple[float, float]]:
        """The modulus of an object in units of itself, with the uncertainty that the calibration alone leaves it."""
        return {} if self.achieved_u is None else {MODULUS: (1.0, self.achieved_u)}

    def summary(self) -> dict[str, Any]:
        """The calibration for JSON, without its origin."""
        found = self.calibration.model_dump()
        names = ("parameters", "thickness_m", "references", "constant", "constant_u", "films_u", "pickup_u",
                 "spread", "spread_degrees_of_freedom", "prior", "expires")  # fmt: skip
        return {
            "answered_by": self.calibration.model,
            **{name: found[name] for name in names},
            "factor": math.exp(self.calibration.constant),
            "validation_line": self.line.summary(),
            "worth": [asdict(each) for each in self.worth],
        }


def check_range(reference: Reference, curve: RatioCurve) -> float:
    """Sensitivity d ln E / d ln R of a model's curve at a reference.

    Raises:
        RangeError: the curve does not reach to it, or is so flat there that the reference says nothing.
    """
    low, high = curve.moduli
    told = f"reference {reference.name!r} of {show(reference.modulus, 'Pa')}"
    if not low <= reference.modulus <= high:
        raise RangeError(
            f"{told} is outside the {show(low, 'Pa')} to {show(high, 'Pa')} that model {curve.model!r} knows, where a"
            " ratio gives a bound alone; take a reference inside, or another model"
        )
    at = math.log(reference.modulus)
    slope = abs(float(curve.line(at, 1)))
    ratio = float(curve.line(at))
    if not ratio < MOST_SENSITIVE * slope:
        raise RangeError(
            f"{told} lies where 1 % of the ratio of model {curve.model!r} is more than {MOST_SENSITIVE:g} % of the"
            " modulus, so that it tells nothing of the model; take a reference nearer to the stiffness of the sensor's"
            " ring, and test such objects by palpate test modulus"
        )
    return ratio / slope


def evaluate(
    points: Sequence[SoftnessPoint],
    references: Sequence[Reference],
    design: Design,
    question: RatioQuestion,
    curve: RatioCurve,
    origin: Mapping[str, Any],
) -> ReferencesResult:
    """Calibrate a model by the mean ratios over the valid points of each reference.

    Args:
        points: the points.
        references: the references.
        design: the sensor, with the sensitivities of its films.
        question: names the model and its parameter set.
        curve: the model's curve.
        origin: where the calibration comes from: fields of `ModelCalibration`.

    Raises:
        EstimateError: a reference has no valid point, or they contradict each other or the curve.
        RangeError: the curve says nothing at a reference.
    """
    measured, budgets = [], []
    for each in references:
        valid = [point for point in points if point.object == each.name and point.valid]
        if not valid:
            raise EstimateError(
                f"no point of reference {each.name!r} is valid; remove what their flags name, and repeat"
            )
        mean = mean_ratio(f"force ratio of {each.name}", valid, design.film_freedom)
        budgets.append(mean)
        part = dict.fromkeys((SCATTER, NOISE, CALIBRATION, PICKUP), 0.0) | {c.name: c.u for c in mean.components}
        measured.append(
            MeasuredReference(
                each.name,
                each.modulus,
                each.u,
                each.told,
                mean.value,
                math.hypot(part[SCATTER], part[NOISE]) / mean.value,
                part[CALIBRATION] / mean.value,
                part[PICKUP] / mean.value,
                float(curve.force_ratio(each.modulus)),
                check_range(each, curve),
            )
        )
    known = validate(question.design, question.parameters, curve.model)
    about = {
        "design": question.design,
        "model": curve.model,
        "parameters": question.parameters,
        "films_degrees_of_freedom": design.film_freedom,
        **origin,
    }
    found = fit_model(measured, known, about)
    line = found.line(same_films=True)
    return ReferencesResult(points, found, line, _worth(found, line), [*budgets, _budget(found)])


def _worth(found: ModelCalibration, line: ValidationLine) -> tuple[Worth, ...]:
    count = len(found.references)
    sensitivity = statistics.median(each.sensitivity for each in found.references)
    lines = ((count, line), (count + 1, found.with_more(count + 1)), (None, found.with_more(10**6)))
    return tuple(
        Worth(number, sensitivity * each.u, sensitivity * each.u * coverage_factor(each.degrees_of_freedom))
        for number, each in lines
        if each is not None and each.u is not None
    )


def _budget(found: ModelCalibration) -> Budget:
    """Budget of the constant."""
    freedom = found.spread_degrees_of_freedom or math.inf
    films = found.films_degrees_of_freedom or math.inf
    parts = (
        Component("spread of objects", (found.spread or 0.0) * math.sqrt(found.weight), degrees_of_freedom=freedom),
        Component("moduli, scatter and noise of the references", found.constant_u),
        Component(CALIBRATION, found.films_u, degrees_of_freedom=films),
        Component(PICKUP, found.pickup_u),
    )
    return Budget(f"constant of model {found.model}", found.constant, "", parts)
