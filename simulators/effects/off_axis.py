"""The load is not along the axis of the sensor."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.instrument.quantity import Degrees
from palpate.instrument.sensor.design import Design
from palpate.simulators.physics.effect import FilmsEffect, Kind
from palpate.simulators.randomness import Stream


class OffAxis(FilmsEffect):
    """Every film takes cos(angle) of the load, and by d31 a signal of its lateral part sin(angle)."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True

    # [A]
    angle: Degrees = Field(default=10.0, ge=0, le=45)
    # d31 over d33, times the part of the lateral force that stretches the film; 0: the glue takes it all [A]
    lateral: float = Field(default=0.0, ge=-1, le=1, strict=True)

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        angle = math.radians(self.angle)
        factor = math.cos(angle) + self.lateral * math.sin(angle)
        return factor * np.eye(len(design.films))
