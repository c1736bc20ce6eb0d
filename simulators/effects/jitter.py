"""Samples are taken a little early or late."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, cast

from pydantic import Field

from instrument.design import Film
from instrument.quantity import Seconds
from simulators.effects.effect import Bound, Case, Floats, HysteresisEffect, InputEffect, Kind
from simulators.linear.lti import Times
from simulators.planning.changes import of_source
from simulators.planning.pickup import SIGMAS, signal, spread
from simulators.randomness import Stream

if TYPE_CHECKING:
    from simulators.effects.pyroelectric import Pyroelectric
    from simulators.effects.triboelectric import Triboelectric


class Jitter(InputEffect):
    """Adds the signal's rate times a normal delay: independent for each sample of each channel.

    What the first order leaves out is (2 pi f delay)^2 / 2 of the amplitude: 2e-7 at 10 Hz.
    """

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # standard deviation of the delay [A]
    delay: Seconds = Field(default=10e-6, ge=0, le=1e-3)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """What the delays change, shape (n,)."""
        moving = rates()
        if not moving.any():
            return moving  # a channel without a film costs nothing
        late = self.delay * moving
        late *= stream.normal(int(time_ns[0]) // period_ns, len(time_ns))
        return late

    def error(self, case: Case, film: Film) -> float:
        """Six standard deviations of a fit to noise of the film's greatest rate [V]."""
        # An amplifier that drains the preload adds at most 1 / (e t) of it to the rate, t after the change.
        draining = (case.preload + case.amplitude) / case.amplitude / (math.e * case.settled)
        swing, drift = signal(case, film), 0.0
        for effect in case.effects.values():
            if isinstance(effect, HysteresisEffect) and effect.path == film.kind:
                swing *= 1 + sum(abs(weight) for weight in effect.plays().weights)
        moving = cast("Triboelectric | None", case.effects.get("triboelectric"))
        warming = cast("Pyroelectric | None", case.effects.get("pyroelectric"))
        if moving is not None:
            swing += moving.error(case, film)
        if warming is not None:
            drift = warming.rate(film)
        return SIGMAS * spread(case) * self.delay * ((2 * math.pi * case.frequency + draining) * swing + drift)

    def bound(self, case: Case) -> Bound:
        return of_source(case, self)
