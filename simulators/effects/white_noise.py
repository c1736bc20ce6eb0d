"""White noise at the input of the converter."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

from pydantic import Field

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.quantity import VoltsPerRootHertz
from palpate.simulators.bounds import SIGMAS, spread
from palpate.simulators.physics.effect import Case, InputEffect, Kind, Rates
from palpate.simulators.randomness import Stream


class WhiteNoise(InputEffect):
    """Independent on each channel with a film; an anti-alias filter at half the sample rate is assumed."""

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # one-sided [A]
    density: VoltsPerRootHertz = Field(default=2e-6, ge=0, le=1)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Noise voltages at integer multiples of the sample period, shape (n,)."""
        return stream.spread(self.dither(1e9 / period_ns), int(time_ns[0]) // period_ns, len(time_ns))

    def error(self, case: Case, rates: Rates) -> float:
        """Six standard deviations of the fit [V]."""
        return SIGMAS * spread(case) * self.dither(case.rate)

    def largest(self, case: Case, rates: Rates) -> float:
        return SIGMAS * self.dither(case.rate)

    def noise_density(self, frequency: float) -> float:
        return self.density

    def dither(self, rate: float) -> float:
        return self.density * math.sqrt(rate / 2)
