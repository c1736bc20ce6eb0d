"""Glue holds a film: it gives less charge than a free one."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.simulators.physics.effect import FilmsEffect, Kind
from palpate.simulators.randomness import Stream


class GlueClamping(FilmsEffect):
    """A factor on the films of some kinds. On all of them it cancels in the force ratio."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    # 0.43 to 0.59 [S]
    factor: float = Field(default=0.43, ge=1e-6, le=1, strict=True)
    films: tuple[Literal["rigid", "total"], ...] = Field(default=("rigid",), min_length=1, max_length=len(FILM_KINDS))

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        return np.diag([self.factor if film.kind in self.films else 1.0 for film in design.films])
