"""The power amplifier clips at its rail."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Volts
from palpate.simulators.bounds.changes import NEARER, bound_of_limit
from palpate.simulators.effects.effect import Bound, Case, Kind, ShakerEffect
from palpate.simulators.physics.parts import Armature, Limits


class AmplifierClip(ShakerEffect):
    """Voltage at the coil between plus and minus the rail."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # [A]
    rail: Volts = Field(default=20.0, gt=0, le=1000)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, rail=self.rail)

    def bound(self, case: Case) -> Bound:
        """Nothing where the rail is certainly not reached."""
        return bound_of_limit(case, self.model_copy(update={"rail": NEARER * self.rail}), "rail")
