"""Samples are taken a little early or late."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.quantity import Seconds
from palpate.simulators.bounds import SIGMAS, largest
from palpate.simulators.physics.effect import Case, InputEffect, Kind, Rates
from palpate.simulators.randomness import Stream


class Jitter(InputEffect):
    """Adds the signal's rate times a normal delay: independent for each sample of each channel with a film.

    The neglected second order is (2 pi f delay)^2 / 2 of the amplitude: 2e-7 at 10 Hz.
    """

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False
    follows: ClassVar[bool] = True

    # standard deviation of the delay [A]
    delay: Seconds = Field(default=10e-6, ge=0, le=1e-3)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Voltages (n,) by which the delays change the samples [V]."""
        if not self.delay:
            return np.zeros(len(time_ns))
        late = self.delay * rates()
        late *= stream.normal(int(time_ns[0]) // period_ns, len(time_ns))
        return late

    def error(self, case: Case, rates: Rates) -> float:
        """Six standard deviations of a fit to noise of the film's rates [V]."""
        return self.delay and self.delay * largest(case, rates() ** 2)

    def largest(self, case: Case, rates: Rates) -> float:
        return self.delay and SIGMAS * self.delay * float(np.abs(rates()).max())
