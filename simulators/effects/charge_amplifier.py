"""The charge amplifier forgets: its feedback resistor drains the integrator."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from instrument.design import Design, Film
from instrument.quantity import Seconds
from simulators.effects.effect import AmplifierEffect, Kind
from simulators.lti import StateSpace, first_order_high_pass


class ChargeAmplifier(AmplifierEffect):
    """First-order high-pass. Equal time constants cancel in the force ratio."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True

    # 1 GOhm times 1 nF [A]; the limits are far beyond any that is built
    time_constant: Seconds = Field(default=1.0, ge=1e-9, le=1e9)

    def system(self, film: Film, design: Design, leakage: float) -> StateSpace:
        return first_order_high_pass(self.time_constant)
