"""The armature's travel ends at stops."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Metres, NewtonsPerMetre
from palpate.simulators.physics.chain import Armature, Limits
from palpate.simulators.physics.effect import Kind, ShakerEffect


class EndStops(ShakerEffect):
    """Springs that the armature meets at plus and minus its travel."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True
    moves: ClassVar[str] = "stop"

    # [A]
    travel: Metres = Field(default=8e-3, ge=1e-6, le=1)
    stiffness: NewtonsPerMetre = Field(default=1e6, ge=1, le=1e9)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, stop=self.travel, stop_stiffness=self.stiffness)

    def nearer(self, share: float) -> EndStops:
        return self.model_copy(update={"travel": share * self.travel})
