"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1; runs and positions as in ISO 376)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated

from palpate.drivers.roles import LoadIndicator
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_fit import STANDARD_GRAVITY, THESIS_LOAD_CELL, calibrate_load_cell
from palpate.instrument.errors import RangeError, UsageError, quoted
from palpate.instrument.quantity import LARGEST_TOLERANCE, check_tolerance, counted
from palpate.procedures.engine.plan import Plan, Predicted
from palpate.procedures.engine.procedure import Finished, Procedure, Report
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import keep
from palpate.procedures.lab.lab import Lab, Target
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.lab.probable import probable_load_cell
from palpate.procedures.lab.session import Kept
from palpate.procedures.measurements.load_cell.expected import expected_sensitivity
from palpate.procedures.measurements.load_cell.learned import late, learned, stopped
from palpate.procedures.measurements.load_cell.result import (
    CREEP,
    CREEP_TIMES,
    LOADING,
    REPEATS,
    UNLOADING,
    ZERO_AFTER,
    ZERO_BEFORE,
    LoadCellPoint,
    LoadCellResult,
    points_of_run,
    runs_of,
)
from palpate.procedures.measurements.load_cell.series import Wanted, most_runs, series_for, weighing_seconds
from palpate.procedures.measurements.load_cell.series import predicted as promised
from palpate.procedures.measurements.load_cell.wanted_class import ClassSeries, class_series, why_not
from palpate.procedures.measurements.load_cell.work import RECOVERY, Weighing, WeightStep
from palpate.procedures.measurements.settings import ValidDays
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import check_bench_time

LOADS = tuple(1e-3 * m * STANDARD_GRAVITY for m in range(140, 741, 100))  # N, Table 5.1
LONGEST_VALIDITY = 791  # days: 26 months, ISO 376


