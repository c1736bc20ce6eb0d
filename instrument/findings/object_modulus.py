"""Moduli from force ratios, by a named model of a named sensor, as rows."""

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
)
from palpate.instrument.models.curve import RatioCurve, ratio_curve
from palpate.instrument.models.prices.price_list import model_error, stored
from palpate.instrument.models.ratio import Question
from palpate.instrument.models.response import AUTO

Array = NDArray[np.float64]

COVERAGE = 0.95


def estimate(
    question: Question,
    ratios: Sequence[float],
    u: float | Sequence[float] | None,
    degrees_of_freedom: float | Sequence[float] = math.inf,
) -> list[dict[str, Any]]:
    """One row for each ratio: modulus (None: only a bound is known) and coverage interval (None: no bound) [Pa].

    The interval holds the model's own error (`model_error`) where it is known.

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
    least, greatest = curve.ratios

    def note(index: int) -> str:
        if found.outside[index]:
            return f"the model's ratios are {least:.4g} to {greatest:.4g}"
        if found.ambiguous[index]:
            return "several moduli give this ratio"
        if found.sensitivity[index] > MOST_SENSITIVE:
            return f"1 % of the ratio is {found.sensitivity[index]:.0f} % of the modulus here"
        return "" if found.kind[index] == INTERVAL else "the ratio's interval reaches beyond the model's"

    return [
        {
            "force_ratio": ratio,
            "force_ratio_u": float(uncertainty[index]),
            "modulus_Pa": _finite(found.modulus[index]),
            "low_Pa": _finite(found.low[index]) or None,
            "high_Pa": _finite(found.high[index]),
            "sensitivity": _finite(found.sensitivity[index]),
            "kind": str(found.kind[index]),
            "note": note(index),
            "model_error": errors[index],
            "model": curve.model,
        }
        for index, ratio in enumerate(ratios)
    ]


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
