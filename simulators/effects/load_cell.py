"""Load cell, Wheatstone bridge and the display of the strain indicator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.instrument.quantity import Seconds, Volts, VoltsPerNewton
from palpate.simulators.physics.effect import Bound, Case, CellEffect, Kind
from palpate.simulators.randomness import Stream


class LoadCell(CellEffect):
    """The display of the load: zero offset, noise and steps of one count, and on request creep and position.

    The offset is the display's own, behind its detector, so it is in static and in peak-to-peak readings.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # at gage factor 8.98: the slope of Table 5.1 [T]
    sensitivity: VoltsPerNewton = Field(default=10.306e-3, ge=1e-9, le=10)
    # the intercept of Table 5.1 [T]
    zero: Volts = Field(default=1.81e-3, ge=-0.1, le=0.1)
    # standard deviation of one reading: loading and unloading in Table 5.1 differ by 0 or 1 count [A]
    noise: Volts = Field(default=0.3e-3, ge=0, le=0.1)
    # decimals of the display: Table 5.1 has none [T]
    decimals: int = Field(default=0, ge=0, le=4, strict=True)
    # creep under dead weights as a fraction of the load, with the time constant; ISO 376 class 2 allows 0.2 % [S]
    creep: float = Field(default=0.0, ge=-0.1, le=0.1, strict=True)
    creep_time: Seconds = Field(default=100.0, ge=1, le=10_000)  # [A]
    # amplitude of the sensitivity over the sine of the cell's position, relative; class 2 allows 0.4 % in total [S]
    position_spread: float = Field(default=0.0, ge=0, le=0.1, strict=True)

    @property
    def digits(self) -> int:
        return self.decimals

    def crept(self, force: float, placed: Sequence[tuple[int, float]], now_ns: int) -> float:
        if not self.creep:
            return force
        late = (change * -math.expm1((then - now_ns) * 1e-9 / self.creep_time) for then, change in placed)
        return force + self.creep * math.fsum(late)

    def in_position(self, degrees: float) -> float:
        if not self.position_spread:
            return self.sensitivity
        return self.sensitivity * (1 + self.position_spread * math.sin(math.radians(degrees)))

    def added_mV(self, stream: Stream, first: int, count: int) -> Floats:
        """Zero offset and noise (count,) at updates of a display from that number on [mV]."""
        return 1e3 * (self.zero + stream.spread(self.noise, first, count))

    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        return round(ideal_mV + float(self.added_mV(stream, update, 1)[0]), self.decimals)

    def known_bound(self, case: Case) -> Bound:
        """The films' signals do not pass the load cell; it changes only which load is read and set."""
        return Bound(0.0, 0.0)
