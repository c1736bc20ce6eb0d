"""A model's curve that references have corrected by a constant factor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.curve import Line, RatioCurve

Array = NDArray[np.float64]


class CorrectedLine:
    """A line whose ratios are multiplied by a factor."""

    def __init__(self, line: Line, factor: float) -> None:
        self.x, self._line, self._factor = line.x, line, factor

    def __call__(self, x: float | Array, nu: Literal[0, 1] = 0) -> Array:
        found: Array = self._factor * self._line(x, nu)
        return found


def corrected(curve: RatioCurve, constant: float) -> RatioCurve:
    """The curve for measured ratios.

    Args:
        curve: a model's own curve.
        constant: ln of the model's ratio over the measured one.
    """
    factor = math.exp(-constant)
    return replace(curve, line=CorrectedLine(curve.line, factor), error=factor * curve.error) if constant else curve
