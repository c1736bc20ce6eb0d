"""The sensor does not lie on the scene's model: what no model of it knows."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from palpate.instrument.sensor.sample import Sample
from palpate.simulators.bounds import SIGMAS
from palpate.simulators.physics.effect import Kind, ShareEffect
from palpate.simulators.randomness import Stream


class CurveError(ShareEffect):
    """Moves the force ratio of each object off the curve of the scene's model, for good.

    A modulus that is read off the same model's curve is then wrong, as it is on a real sensor. The natural logarithm of
    the ratio changes by `constant`, and by a part of each object, drawn by its name with the standard deviation
    `spread`. The defaults are the distance of the model "surface" from the thesis' six samples, with the opposite sign:
    `palpate model validation` lists it for each model.
    """

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = False

    constant: float = Field(default=-0.239, ge=-3, le=3, strict=True)  # [T] Tables A2.9 to A2.14, less the model
    spread: float = Field(default=0.053, ge=0, le=0.5, strict=True)  # [T] likewise

    @property
    def reach(self) -> tuple[float, float]:
        return self.constant - SIGMAS * self.spread, self.constant + SIGMAS * self.spread

    def ln_change(self, sample: Sample, stream: Stream, mounted_at_ns: int) -> float:
        return self.constant + float(stream.child(sample.name).spread(self.spread, 0, 1)[0])
