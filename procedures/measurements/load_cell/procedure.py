"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1; runs and positions as in ISO 376)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated

from palpate.drivers.bench import Bench
from palpate.drivers.roles import LoadIndicator, Positioner, why_invalid
from palpate.instrument.calibration.load_cell_fit import STANDARD_GRAVITY, THESIS_LOAD_CELL, calibrate_load_cell
from palpate.instrument.errors import DeviceError, RangeError, quoted
from palpate.instrument.quantity import counted, show
from palpate.procedures.engine.plan import MOUNTING, Plan, Step
from palpate.procedures.engine.procedure import Finished, Measurement, Procedure, Report
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import keep, load_cell_path
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.session import Kept
from palpate.procedures.measurements.load_cell.expected import expected_sensitivity
from palpate.procedures.measurements.load_cell.result import (
    CREEP_TIMES,
    FILTER,
    SETTLING,
    LoadCellPoint,
    LoadCellResult,
    runs_of,
)
from palpate.procedures.measurements.load_cell.wanted_class import check_class
from palpate.procedures.measurements.settings import ValidDays
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.indicator import steady
from palpate.procedures.steps.policy import carry_out

LOADS = tuple(1e-3 * m * STANDARD_GRAVITY for m in range(140, 741, 100))  # N, Table 5.1
REPEATS = 10  # readings of each weight
INTERVAL = 0.1  # s between two readings: the display is updated ten times a second
RECOVERY = 300.0  # s without load before the creep test, so that the creep of the runs is gone
# The zero may move in a run by these steps of the display plus this fraction of the span [A]; ISO 376 has 0.1 %.
RETURN_STEPS, RETURN_OF_SPAN = 1.5, 0.01
LONGEST_VALIDITY = 791  # days: 26 months, ISO 376
CREEP, ZERO_BEFORE, ZERO_AFTER, LOADING, UNLOADING = "creep", "zero_before", "zero_after", "loading", "unloading"
PLACING = 10.0  # s that a person takes to change the weights [A]


@dataclass(frozen=True, slots=True)
class WeightStep(Step):
    """One weight on the load cell.

    Attributes:
        position_deg: position of the cell about its axis.
        run: number of the run, from 1.
        direction: "loading", "unloading", "zero_before", "zero_after", or "creep_..._s".
        load_N: the load.
        creep_s: time since the weight was placed [s]; 0: no creep test, it is read once it has settled.
    """

    position_deg: float
    run: int
    direction: str
    load_N: float
    creep_s: float = 0.0


