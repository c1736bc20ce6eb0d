"""Loading and unloading take different paths: the films follow the force through play operators."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from instrument.quantity import Newtons
from simulators.chain import Plays
from simulators.effects.effect import HysteresisEffect, Kind


class Hysteresis(HysteresisEffect):
    """Prandtl-Ishlinskii: the force x and, on top of it, weights times plays z <- max(x - r, min(x + r, z))."""

    kind: ClassVar[Kind] = "hysteresis"
    cancels_in_ratio: ClassVar[bool] = False

    # weights 0.025 [A]; radii spread over the forces of the load sets [A]
    weights: tuple[float, ...] = Field(default=(0.025, 0.025, 0.025), min_length=1, max_length=8)
    radii: tuple[Newtons, ...] = Field(default=(0.05, 0.1, 0.2), min_length=1, max_length=8)
    # the films that it acts on; on both alike it would cancel in the ratio [A]
    path: Literal["rigid", "total"] = "rigid"

    def plays(self) -> Plays:
        return Plays(self.path == "total", self.radii, self.weights)