@dataclass(frozen=True)
class LoadCellSeries(Procedure[WeightStep, LoadCellPoint, LoadCellResult]):
    """Calibrate the load cell with dead weights, put on and taken off in steps."""

    name = "calibrate-load-cell"
    point = LoadCellPoint
    calibrates = True
    calibrating = "load cell"
    manual_work = "places the weights"
    constants = MappingProxyType({"repeats": REPEATS})
    newer_settings = frozenset(
        {"runs", "positions", "degree", "creep", "valid_days", "iso_class", "tolerance", "time", "loads_u"}
    )

    loads: Annotated[tuple[float, ...], Setting("N", "Increasing weights.")] = LOADS
    runs: Annotated[int, Setting(help="Runs up and down in each position; 2 give repeatability.")] = 1
    positions: Annotated[tuple[float, ...], Setting(help="Positions of the cell about its axis, in degrees.")] = (0.0,)
    degree: Annotated[
        int | None, Setting(help="Degree of the curve, 1 or 2 (default: 2 if an F-test finds it better).")
    ] = None
    creep: Annotated[bool, Setting(help="Watch the greatest load for 300 s.")] = False
    valid_days: ValidDays = 365
    iso_class: Annotated[str | None, Setting(help="Class of ISO 376 that shall be reached: 00, 0.5, 1 or 2.")] = None
    tolerance: Annotated[
        float | None,
        Setting(help="Relative standard uncertainty of the sensitivity: weights and runs are chosen for it."),
    ] = None
    time: Annotated[
        float | None, Setting("s", "Bench time that is not exceeded: weights and runs are chosen for it.")
    ] = None
    loads_u: Annotated[
        float, Setting(help="Relative standard uncertainty of all loads together: weights and local gravity.")
    ] = 0.0

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: a load is not positive or exceeds the force limit; loads do not increase, or are too few for
                the curve; there is no run; positions repeat or are outside 0 to 360 degrees; the validity is outside
                the limits of ISO 376; the class or the tolerance cannot be reached with these weights; the time is too
                short for one run; the loads' uncertainty is no share from 0 to below 0.5.
            UsageError: a class is given beside a tolerance or a time.
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
        if not 0 <= self.loads_u < LARGEST_TOLERANCE:
            raise RangeError(
                f"--loads-u {100 * self.loads_u:g} % is outside 0 to {100 * LARGEST_TOLERANCE:g} %; give the relative "
                "standard uncertainty of the loads, such as '0.02 %'"
            )
        if self.iso_class is not None and self._is_planned:
            other = "--time" if self.tolerance is None else "--tolerance"
            raise UsageError(f"{other} and --class: the series is planned for one of them; give one")
        check_bench_time(self.time, "5 min")
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")
        if self._is_planned:
            series_for(self._wanted(target))
        if self.iso_class is not None:
            self._class_series(self.iso_class, target)

    @property
    def _is_planned(self) -> bool:
        """Whether weights and runs are planned for a tolerance or a time."""
        return self.tolerance is not None or self.time is not None

    def _wanted(self, target: Target) -> Wanted:
        places = len(self.positions)
        asked = tuple(self.loads), self.runs, places, self.degree, _cell(target)
        return Wanted(self.tolerance, *asked, self.time, self.loads_u)

    def _class_series(self, name: str, target: Target) -> ClassSeries:
        return class_series(name, tuple(self.loads), self.runs, tuple(self.positions), _cell(target))

    def plan(self, target: Target) -> Plan[WeightStep]:
        """All points: every weight of every run, then the creep test; where runs are planned, of the most runs."""
        cell, readings = _cell(target), 2 * REPEATS * self.runs * len(self.positions)
        if self._is_planned:
            wanted = self._wanted(target)
            series = series_for(wanted)
            runs = dict.fromkeys(self.positions, most_runs(series))
            return Plan(self.name, list(self._steps(series.loads, runs)), promised(wanted, series))
        if self.iso_class is not None:
            planned = self._class_series(self.iso_class, target)
            steps = list(self._steps(planned.loads, {place: planned.runs_in(place) for place in planned.positions}))
            readings = 2 * REPEATS * sum(map(planned.runs_in, planned.positions))
            likely = predicted(steps, expected_sensitivity(planned.loads, readings, self.degree, cell, self.loads_u))
            lines = planned.lines(self.iso_class)
            expected = {"class": self.iso_class, "expected": dict(planned.expected), "binds": planned.binds}
            return Plan(self.name, steps, Predicted(likely.seconds, likely.u, {**likely.told, **expected}, lines))
        steps = list(self._steps(self.loads, dict.fromkeys(self.positions, self.runs)))
        found = expected_sensitivity(self.loads, readings, self.degree, cell, self.loads_u)
        return Plan(self.name, steps, predicted(steps, found))

    def skips(self, step: WeightStep, points: Sequence[LoadCellPoint], lab: Lab) -> bool:
        """Whether the tolerance needs no run of the step's number, or the time has no place for it."""
        if not self._is_planned or step.creep_s or step.run <= self.runs:
            return False
        wanted = self._wanted(lab.target)
        loads = series_for(wanted).loads
        runs = list(runs_of(points, len(loads)))
        part = (self.positions.index(step.position_deg) + 1) / len(self.positions)
        if late(wanted, points[: len(runs) * points_of_run(len(loads))], len(loads), part):
            return True
        return (
            self.tolerance is not None
            and step.run > learned(wanted, loads, runs, lab.bench.role(LoadIndicator).resolution_mV).runs
        )

    def enough(self, points: Sequence[LoadCellPoint], lab: Lab) -> str:
        """Why no further run can give the class."""
        if self.iso_class is None:
            return ""
        loads = self._class_series(self.iso_class, lab.target).loads
        runs = list(runs_of(points, len(loads)))
        return why_not(self.iso_class, loads, runs, lab.bench.role(LoadIndicator).resolution_mV) if runs else ""

    def _steps(self, loads: Sequence[float], runs: Mapping[float, int]) -> Iterator[WeightStep]:
        """Steps of the runs with some loads [N], as many in each position as `runs` says, and of the creep test."""
        several = len(runs) > 1
        for position, count in runs.items():
            group = f"turn the load cell to {position:g} degrees" if several else "take all weights off"
            for number in range(1, count + 1):
                weights = [(ZERO_BEFORE, 0.0), *((LOADING, load) for load in loads)]
                weights += [*((UNLOADING, load) for load in reversed(loads)), (ZERO_AFTER, 0.0)]
                for direction, load in weights:
                    what = f"{direction}, {1e3 * load / STANDARD_GRAVITY:.0f} gf"
                    turning = MOUNTING if several and number == 1 and direction == ZERO_BEFORE else 0.0
                    seconds = turning + weighing_seconds()
                    yield WeightStep(None, seconds, None, position, number, direction, load, what=what, group=group)
        for before, time in pairwise((-RECOVERY, *CREEP_TIMES)) if self.creep else ():
            direction, last = f"{CREEP}_{time:.0f}_s", (position, count)
            yield WeightStep(None, time - before, None, *last, direction, loads[-1], time, what=direction, group=group)

    def begin(self, lab: Lab, record: Recorder) -> Weighing:
        turns = len(self.positions) > 1 or self.iso_class is not None
        return Weighing(lab.bench, turns, self.creep, self.time is not None)

    def evaluate(self, points: Sequence[LoadCellPoint], lab: Lab) -> LoadCellResult:
        indicator, loads = lab.bench.role(LoadIndicator), self._loads(lab.target)
        runs, why = list(runs_of(points, len(loads))), ""
        if self._is_planned:
            wanted = self._wanted(lab.target)
            by_time = late(wanted, points[: len(runs) * points_of_run(len(loads))], len(loads), 1.0)
            why = stopped(wanted, learned(wanted, loads, runs, indicator.resolution_mV), by_time=by_time)
        elif self.iso_class is not None:
            why = self.enough(points, lab) or "all runs are made"
        crept = points[-1].direction.startswith(CREEP)
        calibration = calibrate_load_cell(
            loads,
            runs,
            indicator.resolution_mV,
            degree=self.degree,
            creep_mV=points[-1].reading_mV - points[-2].reading_mV if crept else None,
            loads_u=self.loads_u,
            gage_factor=indicator.gage_factor,
            **lab.origin(LoadIndicator, self.valid_days),
        )
        return LoadCellResult(calibration, points, why)

    def _loads(self, target: Target) -> Sequence[float]:
        """The loads of each run [N]."""
        if self._is_planned:
            return series_for(self._wanted(target)).loads
        return self.loads if self.iso_class is None else self._class_series(self.iso_class, target).loads

    def save_calibration(self, done: Finished[LoadCellResult]) -> Kept:
        from palpate.procedures.measurements.load_cell.certificate import write_certificate

        found = done.result.calibration
        certificate = write_certificate(done.folder, found)
        path = keep(found, done.folder, done.replayed)
        return {"calibration": found.source, "calibration_file": str(path), "certificate": str(certificate)}

    def report(self, result: LoadCellResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.load_cell.report import plot_load_cell, print_load_cell

        return Report(
            partial(print_load_cell, result, self.iso_class), partial(plot_load_cell, result, lab.bench.simulated)
        )


def _cell(target: Target) -> LoadCellCalibration:
    """What is known of the cell: its calibration, the one that it probably has, or that of the thesis."""
    return target.load_cell or probable_load_cell(target.scene) or THESIS_LOAD_CELL
