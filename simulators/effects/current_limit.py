"""The power amplifier limits its current."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Amperes
from palpate.simulators.physics.chain import Armature, Limits
from palpate.simulators.physics.effect import Kind, ShakerEffect


class CurrentLimit(ShakerEffect):
    """Limits the current in the coil to plus and minus the limit."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True
    moves: ClassVar[str] = "current"

    # [A]
    limit: Amperes = Field(default=5.0, ge=1e-3, le=1000)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, current=self.limit)

    def nearer(self, share: float) -> CurrentLimit:
        return self.model_copy(update={"limit": share * self.limit})
