"""Moving cables give a charge of their own, in step with the drive."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.quantity import Coulombs, CoulombsPerNewton, Newtons
from palpate.instrument.sensor.design import Design, Film
from palpate.simulators.linear.lti import StateSpace, gain
from palpate.simulators.physics.effect import Kind, SourceEffect


class Triboelectric(SourceEffect):
    """Each film's cable moves with the load, so its charge follows the force and does not average out."""

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # amplitude of the charge, and the load, peak to peak, that it comes with [A]
    charge: Coulombs = Field(default=0.1e-12, ge=0, le=1e-9)
    load: Newtons = Field(default=3.0, ge=1e-6, le=1000)
    # piezoelectric constant of the films, by which their sensitivities turn a charge into a voltage [T]
    d33: CoulombsPerNewton = Field(default=20e-12, ge=1e-15, le=1e-9)

    def source(self, design: Design, ambient: float = 0.0) -> StateSpace:
        return gain(np.outer([self._volts(film) for film in design.films], [1.0, 1.0, 0.0, 0.0]))

    def _volts(self, film: Film) -> float:
        """Voltage of a film for each newton on the sensor [V/N]."""
        return film.sensitivity * self.pickup

    @property
    def pickup(self) -> float:
        return self.charge / self.d33 / (self.load / 2)
