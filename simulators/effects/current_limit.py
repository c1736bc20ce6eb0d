"""The power amplifier limits its current."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Amperes
from palpate.simulators.bounds.changes import NEARER, bound_of_limit
from palpate.simulators.effects.effect import Bound, Case, Kind, ShakerEffect
from palpate.simulators.physics.parts import Armature, Limits


class CurrentLimit(ShakerEffect):
    """Current in the coil between plus and minus the limit."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # [A]
    limit: Amperes = Field(default=5.0, gt=0, le=1000)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, current=self.limit)

    def bound(self, case: Case) -> Bound:
        """Nothing where the limit is certainly not reached."""
        return bound_of_limit(case, self.model_copy(update={"limit": NEARER * self.limit}), "current")
