"""A voltage amplifier in place of the charge amplifier: the cable loads the film."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Farads, Ohms
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.simulators.linear.lti import StateSpace, first_order_high_pass
from palpate.simulators.physics.effect import AmplifierEffect, Kind


class VoltageAmplifier(AmplifierEffect):
    """Gain C / (C + cable) of each film's capacitance, and a high-pass of R (C + cable).

    The films differ in capacitance, so the gain does not cancel in the force ratio. A leak is across the input.

    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False
    excludes: ClassVar[tuple[str, ...]] = ("charge_amplifier",)

    # capacitance of the films: the disc under the tooth, the square under the base [S]
    disc: Farads = Field(default=26e-12, ge=1e-15, le=1e-6)
    square: Farads = Field(default=425e-12, ge=1e-15, le=1e-6)
    # [A]
    cable: Farads = Field(default=100e-12, ge=0, le=1e-6)
    resistance: Ohms = Field(default=1e9, ge=1, le=1e15)

    def system(self, film: Film, design: Design, leakage: float) -> StateSpace:
        capacitance = self.disc if film.kind == FILM_KINDS[0] else self.square
        conductance = 1 / self.resistance + leakage
        divider = capacitance / (capacitance + self.cable)
        passed = first_order_high_pass((capacitance + self.cable) / conductance)
        return replace(passed, c=divider * passed.c, d=divider * passed.d)
