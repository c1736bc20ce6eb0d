"""The characterisation of a sensor (thesis 2.1): loads up, loads down, then one load that is held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated

from palpate.drivers.roles import SensorNode
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import counted, show
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Measurement, Procedure, Report, RequiredLoads
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.characterise.expected import Conditions, expected_figures
from palpate.procedures.measurements.characterise.point import HOLDING, LOADING, UNLOADING, FilmsPoint
from palpate.procedures.measurements.characterise.result import (
    LEAST_DRIFT_POINTS,
    LEAST_LOADS,
    CharacteriseResult,
    evaluate,
)
from palpate.procedures.measurements.dynamic_load import DynamicLoadWork
from palpate.procedures.measurements.prospects import expected_ratio, load_cell_of
from palpate.procedures.measurements.settings import DwellTime, Frequency, PeakLoads, SampleName
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, check_nodes

LARGEST_DRIFT_TIME = 86_400.0  # s
DRIFT_POINTS = 10  # of the load that is held, after the first one
STANDING = 6 * CHARGE_AMPLIFIER  # s, until a film's offset stands still: before, steps round it anew in each record


@dataclass(frozen=True, slots=True)
class CharacteriseStep(Step):
    """One load, peak to peak. `direction` is LOADING, UNLOADING or HOLDING."""

    direction: str
    load_N: float


@dataclass(frozen=True)
class Characterisation(Procedure[CharacteriseStep, FilmsPoint, CharacteriseResult]):
    """Find noise, sensitivity, resolution, linearity, hysteresis, dynamic range and drift of a sensor.

    The loads are set in increasing order, then in decreasing order. Then the middle one is held for `drift_time`.
    """

    name = "characterise"
    point = FilmsPoint

    sample: SampleName = "1"
    loads: PeakLoads = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    drift_time: Annotated[float, Setting("s", "Time for which the middle load is held.")] = 300.0

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: there are too few loads for a line, a load exceeds the force limit, the frequency, the dwell or
                the drift time is outside its limits, or the bench has too few sensor nodes.
            UnknownName: there is no such sample.
        """
        get_sample(self.sample)
        check_nodes(target.design, target.nodes, target.channels)
        if len(self.loads) < LEAST_LOADS:
            raise RangeError(
                f"{counted(len(self.loads), 'load')} cannot give a line with its scatter; give {LEAST_LOADS} or more"
            )
        check_force(self.loads, target.force_limit)
        check_increasing("loads", self.loads, "N")
        check_frequency(self.frequency, target)
        check_time(self.dwell, self.frequency)
        least = LEAST_DRIFT_POINTS * self.dwell
        if not least <= self.drift_time <= LARGEST_DRIFT_TIME:
            raise RangeError(
                f"drift time {self.drift_time:g} s is outside {least:g} s, {LEAST_DRIFT_POINTS} dwells, to"
                f" {LARGEST_DRIFT_TIME:g} s; give one inside"
            )

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.loads)

    def plan(self, target: Target) -> Plan[CharacteriseStep]:
        """All points: every load up, every load down, then the middle one several times."""
        middle = self.loads[len(self.loads) // 2]
        places = [(LOADING, load) for load in self.loads] + [(UNLOADING, load) for load in self.loads[::-1]]
        steps = [
            self._step(direction, load, point_seconds(self.frequency, self.dwell, first=not number))
            for number, (direction, load) in enumerate(places)
        ]
        steps.append(self._step(HOLDING, middle, point_seconds(self.frequency, self.dwell, first=False) + STANDING))
        held = self._step(HOLDING, middle, max(self.interval, self.dwell))
        steps += [held] * DRIFT_POINTS
        times = [self.interval * number for number in range(DRIFT_POINTS + 1)]
        found = expected_figures(self._conditions(target), 1, times, target.force_limit)
        return Plan(self.name, steps, predicted(steps, found))

    def _conditions(self, target: Target) -> Conditions:
        ratio = expected_ratio(target.design, self.sample)
        return Conditions(target.design, ratio, tuple(self.loads), self.frequency, self.dwell, load_cell_of(target))

    def _step(self, direction: str, load: float, seconds: float) -> CharacteriseStep:
        what, group = f"{direction}, {show(load, 'N')}", f"mount sample {self.sample}"
        return CharacteriseStep(self.dwell, seconds, None, direction, load, what=what, group=group)

    @property
    def interval(self) -> float:
        """Time between two points of the load that is held [s]."""
        return self.drift_time / DRIFT_POINTS

    def begin(self, lab: Lab, record: Recorder) -> Characterising:
        return Characterising(lab, record, self)

    def evaluate(self, points: Sequence[FilmsPoint], lab: Lab) -> CharacteriseResult:
        widest = max(lab.bench.role(SensorNode).ranges.values())
        return evaluate(points, lab.design, lab.calibration, self.dwell, lab.bench.force_limit, widest)

    def report(self, result: CharacteriseResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.characterise.report import plot_characteristics, print_characteristics

        simulated = lab.bench.simulated
        return Report(partial(print_characteristics, result), partial(plot_characteristics, result, simulated))


class Characterising(DynamicLoadWork):
    """The bench work: loads up, loads down, then one load that is held."""

    def __init__(self, lab: Lab, record: Recorder, asked: Characterisation) -> None:
        super().__init__(lab, record, asked.loads, asked.frequency, (asked.sample,))
        self._asked = asked
        self._held_ns: int | None = None  # bench time since which the last load is held

    def arrange(self, step: CharacteriseStep) -> None:
        self.press(get_sample(self._asked.sample))

    def take(self, step: CharacteriseStep) -> Measurement[FilmsPoint]:
        clock = self.lab.bench.clock
        if self._held_ns is None:
            self.set(step.load_N, step.what)
        else:
            clock.wait(max(0.0, self._asked.interval - self._asked.dwell))
        if step.direction == HOLDING and self._held_ns is None:
            self._held_ns = clock.now_ns()
            clock.wait(STANDING)
        measured = self.held(step.load_N, step.what, self._asked.dwell, compare=False)
        time = 0.0 if self._held_ns is None else 1e-9 * (clock.now_ns() - self._held_ns)
        return Measurement(_point(step, time, measured), measured.waveforms(self.lab.design))


def _point(step: CharacteriseStep, time: float, measured: FilmPoint) -> FilmsPoint:
    fit = measured.fit
    return FilmsPoint(
        direction=step.direction,
        time_s=time,
        load_N=step.load_N,
        load_measured_N=measured.load_N,
        load_measured_u=measured.load_u,
        voltages_V=tuple(float(v) for v in 2 * fit.amplitude),
        voltages_u=tuple(float(u) for u in 2 * fit.amplitude_u),
        noise_V=tuple(float(v) for v in fit.rapid.rms),
        noise_u=tuple(float(u) for u in fit.rapid.rms_u),
        noise_freedom=float(fit.rapid.degrees_of_freedom),
        noise_peak_V=tuple(float(v) for v in fit.rapid.greatest),
        samples=fit.samples,
        valid=measured.valid,
        flags=measured.flags,
        attempts=measured.attempts,
        incidents=measured.incidents,
    )
