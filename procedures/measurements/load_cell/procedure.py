"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1; runs and positions as in ISO 376)."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np

from palpate.drivers.roles import LoadIndicator, Positioner, why_invalid
from palpate.instrument.calibration.load_cell import (
    ISO_376,
    STANDARD_GRAVITY,
    THESIS_LOAD_CELL,
    LoadCellCalibration,
    calibrate_load_cell,
    lacking_for_iso_376,
    load_cell_curve,
    quantities,
    short_of_iso_376,
)
from palpate.instrument.errors import DeviceError, EstimateError, RangeError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import LARGEST_TOLERANCE, check_tolerance, counted, show
from palpate.procedures.engine.plan import Plan, Step
from palpate.procedures.engine.procedure import Finished, Measurement, Procedure, Report, until_full
from palpate.procedures.engine.promise import predicted
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import keep, probable_load_cell
from palpate.procedures.lab.lab import MOUNTING, Lab, Target
from palpate.procedures.lab.session import CalibrationKeys
from palpate.procedures.measurements.load_cell.repeats import CellRepeats, expected_sensitivity, weighing_seconds
from palpate.procedures.measurements.load_cell.result import (
    CREEP,
    CREEP_TIMES,
    FILTER,
    INTERVAL,
    LOADING,
    REPEATS,
    SETTLING,
    UNLOADING,
    ZERO_AFTER,
    ZERO_BEFORE,
    LoadCellPoint,
    LoadCellResult,
    runs_of,
)
from palpate.procedures.measurements.settings import ValidDays, tolerance_setting
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import steady

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench

# --- The bench work of a load-cell calibration: reads the load cell under one weight after the other ---

RECOVERY = 300.0  # s without load before the creep test, so that the creep of the runs is gone
# The zero may move in a run by these steps of the display plus this fraction of the span [A]; ISO 376 has 0.1 %.
RETURN_STEPS, RETURN_OF_SPAN = 1.5, 0.01


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


class Weighing:
    """The bench work: reads the load cell under one weight after the other.

    Args:
        bench: the open bench.
        turns: whether the cell is turned to several positions.
        creeps: whether the creep is watched at the end.
    """

    def __init__(self, bench: Bench, turns: bool, creeps: bool) -> None:
        self._bench, self._turns, self._creeps = bench, turns, creeps
        indicator = bench.role(LoadIndicator)
        bench.rest()
        bench.role(Positioner).home()
        indicator.clear_tare()
        indicator.track(FILTER)
        self._resolution_mV = indicator.read().resolution_mV
        self._zero_mV = self._span_mV = 0.0
        self._creeping_ns = 0

    def arrange(self, step: WeightStep) -> None:
        if self._turns:
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
        if self._creeps:
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
        return gathered(
            LoadCellPoint, step,
            load_gf=round(1e3 * step.load_N / STANDARD_GRAVITY, 6),
            reading_mV=sum(values) / len(values),
            readings_mV=tuple(values),
            incidents=self._bench.incidents.new(),
        )  # fmt: skip

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


# --- the procedure -------------------------------------------------------------------------------------

LOADS = tuple(round(1e-3 * m * STANDARD_GRAVITY, 12) for m in range(140, 741, 100))  # N, Table 5.1
DEGREES = {"auto": None, "1": 1, "2": 2}
LONGEST_VALIDITY = 791  # days: 26 months, ISO 376


def parse_degree(text: str) -> int | None:
    """Degree of a curve, "1" or "2"; None for "auto". Raises UnknownName."""
    if text not in DEGREES:
        raise UnknownName("degree", text, DEGREES)
    return DEGREES[text]


