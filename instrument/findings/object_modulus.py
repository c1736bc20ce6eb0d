"""Moduli from force ratios, by a named model of a named sensor, as rows with two uncertainties.

The *scale* uncertainty is that on the curve of the model: statistics, films, and the model's own error where it is
known. The *absolute* one adds the validation error, by which the curve itself may be off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.findings.modulus_of_ratio import (
    INTERVAL,
    MOST_SENSITIVE,
    ModulusEstimate,
    check_ratios,
    modulus_of_ratio,
    modulus_within,
)
from palpate.instrument.models.curve import RatioCurve, chosen, corrected, ratio_curve
from palpate.instrument.models.price_list import model_error, stored
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.response import AUTO
from palpate.instrument.models.validation import ValidationLine, validation_u
from palpate.instrument.uncertainty.budget import coverage_factor

if TYPE_CHECKING:
    from palpate.instrument.calibration.model_calibration import ModelCalibration

Array = NDArray[np.float64]

COVERAGE = 0.95
FAR = "beyond the references, whose constant may fade: the interval holds the model's own answer, too"


@dataclass(frozen=True, slots=True)
class ByReferences:
    """A calibration of a model by references, for some ratios.

    Attributes:
        calibration: the calibration.
        same_films: whether the references were measured with the films' calibration of these ratios, which cancels.
        shared_u: part of each ratio's standard uncertainty that cancels, or one for all.
    """

    calibration: ModelCalibration
    same_films: bool = False
    shared_u: float | Sequence[float] = 0.0


def estimate(
    question: RatioQuestion,
    ratios: Sequence[float],
    u: float | Sequence[float] | None,
    degrees_of_freedom: float | Sequence[float] = math.inf,
    references: ByReferences | None = None,
) -> list[dict[str, Any]]:
    """One row for each ratio: modulus (None: only a bound is known) and coverage intervals (None: no bound) [Pa].

    The interval on the model's scale holds the model's own error (`model_error`) where it is known; the absolute one
    holds the validation error as well. Where that is not known, `absolute_kind` is None.

    Args:
        question: sensor, load and model.
        ratios: force ratios.
        u: standard uncertainty of each ratio, or one for all; None: the scatter with which the design's ratios repeat.
        degrees_of_freedom: degrees of freedom of these uncertainties, for each or one for all.
        references: the model's calibration by references; None: the thesis tells the validation error.

    Raises:
        ConfigError: the calibration belongs to another sensor, model or thickness.
        RangeError: a ratio is not between 0 and 1, the uncertainty is negative or not finite, or the model does not
            answer for this sensor or to this tolerance.
        EstimateError: a linear system cannot be solved accurately.
    """
    sensor = question.sensor()
    uncertainty = sensor.ratio_scatter * np.array(ratios) if u is None else np.broadcast_to(u, len(ratios))
    check_ratios(ratios, uncertainty, COVERAGE)
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    line = validation_of(question, curve.model, references)
    freedom = np.broadcast_to(degrees_of_freedom, len(ratios))
    shared = np.zeros(len(ratios)) if references is None else np.broadcast_to(references.shared_u, len(ratios))
    apart = np.sqrt(np.maximum(uncertainty**2 - shared**2, 0.0))
    given = _Given(question, line, ratios, uncertainty, apart, freedom)
    errors, bound, found, absolute = _read_off(given, corrected(curve, line.constant))
    beyond = np.zeros(len(ratios), dtype=np.bool_)
    if references is not None:
        beyond = ~references.calibration.reaches(found.modulus)
        _, _, own, own_absolute = _read_off(given, curve)
        found = found.widened(own, beyond)
        if absolute is not None and own_absolute is not None:
            absolute = absolute.widened(own_absolute, beyond)
    rectangle = bound / math.sqrt(3)  # a bound is a rectangle of that half width
    least, greatest = corrected(curve, line.constant).ratios

    def note(index: int) -> str:
        return "; ".join(text for text in (why(index), FAR if beyond[index] else "") if text)

    def why(index: int) -> str:
        if found.outside[index]:
            return f"the model's ratios are {least:.4g} to {greatest:.4g}"
        if found.ambiguous[index]:
            return "several moduli give this ratio"
        if found.sensitivity[index] > MOST_SENSITIVE:
            return f"1 % of the ratio is {found.sensitivity[index]:.0f} % of the modulus here"
        return "" if found.kind[index] == INTERVAL else "the ratio's interval reaches beyond the model's"

    def relative_u(index: int, of_ratio: Array, validation: float | None) -> float | None:
        if validation is None or not math.isfinite(found.modulus[index]):
            return None
        on_scale = math.hypot(of_ratio[index], rectangle[index]) / ratios[index]
        return float(found.sensitivity[index] * math.hypot(on_scale, validation))

    return [
        {
            "force_ratio": ratio,
            "force_ratio_u": float(uncertainty[index]),
            "modulus_Pa": _finite(found.modulus[index]),
            "scale_u": relative_u(index, uncertainty, 0.0),
            **_ends("scale", found, index),
            "absolute_u": relative_u(index, apart, line.u),
            **_ends("absolute", absolute, index),
            "absolute_kind": None if absolute is None else str(absolute.kind[index]),
            "sensitivity": _finite(found.sensitivity[index]),
            "kind": str(found.kind[index]),
            "note": note(index),
            "model_error": errors[index],
            "curve_error": float(bound[index]),
            "model": curve.model,
        }
        for index, ratio in enumerate(ratios)
    ]


def answering(question: RatioQuestion) -> str:
    """Name of the model that answers a question. Raises RangeError: "auto" finds none."""
    if question.model != AUTO:
        return question.model
    sensor = question.sensor()
    return chosen(sensor, question.load(sensor.ring.material.modulus), question.tolerance).model


def validation_of(question: RatioQuestion, model: str, references: ByReferences | None = None) -> ValidationLine:
    """Validation error of the model that answers a question. Raises as `validation_u` and `check_question` do."""
    if references is not None:
        references.calibration.check_question(question, model)
        names = question.design, question.parameters, model
        return validation_u(*names, references.calibration, same_films=references.same_films)
    plain = RatioQuestion(question.design, question.model, question.parameters)
    modulus = plain.sensor().ring.material.modulus
    same = question.sensor() == plain.sensor() and question.load(modulus) == plain.load(modulus)
    return validation_u(question.design, question.parameters, model, changed=() if same else question.changed)


@dataclass(frozen=True, slots=True)
class _Given:
    """What is known of some ratios: their standard uncertainties, in all and without what references share."""

    question: RatioQuestion
    line: ValidationLine
    ratios: Sequence[float]
    u: Array
    apart: Array
    freedom: Array


def _read_off(
    given: _Given, curve: RatioCurve
) -> tuple[list[float | None], Array, ModulusEstimate, ModulusEstimate | None]:
    """Errors of the model, bounds on those of the curve, and the moduli on the scale and absolute."""
    errors, found = _priced(given.question, curve, given.ratios, given.u, given.freedom)
    # The curve that model "auto" answers with holds the model's error already.
    bound = np.array([curve.error + (0.0 if given.question.model == AUTO else error or 0.0) for error in errors])
    absolute = None
    if given.line.u is not None:
        absolute = _absolute(curve, given.line, np.array(given.ratios), given.apart, given.freedom, bound)
    return errors, bound, found, absolute


def _absolute(
    curve: RatioCurve, line: ValidationLine, ratios: Array, u: Array, freedom: Array, bound: Array
) -> ModulusEstimate:
    """Intervals that hold the validation error, too. It is a share of the ratio, so they are those of its logarithm."""
    validation = line.u or 0.0
    together = np.hypot(u / ratios, validation)
    # Welch and Satterthwaite.
    spent = (u / ratios) ** 4 / freedom + validation**4 / line.degrees_of_freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        known = np.where(spent > 0, together**4 / spent, math.inf)
    reach = np.exp(
        [coverage_factor(float(each), COVERAGE) * total for each, total in zip(known, together, strict=True)]
    )
    return modulus_within(curve, ratios, ratios / reach - bound, ratios * reach + bound)


def _ends(name: str, found: ModulusEstimate | None, index: int) -> dict[str, float | None]:
    """Both ends of an interval under their names in JSON."""
    low, high = (math.nan, math.nan) if found is None else (found.low[index], found.high[index])
    return {f"{name}_low_Pa": _finite(low) or None, f"{name}_high_Pa": _finite(high)}


def _priced(
    question: RatioQuestion, curve: RatioCurve, ratios: Sequence[float], u: Array, freedom: Array
) -> tuple[list[float | None], ModulusEstimate]:
    """The model's error between the moduli of each interval, None where it is not priced; intervals that hold it."""
    sensor, (lowest, *_, highest) = question.sensor(), stored().moduli_Pa

    def priced(low: float, high: float) -> float | None:
        return model_error(sensor, question.load(lowest), curve.model, max(low, lowest), min(high, highest))

    found = modulus_of_ratio(curve, ratios, u, COVERAGE, degrees_of_freedom=freedom)
    ends = [(float(low), float(high)) for low, high in zip(found.low, found.high, strict=True)]
    known = [all(lowest <= end <= highest for end in pair if 0 < end < math.inf) for pair in ends]
    errors = [priced(*pair) if inside else None for pair, inside in zip(ends, known, strict=True)]
    if question.model == AUTO:
        return errors, found  # its curve has them
    while True:
        found = modulus_of_ratio(curve, ratios, u, COVERAGE, [error or 0.0 for error in errors], freedom)
        # A wider interval may reach moduli of a greater error, which make it wider still.
        wider = [
            None if error is None else max(error, priced(float(low), float(high)) or 0.0)
            for error, low, high in zip(errors, found.low, found.high, strict=True)
        ]
        if wider == errors:
            return errors, found
        errors = wider


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
