"""PVDF is pyroelectric: films that warm up give a charge."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.quantity import KelvinPerSecond, NewtonsPerKelvin, Seconds
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.physics.effect import Kind, SourceEffect


class Pyroelectric(SourceEffect):
    """The films warm up from the bench's opening on, at first by `drift`, in the end to drift times settling.

    T' = drift + (ambient - T) / settling. The ambient is set by the operator and is 0 K when the bench is opened.
    Without drift there is no effect, whatever is set.
    """

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # from p = 30 uC/(m2 K) [S] and areas: disc under the tooth, square under the base
    disc: NewtonsPerKelvin = Field(default=9.2, ge=0, le=1e4)
    square: NewtonsPerKelvin = Field(default=150.0, ge=0, le=1e4)
    # [A]
    drift: KelvinPerSecond = Field(default=20e-3, ge=-10, le=10)
    settling: Seconds = Field(default=300.0, ge=1e-3, le=1e6)

    def source(self, design: Design, ambient: float = 0.0) -> StateSpace:
        if not self.drift:
            return gain(np.zeros((len(design.films), 4)))
        volts = [film.sensitivity * (self.disc if film.kind == FILM_KINDS[0] else self.square) for film in design.films]
        return StateSpace(
            np.array([[-1 / self.settling]]),
            np.array([[0.0, 0.0, 0.0, self.drift + ambient / self.settling]]),
            np.array(volts)[:, np.newaxis],
            np.zeros((len(volts), 4)),
        )
