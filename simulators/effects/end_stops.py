"""The armature's travel ends at stops."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from palpate.instrument.quantity import Metres, NewtonsPerMetre
from palpate.simulators.bounds.changes import NEARER, bound_of_limit
from palpate.simulators.effects.effect import Bound, Case, Kind, ShakerEffect
from palpate.simulators.physics.parts import Armature, Limits


class EndStops(ShakerEffect):
    """Springs that the armature meets at plus and minus its travel."""

    kind: ClassVar[Kind] = "static_nl"
    cancels_in_ratio: ClassVar[bool] = True

    # [A]
    travel: Metres = Field(default=8e-3, gt=0, le=1)
    stiffness: NewtonsPerMetre = Field(default=1e6, gt=0, le=1e9)

    def shaker(self, armature: Armature, limits: Limits) -> tuple[Armature, Limits]:
        return armature, replace(limits, stop=self.travel, stop_stiffness=self.stiffness)

    def bound(self, case: Case) -> Bound:
        """Nothing where no stop is met."""
        return bound_of_limit(case, self.model_copy(update={"travel": NEARER * self.travel}), "stop")
