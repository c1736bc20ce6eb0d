"""The converter of a sensor node: steps and a rail."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from simulators.effects.effect import Effect, Kind


class Adc(Effect):
    """Rounds to 2**bits steps over plus and minus the range, and saturates with a flag.

    Without this effect the samples are still rounded to the 16 bits that travel on the bus.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = False

    # 16 bit [A]
    bits: int = Field(default=16, ge=4, le=16, strict=True)

    def convert(self, fraction: npt.NDArray[np.float64]) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range."""
        half = 2.0 ** (self.bits - 1)
        code = np.rint(fraction * half)
        saturated = ~((code >= -half) & (code <= half - 1))
        return np.clip(code, -half, half - 1) / half, saturated