@dataclass(frozen=True)
class LoadCellSeries(Procedure[WeightStep, LoadCellPoint, LoadCellResult]):
    """Calibrate the load cell with dead weights, put on and taken off in steps."""

    name = "calibrate-load-cell"
    point = LoadCellPoint
    calibrating = "load cell"
    manual_work = "places the weights"
    constants = MappingProxyType({"repeats": REPEATS})
    newer_settings = frozenset({"runs", "positions", "degree", "creep", "valid_days", "iso_class"})

    loads: Annotated[tuple[float, ...], Setting("N", "Increasing weights.")] = LOADS
    runs: Annotated[int, Setting(help="Runs up and down in each position; 2 give repeatability.")] = 1
    positions: Annotated[tuple[float, ...], Setting(help="Positions of the cell about its axis, in degrees.")] = (0.0,)
    degree: Annotated[
        int | None, Setting(help="Degree of the curve, 1 or 2 (default: 2 if an F-test finds it better).")
    ] = None
    creep: Annotated[bool, Setting(help="Watch the greatest load for 300 s.")] = False
    valid_days: ValidDays = 365
    iso_class: Annotated[str | None, Setting(help="Class of ISO 376 that shall be reached: 00, 0.5, 1 or 2.")] = None

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: a load is not positive or exceeds the force limit; loads do not increase, or are too few for
                the curve; there is no run; positions repeat or are outside 0 to 360 degrees; the validity is outside
                the limits of ISO 376; the class that is asked for cannot be reached with these runs and loads.
            UnknownName: there is no such class.
        """
        loads = self.loads
        if bad := [load for load in loads if not 0 < load <= target.force_limit]:
            raise RangeError(
                f"load {bad[0]:g} N is outside 0 to {target.force_limit:g} N, the bench's force limit; take other "
                "weights"
            )
        if any(later <= load for load, later in pairwise(loads)):
            raise RangeError(f"loads {quoted(loads)} N must increase, and none may repeat; put them in order")
        least = (self.degree or 1) + 2
        if len(loads) < least:
            raise RangeError(
                f"{counted(len(loads), 'load')} cannot give a curve of degree {self.degree or 1} and its uncertainty; "
                f"use at least {least}"
            )
        if self.runs < 1:
            raise RangeError(f"{counted(self.runs, 'run')} give no reading; take 1 or more")
        positions = self.positions
        if not positions or len(set(positions)) < len(positions) or not all(0 <= p < 360 for p in positions):
            raise RangeError(
                f"positions {positions} must be distinct, from 0 to below 360 degrees, such as 0, 120, 240"
            )
        if not 1 <= self.valid_days <= LONGEST_VALIDITY:
            raise RangeError(
                f"validity of {self.valid_days} days is outside 1 to {LONGEST_VALIDITY}, the 26 months of ISO 376; "
                "give one inside"
            )
        if self.iso_class is not None:
            cell = target.load_cell or THESIS_LOAD_CELL
            check_class(self.iso_class, self.loads, self.runs, self.positions, cell)

    def plan(self, target: Target) -> Plan[WeightStep]:
        """All points: every weight of every run, then the creep test."""
        steps = list(self._steps())
        readings = 2 * REPEATS * self.runs * len(self.positions)
        cell = target.load_cell or THESIS_LOAD_CELL
        return Plan(self.name, steps, predicted(steps, expected_sensitivity(self.loads, readings, self.degree, cell)))

    def _steps(self) -> Iterator[WeightStep]:
        several = len(self.positions) > 1
        for position in self.positions:
            group = f"turn the load cell to {position:g} degrees" if several else "take all weights off"
            for number in range(1, self.runs + 1):
                weights = [(ZERO_BEFORE, 0.0), *((LOADING, load) for load in self.loads)]
                weights += [*((UNLOADING, load) for load in reversed(self.loads)), (ZERO_AFTER, 0.0)]
                for direction, load in weights:
                    what = f"{direction}, {1e3 * load / STANDARD_GRAVITY:.0f} gf"
                    turning = MOUNTING if several and number == 1 and direction == ZERO_BEFORE else 0.0
                    seconds = turning + PLACING + SETTLING + (REPEATS - 1) * INTERVAL
                    yield WeightStep(None, seconds, None, position, number, direction, load, what=what, group=group)
        for before, time in pairwise((-RECOVERY, *CREEP_TIMES)) if self.creep else ():
            direction, last = f"{CREEP}_{time:.0f}_s", (self.positions[-1], self.runs)
            yield WeightStep(
                None, time - before, None, *last, direction, self.loads[-1], time, what=direction, group=group
            )

    def begin(self, lab: Lab, record: Recorder) -> Weighing:
        return Weighing(lab.bench, self)

    def evaluate(self, points: Sequence[LoadCellPoint], lab: Lab) -> LoadCellResult:
        indicator = lab.bench.role(LoadIndicator)
        calibration = calibrate_load_cell(
            self.loads,
            list(runs_of(points, len(self.loads))),
            indicator.resolution_mV,
            degree=self.degree,
            creep_mV=points[-1].reading_mV - points[-2].reading_mV if self.creep else None,
            gage_factor=indicator.gage_factor,
            device=indicator.serial or "unknown",
            simulated=lab.bench.simulated,
            source=lab.run,
            created=lab.started.isoformat(timespec="seconds"),
            expires=(lab.started + timedelta(days=self.valid_days)).date().isoformat(),
        )
        return LoadCellResult(calibration, points)

    def save_calibration(self, done: Finished[LoadCellResult]) -> Kept:
        from palpate.procedures.measurements.load_cell.certificate import write_certificate

        found = done.result.calibration
        path = load_cell_path(done.session.bench.role(LoadIndicator).serial)
        keep(found, done.folder, done.replayed, path)
        certificate = write_certificate(done.folder, found)
        return {"calibration": found.source, "calibration_file": str(path), "certificate": str(certificate)}

    def report(self, result: LoadCellResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.load_cell.report import plot_load_cell, print_load_cell

        return Report(
            partial(print_load_cell, result, self.iso_class), partial(plot_load_cell, result, lab.bench.simulated)
        )


class Weighing:
    """The bench work: reads the load cell under one weight after the other."""

    def __init__(self, bench: Bench, series: LoadCellSeries) -> None:
        self._bench, self._series = bench, series
        indicator = bench.role(LoadIndicator)
        bench.rest()
        bench.role(Positioner).home()
        indicator.clear_tare()
        indicator.track(FILTER)
        self._resolution_mV = indicator.read().resolution_mV
        self._zero_mV = self._span_mV = 0.0
        self._creeping_ns = 0

    def arrange(self, step: WeightStep) -> None:
        if len(self._series.positions) > 1:
            self._bench.operator.turn_load_cell(step.position_deg)

    def take(self, step: WeightStep) -> Measurement[LoadCellPoint]:
        if step.creep_s:
            self._creep(step)
        else:
            self._bench.operator.place_weight(step.load_N / STANDARD_GRAVITY)
            self._bench.clock.wait(SETTLING)
        point = self._read(step)
        error = None
        if step.direction == ZERO_BEFORE:
            self._zero_mV = point.reading_mV
        elif step.direction == LOADING:
            self._span_mV = point.reading_mV - self._zero_mV
        elif step.direction == ZERO_AFTER:
            error = self._drift(self._zero_mV, point.reading_mV, self._span_mV)
        return Measurement(point, error=error)

    def end(self) -> None:
        if self._series.creep:
            self._bench.operator.place_weight(0.0)

    def _creep(self, step: WeightStep) -> None:
        """Wait until the greatest load has been on the cell for the step's time; the first step has it placed."""
        bench, clock = self._bench, self._bench.clock
        if step.creep_s == CREEP_TIMES[0]:
            clock.wait(RECOVERY)
            bench.operator.place_weight(step.load_N / STANDARD_GRAVITY)
            self._creeping_ns = clock.now_ns()
        clock.wait(step.creep_s - (clock.now_ns() - self._creeping_ns) * 1e-9)

    def _read(self, step: WeightStep) -> LoadCellPoint:
        what = f"{step.direction}, {show(step.load_N, 'N')}"
        again = partial(self._bench.clock.wait, SETTLING)
        values = carry_out(self._bench, what, partial(_displays, self._bench), again=again)
        return LoadCellPoint(
            position_deg=step.position_deg,
            run=step.run,
            direction=step.direction,
            load_gf=round(1e3 * step.load_N / STANDARD_GRAVITY, 6),
            load_N=step.load_N,
            reading_mV=sum(values) / len(values),
            readings_mV=tuple(values),
            incidents=self._bench.incidents.new(),
        )

    def _drift(self, before: float, after: float, span: float) -> DeviceError | None:
        """An error if the zero has moved too far from before to after a run [mV]; else None."""
        allowed = RETURN_STEPS * self._resolution_mV + RETURN_OF_SPAN * abs(span)
        if not abs(after - before) <= allowed:
            name = self._bench.role(LoadIndicator).name
            return DeviceError(
                f"{name}: in a run the zero moved from {before:.4g} to {after:.4g} mV, by more than {allowed:.2g} mV; "
                "let cell and indicator warm up, look for loose wires, and calibrate again",
                device=name,
            )
        return None


def _displays(bench: Bench) -> list[float]:
    values = []
    for number in range(REPEATS):
        if number:
            bench.clock.wait(INTERVAL)
        reading = steady(bench)
        if not reading.valid:
            name = bench.role(LoadIndicator).name
            raise DeviceError(
                f"{name}: {why_invalid(reading)}; check the cell and wait until the weight rests", device=name
            )
        values.append(reading.reading_mV)
    return values
