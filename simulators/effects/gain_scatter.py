"""Scatter of the films' gains: each load set or mounting has slightly other gains, by seating and alignment."""

from __future__ import annotations

import math
from operator import mul
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import Design
from palpate.simulators.physics.effect import FilmsEffect, Kind
from palpate.simulators.randomness import Stream


class GainScatter(FilmsEffect):
    """Draws the films' relative gains anew whenever the drive is set, or whenever an object is mounted (`redrawn`).

    The covariance is the design's own (3.3 % and 3.0 % for the single sensor, correlated so that the ratio repeats to
    4.1 % [T]), times the square of `strength`. The thesis' tables do not tell which of the two redraws it.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    strength: float = Field(default=1.0, ge=0, le=10, strict=True)
    redrawn: Literal["set", "mounting"] = "set"  # [A]

    @property
    def scatter(self) -> float:
        return self.strength

    @property
    def by_mounting(self) -> bool:
        return self.redrawn == "mounting"

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        """Gain factors of the films for the load set or mounting that began at `set_at_ns`, on the diagonal."""
        if not self.strength:
            return np.eye(len(design.films))
        independent = stream.normal(set_at_ns // 1000 * len(design.films), len(design.films)).tolist()
        drawn = [math.fsum(map(mul, row, independent)) for row in design.scatter_triangle]
        factors: Floats = np.diag(1.0 + self.strength * np.array(drawn))
        return factors
