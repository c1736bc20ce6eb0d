"""The charge amplifier forgets: its feedback resistor drains the integrator."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Ohms, Seconds, Volts
from palpate.instrument.sensor.design import Design, Film
from palpate.simulators.linear.lti import StateSpace, first_order_high_pass
from palpate.simulators.physics.effect import AmplifierEffect, Kind


class ChargeAmplifier(AmplifierEffect):
    """First-order high-pass. Equal time constants cancel in the force ratio.

    Its input is a virtual ground, so a leak of the film does not change the time constant. But a leak amplifies the
    input's offset, which is trimmed for a film without leak.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True
    excludes: ClassVar[tuple[str, ...]] = ("voltage_amplifier",)

    # 1 GOhm times 1 nF [A]; the limits are far beyond any that is built
    time_constant: Seconds = Field(default=1.0, ge=1e-9, le=1e9)
    feedback: Ohms = Field(default=1e9, ge=1, le=1e15)
    # [A]
    input_offset: Volts = Field(default=1e-3, ge=-1, le=1)

    def system(self, film: Film, design: Design, leakage: float) -> StateSpace:
        return first_order_high_pass(self.time_constant)

    def offset(self, film: Film, design: Design, leakage: float) -> float:
        return self.input_offset * self.feedback * leakage