@dataclass(frozen=True)
class LoadCellSeries(Procedure[WeightStep, LoadCellPoint, LoadCellResult, CellRepeats | None]):
    """Calibrate the load cell with dead weights, put on and taken off in steps."""

    name = "calibrate-load-cell"
    point = LoadCellPoint
    calibrates = True
    calibrating = "load cell"
    manual_work = "places the weights"
    constants = MappingProxyType({"repeats": REPEATS})

    loads: Annotated[
        tuple[float, ...],
        Setting("N", "Weights: first:last:step or a list, increasing.", default="140 gf:740 gf:100 gf"),
    ] = LOADS
    runs: Annotated[int, Setting(help="Runs up and down in each position; 2 give repeatability.")] = 1
    positions: Annotated[
        tuple[float, ...], Setting(help="Degrees about the cell's axis; ISO 376 has 0,120,240.", example="120")
    ] = (0.0,)
    degree: Annotated[
        int | None,
        Setting(
            help="Degree of the curve; auto: 2 if an F-test finds it better.",
            read=parse_degree,
            metavar="auto|1|2",
            default="auto",
        ),
    ] = None
    creep: Annotated[bool, Setting(help="Measure the creep under the greatest load for 300 s.")] = False
    valid_days: ValidDays = 365
    iso_class: Annotated[
        str | None,
        Setting(
            help="Class of ISO 376 that shall be reached, 00, 0.5, 1 or 2; if it is not, the exit status is 1.",
            option="--class",
            metavar="CLASS",
        ),
    ] = None
    tolerance: Annotated[
        float | None, tolerance_setting("of the sensitivity; the series is planned for it, of --loads at hand.")
    ] = None
    loads_u: Annotated[
        float,
        Setting(
            help="Relative standard uncertainty of all loads together, weights and local gravity; 0: exact.",
            metavar="SHARE",
            example="0.02 %",
        ),
    ] = 0.0

    def check(self, target: Target) -> None:
        """Check the settings before anything is sent to a device.

        Raises:
            RangeError: a load is not positive or exceeds the force limit; loads do not increase, or are too few for
                the curve; there is no run; positions repeat or are outside 0 to 360 degrees; the validity is outside
                the limits of ISO 376; these loads, runs and positions are too few for a class; the tolerance cannot be
                reached with these weights; the loads' uncertainty is no share from 0 to below 0.5.
            UsageError: a class is given beside a tolerance.
            UnknownName: there is no such class.
        """
        loads = self.loads
        if bad := [load for load in loads if not 0 < load <= target.force_limit]:
            raise RangeError(
                f"load {bad[0]:g} N is not above 0 and at most {target.force_limit:g} N, the bench's force limit; take "
                "other weights"
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
        if self.iso_class is not None:
            self._check_class(self.iso_class)
        if self.tolerance is not None:
            check_tolerance(self.tolerance, f"--tolerance {self.tolerance:g}")

    def _check_class(self, name: str) -> None:
        """Refuse what cannot have a class, whatever is read."""
        if name not in ISO_376:
            raise UnknownName("class of ISO 376", name, list(ISO_376))
        if self.tolerance is not None:
            raise UsageError("--tolerance and --class: a tolerance chooses weights and runs itself; give one")
        told = {"repeatability": self.runs > 1, "reproducibility": len(self.positions) > 1}
        if lacking := lacking_for_iso_376(np.asarray(self.loads), [each for each, known in told.items() if not known]):
            raise RangeError(
                f"--class {name}: {'; '.join(lacking)}; give for example --loads '300 gf:1000 gf:100 gf' --runs 2 "
                "--positions 0,120,240"
            )

    def plan(self, target: Target) -> Plan[WeightStep, CellRepeats | None]:
        """All points: every weight of every run, then the creep test; with a tolerance, of the most runs."""
        if self.tolerance is not None:
            asked = tuple(self.loads), self.runs, len(self.positions), self.degree
            repeats = CellRepeats(self.tolerance, *asked, _cell(target), self.loads_u)
            steps = list(self._steps(repeats.quickest.loads, repeats.quickest.most()))
            return Plan(self.name, steps, repeats.predicted(), repeats)
        steps = list(self._steps(self.loads, self.runs))
        readings = 2 * REPEATS * self.runs * len(self.positions)
        found = expected_sensitivity(self.loads, readings, self.degree, _cell(target), self.loads_u)
        return Plan(self.name, steps, predicted(steps, found))

    def course(
        self, plan: Plan[WeightStep, CellRepeats | None], points: Sequence[LoadCellPoint], lab: Lab
    ) -> Generator[int, None, str]:
        """The runs in each position end once the tolerance needs no further one."""
        repeats, step_mV = plan.basis, lab.bench.role(LoadIndicator).resolution_mV

        def full(step: WeightStep, own: Sequence[LoadCellPoint]) -> bool:
            if repeats is None or own or step.creep_s or step.run <= self.runs:
                return False
            loads = repeats.quickest.loads
            return step.run > repeats.learned(loads, list(runs_of(points, len(loads))), step_mV).runs

        return until_full(plan.steps, points, lambda step: (step.position_deg, step.run, step.creep_s > 0), full)

    def _steps(self, loads: Sequence[float], runs: int) -> Iterator[WeightStep]:
        """Steps of so many runs in each position with some loads [N], and of the creep test."""
        several = len(self.positions) > 1
        for position in self.positions:
            group = f"turn the load cell to {position:g} degrees" if several else "take all weights off"
            for number in range(1, runs + 1):
                weights = [(ZERO_BEFORE, 0.0), *((LOADING, load) for load in loads)]
                weights += [*((UNLOADING, load) for load in reversed(loads)), (ZERO_AFTER, 0.0)]
                for direction, load in weights:
                    what = f"{direction}, {1e3 * load / STANDARD_GRAVITY:.0f} gf"
                    turning = MOUNTING if several and number == 1 and direction == ZERO_BEFORE else 0.0
                    seconds = turning + weighing_seconds()
                    yield WeightStep(None, seconds, None, position, number, direction, load, what=what, group=group)
        for before, time in pairwise((-RECOVERY, *CREEP_TIMES)) if self.creep else ():
            direction, last = f"{CREEP}_{time:.0f}_s", (position, runs)
            yield WeightStep(None, time - before, None, *last, direction, loads[-1], time, what=direction, group=group)

    def begin(self, plan: Plan[WeightStep, CellRepeats | None], lab: Lab, record: Recorder) -> Weighing:
        return Weighing(lab.bench, len(self.positions) > 1, self.creep)

    def evaluate(
        self, points: Sequence[LoadCellPoint], plan: Plan[WeightStep, CellRepeats | None], lab: Lab
    ) -> LoadCellResult:
        indicator = lab.bench.role(LoadIndicator)
        step = indicator.resolution_mV
        repeats = plan.basis
        loads = tuple(self.loads) if repeats is None else repeats.quickest.loads
        runs = list(runs_of(points, len(loads)))
        stopped = "" if repeats is None else repeats.stopped(repeats.learned(loads, runs, step))
        crept = points[-1].direction.startswith(CREEP)
        creep = points[-1].reading_mV - points[-2].reading_mV if crept else None
        missed = ""
        if self.iso_class is not None:
            load = np.asarray(loads)
            curve = load_cell_curve(load, runs, step, self.degree, self.loads_u).curve
            missed = "; ".join(short_of_iso_376(load, quantities(load, runs, curve, step, creep), self.iso_class))
        calibration = calibrate_load_cell(
            loads,
            runs,
            step,
            degree=self.degree,
            creep_mV=creep,
            loads_u=self.loads_u,
            gage_factor=indicator.gage_factor,
            **lab.origin(LoadIndicator, self.valid_days),
        )
        return LoadCellResult(calibration, points, stopped, missed)

    def check_result(self, result: LoadCellResult) -> None:
        """Refuse a calibration that does not have the class. Raises EstimateError."""
        if result.missed:
            found = result.calibration.iso_376.name
            raise EstimateError(f"class {self.iso_class} is not reached (found: {found}): {result.missed}")

    def save_calibration(self, done: Finished[LoadCellResult]) -> CalibrationKeys:
        from palpate.procedures.measurements.load_cell.certificate import write_certificate

        found = done.result.calibration
        certificate = write_certificate(done.folder, found)
        path = keep(found, done.folder, done.replayed)
        return {"calibration": found.source, "calibration_file": str(path), "certificate": str(certificate)}

    def report(self, result: LoadCellResult, lab: Lab) -> Report:
        from palpate.procedures.measurements.load_cell.report import plot_load_cell, show_load_cell

        return Report(
            partial(show_load_cell, result, self.iso_class), partial(plot_load_cell, result, lab.bench.simulated)
        )


def _cell(target: Target) -> LoadCellCalibration:
    """What is known of the cell: its calibration, the one that it probably has, or that of the thesis."""
    return target.load_cell or probable_load_cell(target.scene) or THESIS_LOAD_CELL
