"""Moduli from force ratios, by a named model of a named sensor, as rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from instrument.models.curve import ratio_curve
from instrument.models.ratio import Question
from instrument.softness import INTERVAL, MOST_SENSITIVE, check_ratios, modulus_of_ratio

COVERAGE = 0.95


def estimate(question: Question, ratios: Sequence[float], u: float | Sequence[float] | None) -> list[dict[str, Any]]:
    """A row a ratio: modulus (None where only a bound is known) and coverage interval (None: no bound) [Pa].

    Args:
        u: standard uncertainty of the ratios, or of each; None: that by which the design's ratios repeat.

    Raises:
        RangeError: a ratio is not between 0 and 1, the uncertainty is negative or not finite, or the model does not
            answer for this sensor or to this tolerance.
        EstimateError: a linear system cannot be solved accurately.
    """
    sensor = question.sensor()
    uncertainty = sensor.ratio_scatter * np.array(ratios) if u is None else np.broadcast_to(u, len(ratios))
    check_ratios(ratios, uncertainty, COVERAGE)
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    found = modulus_of_ratio(curve, ratios, uncertainty, COVERAGE)
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
            "model": curve.model,
        }
        for index, ratio in enumerate(ratios)
    ]


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
