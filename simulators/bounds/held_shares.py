"""Effects on the share of the force that teeth take, held at the ends of what they may draw.

What another effect changes grows or falls with that share, and so does what such an effect changes itself: both are
greatest at an end, or where nothing is drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar

from palpate.instrument.sensor.sample import Sample
from palpate.simulators.physics.effect import Effect, Kind
from palpate.simulators.physics.in_order import Effects
from palpate.simulators.physics.stages import ShareEffect
from palpate.simulators.randomness import Stream


class HeldShare(ShareEffect):
    """A change of the force ratio's natural logarithm by a constant."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    ln: float

    @property
    def reach(self) -> tuple[float, float]:
        return self.ln, self.ln

    def ln_change(self, sample: Sample, stream: Stream, mounted_at_ns: int) -> float:
        return self.ln


def shares(without: Effects, effect: Effect) -> Iterator[tuple[Effects, Effect]]:
    """Effects without one and that one itself, for each end of the share of the force that they may draw."""
    own = Effects({effect.name: effect}).share
    for ln in _ends(without):
        before = without.but(*without.share)
        if without.share:
            before = before.including(HeldShare(ln=ln))
        if not own:
            yield before, effect
        for change in own[0].reach if own else ():
            yield before, HeldShare(ln=ln + change)


def _ends(effects: Effects) -> tuple[float, ...]:
    """Changes of the ratio's natural logarithm: none, least and greatest."""
    if not effects.share:
        return (0.0,)
    low, high = (math.fsum(each.reach[end] for each in effects.share) for end in (0, 1))
    return tuple(sorted({low, 0.0, high}))
