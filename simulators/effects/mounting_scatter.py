"""Scatter of the force ratio: an object lies on the teeth a little differently each time it is mounted."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from palpate.instrument.sensor.sample import Sample
from palpate.simulators.bounds import SIGMAS
from palpate.simulators.physics.effect import Kind, ShareEffect
from palpate.simulators.randomness import Stream


class MountingScatter(ShareEffect):
    """Draws the force ratio anew whenever an object is mounted, so that more load sets do not average it out.

    `scatter` is the standard deviation of its natural logarithm. No experiment of the thesis tells it.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    scatter: float = Field(default=0.01, ge=0, le=0.5, strict=True)  # [A]

    @property
    def reach(self) -> tuple[float, float]:
        return -SIGMAS * self.scatter, SIGMAS * self.scatter

    def ln_change(self, sample: Sample, stream: Stream, mounted_at_ns: int) -> float:
        return float(stream.spread(self.scatter, mounted_at_ns // 1000, 1)[0])
