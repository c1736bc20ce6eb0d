"""The power amplifier clips at its rail."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Volts
from palpate.simulators.physics.chain import Armature, Limits
from palpate.simulators.physics.effect import Kind, ShakerEffect


class AmplifierClip(ShakerEffect):
    """Limits the voltage at the coil to plus and minus the rail."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True
    moves: ClassVar[str] = "rail"

    # [A]
    rail: Volts = Field(default=20.0, ge=1e-3, le=1000)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, rail=self.rail)

    def nearer(self, share: float) -> AmplifierClip:
        return self.model_copy(update={"rail": share * self.rail})
