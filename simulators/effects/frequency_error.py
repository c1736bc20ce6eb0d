"""The generator counts: it gives the nearest frequency that its accumulator has."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from instrument.quantity import Hertz
from simulators.effects.effect import Bound, Case, DriveEffect, HysteresisEffect, Kind
from simulators.linear.periodic import HERTZ
from simulators.planning.changes import BEYOND, Change, bound_of, diluted, gains, nonlinear
from simulators.planning.fits import fitted, left_over
from simulators.planning.pickup import Additive


class FrequencyError(DriveEffect):
    """Direct digital synthesis: a word W is added at each tick of the clock, and gives W clock / 2**bits.

    With 28 bits and 25 MHz a step is 93 mHz, and 10 Hz comes as 9.9652 Hz. A frequency below half a step comes as none.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True

    # of the accumulator, and its clock [A]
    bits: Literal[28, 48] = 48
    clock: Hertz = Field(default=25e6, ge=1e6, le=1e9)

    def frequency(self, nominal: int) -> int:
        clock, steps = round(self.clock * HERTZ), 1 << self.bits
        word = (2 * nominal * steps + clock) // (2 * clock)
        return (2 * word * clock + steps) // (2 * steps)

    def bound(self, case: Case) -> Bound:
        """A fit of the nominal frequency to the true one, at any phase, and what the chain makes of the difference."""
        true = self.frequency(round(case.frequency * HERTZ)) / HERTZ
        least, most = fitted(case, true)
        if not 0 < least <= most < math.inf:
            return BEYOND
        rig, tuned = case.driven({**case.effects, "frequency_error": self}), case.driven(case.effects)
        if nonlinear(case, rig) or nonlinear(case, tuned):
            return BEYOND
        was = gains(tuned, case.frequency)
        became = gains(rig, true)
        factors, left = became / was, (left_over(case, rig) + left_over(case, tuned)) / abs(was)
        # What is added keeps its phase while the drive's own runs away.
        turned = min(2.0, 2 * np.pi * abs(true - case.frequency) * (case.settled + case.dwell))
        whole = [
            Change((most + least) / 2 * f, (most - least) / 2 * abs(f) + rest + 2 * turned * added)
            for f, rest, added in zip(factors, left, diluted(case), strict=True)
        ]
        if any(isinstance(e, Additive | HysteresisEffect) or name == "adc" for name, e in case.effects.items()):
            return bound_of(case, whole)
        # The films share the frequency, so their fits differ by the phase between them alone.
        reach = ((most / least) ** 2 - 1) * float(np.ptp(np.angle(became / became[0])))
        apart = [Change(f, reach * abs(f) + rest / least) for f, rest in zip(factors, left, strict=True)]
        return Bound(bound_of(case, whole).force, bound_of(case, apart).ratio)
