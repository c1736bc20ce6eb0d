"""Load cell, Wheatstone bridge and the display of the strain indicator."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from simulators.effects.effect import Effect, Kind
from simulators.randomness import Stream


class LoadCell(Effect):
    """What the display makes of the load: zero offset, noise, and steps of one count.

    The offset is the display's own, behind its detector: it stands in static and in peak-to-peak readings.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # mV [T], the intercept of Table 5.1
    zero: float = Field(default=1.81, ge=-100, le=100, strict=True)
    # mV, standard deviation of one reading: loading and unloading in Table 5.1 differ by 0 or 1 count [A]
    noise: float = Field(default=0.3, ge=0, le=100, strict=True)
    # decimals of the display: Table 5.1 has none [T]
    decimals: int = Field(default=0, ge=0, le=4, strict=True)

    def display(self, ideal_mV: float, stream: Stream, update: int) -> float:
        """The reading in mV at display update number `update` of a bridge that should read `ideal_mV`."""
        return round(ideal_mV + self.zero + self.noise * float(stream.normal(update, 1)[0]), self.decimals)
