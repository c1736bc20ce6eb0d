"""Load cell, Wheatstone bridge and the display of the strain indicator."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from instrument.quantity import Volts, VoltsPerNewton
from simulators.effects.effect import Bound, Case, Effect, Kind
from simulators.randomness import Stream


class LoadCell(Effect):
    """What the display makes of the load: zero offset, noise, and steps of one count.

    The offset is the display's own, behind its detector: it stands in static and in peak-to-peak readings.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # at gage factor 8.98: the slope of Table 5.1 [T]
    sensitivity: VoltsPerNewton = Field(default=10.306e-3, gt=0, le=10)
    # the intercept of Table 5.1 [T]
    zero: Volts = Field(default=1.81e-3, ge=-0.1, le=0.1)
    # standard deviation of one reading: loading and unloading in Table 5.1 differ by 0 or 1 count [A]
    noise: Volts = Field(default=0.3e-3, ge=0, le=0.1)
    # decimals of the display: Table 5.1 has none [T]
    decimals: int = Field(default=0, ge=0, le=4, strict=True)

    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        """The reading in mV at display update number `update` of a bridge that should read `ideal_mV`."""
        noise = self.noise * float(stream.normal(update, 1)[0])
        return round(ideal_mV + 1e3 * (self.zero + noise), self.decimals)

    def bound(self, case: Case) -> Bound:
        """The films do not pass the load cell; it shows in what load is read, and set."""
        return Bound(0.0, 0.0)
