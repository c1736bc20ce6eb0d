"""Moduli from force ratios, by a named model of a named sensor, as rows with two uncertainties.

The *scale* uncertainty is that on the curve of the model: statistics, films, and the model's own error where it is
known. The *absolute* one adds the validation error, by which the curve itself may be off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

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
from palpate.instrument.models.curve import RatioCurve, ratio_curve
from palpate.instrument.models.prices.price_list import model_error, stored
from palpate.instrument.models.ratio import Question
from palpate.instrument.models.response import AUTO
from palpate.instrument.models.validation_line import ValidationLine, validation_u
from palpate.instrument.uncertainty.budget import coverage_factor

Array = NDArray[np.float64]

COVERAGE = 0.95


def estimate(
    question: Question,
    ratios: Sequence[float],
    u: float | Sequence[float] | None,
    degrees_of_freedom: float | Sequence[float] = math.inf,
) -> list[dict[str, Any]]:
    """One row for each ratio: modulus (None: only a bound is known) and coverage intervals (None: no bound) [Pa].

    The interval on the model's scale holds the model's own error (`model_error`) where it is known; the absolute one
    holds the validation error as well. Where that is not known, `absolute_kind` is None.

    Args:
        question: sensor, load and model.
        ratios: force ratios.
        u: standard uncertainty of each ratio, or one for all; None: the scatter with which the design's ratios repeat.
        degrees_of_freedom: degrees of freedom of these uncertainties, for each or one for all.

    Raises:
        RangeError: a ratio is not between 0 and 1, the uncertainty is negative or not finite, or the model does not
            answer for this sensor or to this tolerance.
        EstimateError: a linear system cannot be solved accurately.
    """
    sensor = question.sensor()
    uncertainty = sensor.ratio_scatter * np.array(ratios) if u is None else np.broadcast_to(u, len(ratios))
    check_ratios(ratios, uncertainty, COVERAGE)
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    freedom = np.broadcast_to(degrees_of_freedom, len(ratios))
    errors, found = _priced(question, curve, ratios, uncertainty, freedom)
    # The curve that model "auto" answers with holds the model's error already.
    bound = np.array([curve.error + (0.0 if question.model == AUTO else error or 0.0) for error in errors])
    line = validation_of(question, curve.model)
    absolute = None if line.u is None else _absolute(curve, line, np.array(ratios), uncertainty, freedom, bound)
    on_scale = np.hypot(uncertainty, bound / math.sqrt(3)) / ratios  # a bound is a rectangle of that half width
    least, greatest = curve.ratios

    def note(index: int) -> str:
        if found.outside[index]:
            return f"the model's ratios are {least:.4g} to {greatest:.4g}"
        if found.ambiguous[index]:
            return "several moduli give this ratio"
        if found.sensitivity[index] > MOST_SENSITIVE:
            return f"1 % of the ratio is {found.sensitivity[index]:.0f} % of the modulus here"
        return "" if found.kind[index] == INTERVAL else "the ratio's interval reaches beyond the model's"

    def relative_u(index: int, validation: float | None) -> float | None:
        if validation is None or not math.isfinite(found.modulus[index]):
            return None
        return float(found.sensitivity[index] * math.hypot(on_scale[index], validation))

    return [
        {
            "force_ratio": ratio,
            "force_ratio_u": float(uncertainty[index]),
            "modulus_Pa": _finite(found.modulus[index]),
            "scale_u": relative_u(index, 0.0),
            **_ends("scale", found, index),
            "absolute_u": relative_u(index, line.u),
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


def validation_of(question: Question, model: str) -> ValidationLine:
    """Validation error of the model that answers a question. Raises as `validation_u` does."""
    plain = Question(question.design, question.model, question.parameters)
    modulus = plain.sensor().ring.material.modulus
    same = question.sensor() == plain.sensor() and question.load(modulus) == plain.load(modulus)
    return validation_u(question.design, question.parameters, model, changed=() if same else question.changed)


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
    question: Question, curve: RatioCurve, ratios: Sequence[float], u: Array, freedom: Array
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
