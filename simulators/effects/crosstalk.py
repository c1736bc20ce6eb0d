"""Crosstalk on a common base: the film under a tooth also senses the load on the neighbouring teeth."""

from __future__ import annotations

import itertools
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.simulators.physics.effect import FilmsEffect, Kind
from palpate.simulators.randomness import Stream


class Crosstalk(FilmsEffect):
    """The film under a tooth takes a part of the force on the films under neighbouring teeth.

    Neighbours are one pitch apart along a row or a column, so there are four at most. Up to a part of 0.24 the matrix
    is diagonally dominant, so that forces can be computed from voltages with arrays of any size.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    # the neighbour's film over the own one, for a load over the compliant and over the rigid part: Table A2.7 [T]
    compliant: float = Field(default=0.052, ge=0, le=0.24, strict=True)
    rigid: float = Field(default=9e-5, ge=0, le=0.24, strict=True)
    # part of the load that stands over the teeth [A]
    over_teeth: float = Field(default=0.0, ge=0, le=1, strict=True)

    def matrix(self, design: Design, stream: Stream, set_at_ns: int) -> Floats:
        matrix = np.eye(len(design.films))
        if design.separate_bases:
            return matrix
        part = (1 - self.over_teeth) * self.compliant + self.over_teeth * self.rigid
        for (i, own), (j, other) in itertools.permutations(enumerate(design.films), 2):
            if own.kind == other.kind == FILM_KINDS[0] and _beside(design, own.teeth[0], other.teeth[0]):
                matrix[i, j] = part * own.sensitivity / other.sensitivity
        return matrix


def _beside(design: Design, one: int, other: int) -> bool:
    distance = np.abs(np.subtract(design.teeth[one], design.teeth[other])) / design.cell
    return bool(abs(distance.sum() - 1) < 1e-6)
