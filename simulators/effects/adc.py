"""The converter of a sensor node: steps and a rail."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from instrument.contracts.sensor_node import RANGE_VOLTS
from simulators.effects.effect import Bound, Case, Effect, Floats, Kind
from simulators.pickup import bound, largest_within

FINEST = 16


class Adc(Effect):
    """Rounds to 2**bits steps over plus and minus the range, and saturates with a flag.

    Without this effect the samples are still rounded to the 16 bits that travel on the bus, and end at their rail.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = False

    # 16 bit [A]
    bits: int = Field(default=16, ge=4, le=FINEST, strict=True)

    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range.

        A sample that is no number is flagged and stays none.
        """
        half = 2.0 ** (self.bits - 1)
        code = np.rint(fraction * half)
        saturated = ~((code >= -half) & (code <= half - 1))
        return np.clip(code, -half, half - 1) / half, saturated

    def bound(self, case: Case) -> Bound:
        """A step of the wide range in every sample; nothing where the steps are those of the bus."""
        step = 2.0 * max(RANGE_VOLTS) / 2**self.bits if self.bits < FINEST else 0.0
        error = step * largest_within(case)
        return bound(case, lambda film: error)
