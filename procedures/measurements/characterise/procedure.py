"""The characterisation of a sensor (thesis 2.1): loads up, loads down, then one load that is held."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

from palpate.drivers.roles import SensorNode
from palpate.instrument.allocation.lines import Costs
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import check_tolerance, counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.plan import Plan, Step, point_seconds
from palpate.procedures.engine.procedure import Measurement, Procedure, Report, RequiredLoads, until_full
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import probable_load_cell
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.measurements.characterise.repeats import Conditions, SlopeRepeats, expected_figures
from palpate.procedures.measurements.characterise.result import (
    HOLDING,
    LEAST_DRIFT_POINTS,
    LEAST_LOADS,
    LOADING,
    UNLOADING,
    CharacteriseResult,
    FilmsPoint,
    evaluate,
)
from palpate.procedures.measurements.prospects import expected_ratio
from palpate.procedures.measurements.settings import (
    DwellTime,
    Frequency,
    PeakLoads,
    SampleName,
    bench_time,
    tolerance_setting,
)
from palpate.procedures.measurements.work import DynamicLoadWork
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_bench_time, check_force, check_frequency, check_increasing, check_time
from palpate.procedures.steps.film_point import FilmPoint
from palpate.procedures.steps.films import CHARGE_AMPLIFIER, check_nodes
from palpate.procedures.steps.laps import Laps

LARGEST_DRIFT_TIME = 86_400.0  # s
DRIFT_POINTS = 10  # of the load that is held, after the first one
END = 7.0  # s, for the load cell's zero after the last point, with the probe moved home [M]
STANDING = 6 * CHARGE_AMPLIFIER  # s, until a film's offset stands still: before, steps round it anew in each record


@dataclass(frozen=True, slots=True)
class CharacteriseStep(Step):
    """One load, peak to peak. `direction` is LOADING, UNLOADING or HOLDING."""

    direction: str
    load_N: float


@dataclass(frozen=True)
class Characterisation(Procedure[CharacteriseStep, FilmsPoint, CharacteriseResult, SlopeRepeats | None]):
    """Find noise, sensitivity, resolution, linearity, hysteresis, dynamic range and drift of a sensor.

    The loads are set in increasing order, then in decreasing order. Then the middle one is held for `drift_time`. With
    a tolerance or a time, they are set in increasing order several times.
    """

    name = "characterise"
    point = FilmsPoint

    sample: SampleName = "1"
    loads: PeakLoads = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
    dwell: DwellTime = 1.0
    frequency: Frequency = 10.0
    drift_time: Annotated[float, Setting("s", "How long the middle load is held to see drift.", default="5 min")] = (
        300.0
    )
    tolerance: Annotated[
        float | None,
        tolerance_setting("of each film's force sensitivity; the loads up are repeated until all have it."),
    ] = None
    time: Annotated[
        float | None, bench_time("Bench time, which is filled with repeated loads up and not exceeded.")
    ] = None

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: there are too few loads for a line, a load exceeds the force limit, the frequency, the dwell or
                the drift time is outside its limits, or the bench has too few sensor nodes; no rounds of loads give the
                tolerance, or the time holds none.
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
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")
        check_bench_time(self.time, "30 min")

    def required_loads(self) -> RequiredLoads:
        return RequiredLoads(self.loads)

    def plan(self, target: Target) -> Plan[CharacteriseStep, SlopeRepeats | None]:
        """All points: every load up, every load down, then the middle one several times.

        With a tolerance or a time, there are the most rounds up that a run can have.
        """
        repeats = self._repeats(target)
        first, later = self._first(target), self._seconds()
        up = self.loads * (repeats.most if repeats else 1)
        steps = [self._step(LOADING, load, later if number else first) for number, load in enumerate(up)]
        steps += [self._step(UNLOADING, load, later) for load in self.loads[::-1]]
        steps += [self._step(HOLDING, self.middle, seconds) for seconds in self._holding()]
        times = [STANDING + self.interval * number for number in range(DRIFT_POINTS + 1)]
        if repeats:
            return Plan(self.name, steps, repeats.predicted(times, target.force_limit), repeats)
        found = expected_figures(self.conditions(target.design, _cell(target)), 1, times, target.force_limit)
        return Plan(self.name, steps, predicted(steps, found))

    def course(
        self, plan: Plan[CharacteriseStep, SlopeRepeats | None], points: Sequence[FilmsPoint], lab: Lab
    ) -> Generator[int, None, str]:
        """The rounds up end once they give the tolerance, or fill the time."""
        repeats = plan.basis

        def full(step: CharacteriseStep, _own: Sequence[FilmsPoint]) -> bool:
            return repeats is not None and step.direction == LOADING and repeats.has_enough(points)

        return until_full(plan.steps, points, lambda step: step.direction, full)

    def _repeats(self, target: Target) -> SlopeRepeats | None:
        """The repeated rounds, where a tolerance or a time is given; None: neither is."""
        if self.tolerance is None and self.time is None:
            return None
        later = self._seconds()
        after = len(self.loads) * later + math.fsum(self._holding()) + END
        costs = Costs(self._first(target) - later + after, 0.0, later - self.dwell)
        asked = self.conditions(target.design, _cell(target))
        return SlopeRepeats(asked, costs, after, self.tolerance, self.time, target.mounts)

    def conditions(self, design: Design, cell: LoadCellCalibration | None) -> Conditions:
        """The conditions that a plan expects; `cell` None: the load cell of the thesis."""
        ratio, loads = expected_ratio(design, self.sample), tuple(self.loads)
        return Conditions(design, ratio, loads, self.frequency, self.dwell, cell or THESIS_LOAD_CELL)

    def _first(self, target: Target) -> float:
        """Expected time of the first load, with the sample's mounting [s]."""
        return point_seconds(self.frequency, self.dwell, first=True, mounts=target.mounts)

    def _seconds(self) -> float:
        """Expected time of a load after the first one [s]."""
        return point_seconds(self.frequency, self.dwell, first=False)

    def _holding(self) -> list[float]:
        """Expected time of each point of the load that is held [s]."""
        still = point_seconds(self.frequency, self.dwell, first=False, steps=0)
        return [self._seconds() + STANDING, *[max(0.0, self.interval - self.dwell) + still] * DRIFT_POINTS]

    @property
    def middle(self) -> float:
        """The load that is held [N]."""
        return self.loads[len(self.loads) // 2]

    def _step(self, direction: str, load: float, seconds: float) -> CharacteriseStep:
        what, group = f"{direction}, {show(load, 'N')}", f"mount sample {self.sample}"
        return CharacteriseStep(self.dwell, seconds, None, direction, load, what=what, group=group)

    @property
    def interval(self) -> float:
        """Time between two points of the load that is held [s]."""
        return self.drift_time / DRIFT_POINTS

    def begin(self, plan: Plan[CharacteriseStep, SlopeRepeats | None], lab: Lab, record: Recorder) -> Characterising:
        return Characterising(lab, record, self)

    def evaluate(
        self, points: Sequence[FilmsPoint], plan: Plan[CharacteriseStep, SlopeRepeats | None], lab: Lab
    ) -> CharacteriseResult:
        widest = max(lab.bench.role(SensorNode).ranges.values())
        limit, repeats = lab.bench.force_limit, plan.basis
        if repeats is None:
            return evaluate(points, lab.design, lab.calibration, self.dwell, limit, widest)
        lines = repeats.found(points)
        found = evaluate(points, lab.design, lab.calibration, self.dwell, limit, widest, lines)
        return replace(found, stopped=repeats.stopped(found.sensitivities))

    def report(self, result: CharacteriseResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.characterise.report import plot_characteristics, show_characteristics

        simulated = lab.bench.simulated
        return Report(partial(show_characteristics, result), partial(plot_characteristics, result, simulated))


class Characterising(DynamicLoadWork):
    """The bench work: loads up, loads down, then one load that is held."""

    def __init__(self, lab: Lab, record: Recorder, asked: Characterisation) -> None:
        self._laps = Laps(lab.bench.clock, asked.time is not None)
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
        point = _point(step, time, self._laps.seconds(), measured)
        return Measurement(point, measured.waveforms(self.lab.design))


def _point(step: CharacteriseStep, time: float, seconds: float | None, measured: FilmPoint) -> FilmsPoint:
    fit = measured.fit
    return gathered(
        FilmsPoint, step, measured,
        time_s=time,
        voltages_V=tuple(float(v) for v in 2 * fit.amplitude),
        voltages_u=tuple(float(u) for u in 2 * fit.amplitude_u),
        noise_V=tuple(float(v) for v in fit.rapid.rms),
        noise_u=tuple(float(u) for u in fit.rapid.rms_u),
        noise_freedom=float(fit.rapid.degrees_of_freedom),
        noise_peak_V=tuple(float(v) for v in fit.rapid.greatest),
        samples=fit.samples,
        seconds=seconds,
    )  # fmt: skip


def _cell(target: Target) -> LoadCellCalibration | None:
    """The load cell's calibration; before the bench is open, the one that it probably has. None: none is stored."""
    return target.load_cell or probable_load_cell(target.scene)
