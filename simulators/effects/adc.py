"""The converter of a sensor node: steps and a rail."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from palpate.instrument.arrays import Floats
from palpate.simulators.physics.converter import FINEST, convert
from palpate.simulators.physics.effect import ConverterEffect, Kind


class Adc(ConverterEffect):
    """Rounds to 2**bits steps over plus and minus the range, and saturates with a flag.

    Without this effect samples are still rounded to the 16 bits of the bus and end at their rail. Its bound compares
    with samples that are not rounded at all.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = False

    # 16 bit [A]
    bits: int = Field(default=16, ge=4, le=FINEST, strict=True)

    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        return convert(fraction, self.bits)
