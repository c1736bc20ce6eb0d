"""The converter of a sensor node: steps and a rail."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from palpate.simulators.bounds.changes import bound_of
from palpate.simulators.effects.effect import Bound, Case, Effect, Floats, Kind
from palpate.simulators.physics.converter import FINEST, convert


class Adc(Effect):
    """Rounds to 2**bits steps over plus and minus the range, and saturates with a flag.

    Without this effect the samples are still rounded to the 16 bits that travel on the bus, and end at their rail.
    """

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = False

    # 16 bit [A]
    bits: int = Field(default=16, ge=4, le=FINEST, strict=True)

    def convert(self, fraction: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        """Converted samples and saturation flags of samples given as a fraction of the range."""
        return convert(fraction, self.bits)

    def bound(self, case: Case) -> Bound:
        """Against samples that are not rounded at all."""
        return bound_of(case, self)
