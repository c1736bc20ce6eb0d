"""A procedure of one's own, in twenty lines: hold a preload and read the load falling."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import palpate


@dataclass(frozen=True)
class Held:
    time_s: float
    load_N: float


@dataclass(frozen=True)
class Relaxation(palpate.Procedure[palpate.Step, Held, palpate.SimpleResult[Held]]):
    name, point = "relaxation", Held
    sample: str = "2"
    force: Annotated[float, palpate.Setting("N", "With which the probe presses.")] = 2.0
    readings: int = 4

    def plan(self, target: palpate.Target) -> palpate.Plan[palpate.Step]:
        return palpate.Plan(self.name, [palpate.Step(None, 5.0, None)] * self.readings)

    def begin(self, plan: palpate.Plan, lab: palpate.Lab, record: palpate.Recorder) -> "Holding":
        return Holding(lab, self.sample, self.force)

    def evaluate(self, points: Sequence[Held], plan: palpate.Plan, lab: palpate.Lab) -> palpate.SimpleResult[Held]:
        return palpate.SimpleResult(points, {"relaxed": 1 - points[-1].load_N / points[0].load_N})


class Holding(palpate.StaticLoadWork):
    def take(self, step: palpate.Step) -> palpate.Measurement[Held]:
        self.bench.clock.wait(step.seconds)
        return palpate.Measurement(Held(self.bench.clock.now_ns() / 1e9, self.load()))
