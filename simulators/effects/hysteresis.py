"""Loading and unloading take different paths: the films follow the force through play operators."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from palpate.instrument.quantity import Newtons
from palpate.simulators.physics.chain import Plays
from palpate.simulators.physics.effect import HysteresisEffect, Kind


class Hysteresis(HysteresisEffect):
    """Prandtl-Ishlinskii model: to the force x it adds weights times plays z <- max(x - r, min(x + r, z)).

    With its defaults it raises the ratio of the thesis' samples by 0.6 to 1.8 % at 3 N [M].
    """

    kind: ClassVar[Kind] = "hysteresis"
    cancels_in_ratio: ClassVar[bool] = False
    moves: ClassVar[str] = "drag"

    # weight 0.025 [A]; a radius about half the force on the tooth at 3 N [A]
    weights: tuple[Annotated[float, Field(ge=-1, le=1, strict=True)], ...] = Field(
        default=(0.025,), min_length=1, max_length=8
    )
    radii: tuple[Annotated[Newtons, Field(ge=1e-6, le=1e6)], ...] = Field(default=(0.15,), min_length=1, max_length=8)
    # the films that it acts on; on both alike it would cancel in the ratio [A]
    path: Literal["rigid", "total"] = "rigid"

    @model_validator(mode="after")
    def _fitting(self) -> Hysteresis:
        if len(self.weights) != len(self.radii):
            raise ValueError(f"{len(self.weights)} weights and {len(self.radii)} radii; give as many of each")
        slope = 1 + sum(weight for weight in self.weights if weight < 0)
        if not slope > 0:
            raise ValueError(f"weights leave a slope of {slope:g}, not above 0: more force would give less; raise them")
        return self

    def plays(self) -> Plays:
        return Plays(self.path == "total", self.radii, self.weights)
