"""The generator counts: it gives the nearest frequency that its accumulator has."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from instrument.quantity import Hertz
from simulators.changes import BEYOND, Change, bound_of, fitted, gains
from simulators.effects.effect import Bound, Case, DriveEffect, Kind
from simulators.lti import HERTZ


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
        rig = case.driven(case.effects)
        factors = gains(rig, true) / gains(rig, case.frequency)
        force = bound_of(case, [Change((most + least) / 2 * f, (most - least) / 2 * abs(f)) for f in factors]).force
        # The films share the frequency, so their fits differ by the phase between them alone.
        apart = float(np.ptp(np.angle(factors)))
        reach = ((most / least) ** 2 - 1) * apart
        return Bound(force, bound_of(case, [Change(f, reach * abs(f)) for f in factors]).ratio)
