"""Humidity creeps into the films' insulation."""

from __future__ import annotations

import math
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Ohms, Seconds
from palpate.simulators.physics.effect import Kind, LeakEffect

EPOCHS = 1000  # number of steps in which the leak changes, each by 0.9 % with the default parameters


class HumidityLeak(LeakEffect):
    """The resistance across films falls exponentially from `dry` to `wet`, from the bench's opening on.

    A charge amplifier then gives an offset, and a voltage amplifier loses low frequencies. Without an amplifier nothing
    loads the films.
    """

    kind: ClassVar[Kind] = "ltv"
    cancels_in_ratio: ClassVar[bool] = False

    # [A]
    dry: Ohms = Field(default=1e12, ge=1e3, le=1e18)
    wet: Ohms = Field(default=1e8, ge=1e3, le=1e18)
    over: Seconds = Field(default=3600.0, ge=1, le=1e8)

    @property
    def epoch_ns(self) -> int:
        return round(1e9 * self.over / EPOCHS)

    def conductance(self, time: float) -> float:
        return math.exp(math.log(self.wet / self.dry) * -min(time / self.over, 1.0)) / self.dry

    def held(self, conductance: float) -> HumidityLeak:
        return self.model_copy(update={"dry": 1 / conductance, "wet": 1 / conductance})
