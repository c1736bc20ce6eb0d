"""A procedure of one's own, in twenty lines: hold a preload and read the load falling."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from palpate.extend import (
    Lab,
    Measurement,
    Plan,
    Procedure,
    Recorder,
    Setting,
    SimpleResult,
    StaticLoadWork,
    Step,
    Target,
)


@dataclass(frozen=True)
class Reading:
    time_s: float
    load_N: float


@dataclass(frozen=True)
class Relaxation(Procedure[Step, Reading, SimpleResult[Reading]]):
    name, point = "relaxation", Reading
    sample: str = "2"
    force: Annotated[float, Setting("N", "With which the probe presses.")] = 2.0
    readings: int = 4

    def plan(self, target: Target) -> Plan[Step]:
        return Plan(self.name, [Step(None, 5.0, None)] * self.readings)

    def begin(self, plan: Plan, lab: Lab, record: Recorder) -> "Holding":
        return Holding(lab, self.sample, self.force)

    def evaluate(self, points: Sequence[Reading], plan: Plan, lab: Lab) -> SimpleResult[Reading]:
        return SimpleResult(points, {"relaxed": 1 - points[-1].load_N / points[0].load_N})


class Holding(StaticLoadWork):
    def take(self, step: Step) -> Measurement[Reading]:
        self.bench.clock.wait(step.seconds_expected)
        return Measurement(Reading(self.bench.clock.now_ns() / 1e9, self.load()))
