"""White noise at the input of the converter."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from instrument.quantity import VoltsPerRootHertz
from simulators.effects.effect import Effect, Kind
from simulators.randomness import Stream


class WhiteNoise(Effect):
    """Independent on each channel of each node; an anti-alias filter at half the sample rate is assumed."""

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # one-sided [A]
    density: VoltsPerRootHertz = Field(default=2e-6, ge=0)

    def samples(self, stream: Stream, first: int, count: int, rate: float) -> npt.NDArray[np.float64]:
        """Noise voltages of samples `first` to `first + count - 1` at `rate` Hz, shape (count,)."""
        return self.density * math.sqrt(rate / 2) * stream.normal(first, count)
