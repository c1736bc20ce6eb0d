"""The generator gives the nearest frequency of its accumulator."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from palpate.instrument.quantity import Hertz
from palpate.simulators.linear.periodic import HERTZ
from palpate.simulators.physics.effect import DriveEffect, Kind


class FrequencyError(DriveEffect):
    """Direct digital synthesis: adding a word W at each tick of the clock gives W clock / 2**bits.

    With 28 bits and 25 MHz a step is 93 mHz, and 10 Hz becomes 9.9652 Hz. A frequency below half a step becomes 0.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True

    # bits of the phase accumulator, and frequency of its clock [A]
    bits: Literal[28, 48] = 48
    clock: Hertz = Field(default=25e6, ge=1e6, le=1e9)

    def frequency(self, nominal: int) -> int:
        clock, steps = round(self.clock * HERTZ), 1 << self.bits
        word = (2 * nominal * steps + clock) // (2 * clock)
        return (2 * word * clock + steps) // (2 * steps)
