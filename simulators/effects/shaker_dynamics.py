"""The shaker has a coil, a mass and friction: it does not follow its voltage at once."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Henries, Kilograms, NewtonSecondsPerMetre
from palpate.simulators.physics.chain import Armature, Limits
from palpate.simulators.physics.effect import Kind, ShakerEffect


class ShakerDynamics(ShakerEffect):
    """L i' = u - R i - Bl v and m x'' = Bl i - c x' - k x - F; R, Bl and k are the scene's."""

    kind: ClassVar[Kind] = "lti"
    cancels_in_ratio: ClassVar[bool] = True

    # [A]
    inductance: Henries = Field(default=1e-4, ge=1e-9, le=1)
    mass: Kilograms = Field(default=0.03, ge=1e-6, le=100)
    damping: NewtonSecondsPerMetre = Field(default=2.0, ge=0, le=1e4)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return replace(armature, inductance=self.inductance, mass=self.mass, damping=self.damping), limits
