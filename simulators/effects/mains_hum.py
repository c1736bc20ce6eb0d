"""The mains couple into the films' leads."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.quantity import Hertz, Volts
from palpate.simulators.bounds import largest_tone
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic
from palpate.simulators.physics.effect import Case, InputEffect, Kind, Rates
from palpate.simulators.randomness import BLOCK, Stream


class MainsHum(InputEffect):
    """A sine, the same on all channels of all nodes; its phase is an integer count and never drifts."""

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False
    common: ClassVar[bool] = True

    # 1 mV [A]
    amplitude: Volts = Field(default=1e-3, ge=0, le=10)
    # 50 Hz in Europe, 60 Hz in America [S]
    frequency: Hertz = Field(default=50.0, ge=1e-3, le=1000)
    # phase when the bench is opened, in cycles [A]
    phase: float = Field(default=0.0, ge=0, lt=1, strict=True)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """The hum at integer multiples of the sample period, shape (n,), not to be written to."""
        phase, frequency = round(self.phase * CYCLE), round(self.frequency * HERTZ)
        hum = Periodic(0.0, frequency, 0, phase, np.array([1]), np.array([-1j * self.amplitude]))
        repeat = hum.repeat(period_ns)
        if repeat > BLOCK:
            volts: Floats = hum.summed(hum.amplitude[np.newaxis], time_ns, period_ns)[0]
            return volts
        start = int(time_ns[0]) // period_ns % repeat
        key, end = (self, period_ns), start + len(time_ns)
        values: Floats | None = stream.kept.get(key)
        if values is None or len(values) < end:
            values = stream.kept[key] = np.tile(hum.at(period_ns * np.arange(repeat)), -(-end // repeat) + 1)
            values.flags.writeable = False
        return values[start:end]

    def error(self, case: Case, rates: Rates) -> float:
        """Greatest change of an amplitude by hum [V]; over whole cycles of both only the trend lets some through."""
        return self.amplitude * largest_tone(case, self.frequency)

    def largest(self, case: Case, rates: Rates) -> float:
        return self.amplitude
