"""Load-cell calibration with dead weights (thesis 5.2, Table 5.1; runs and positions as in ISO 376)."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import numpy as np

from palpate.drivers.roles import LoadIndicator, Positioner, why_invalid
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.table import FIRST, Allocation, OutOfReach, RunOption, Table, allocation
from palpate.instrument.arrays import Floats
from palpate.instrument.calibration.load_cell import (
    CURVE,
    ISO_376,
    POSITIONS,
    REPEATABILITY,
    STANDARD_GRAVITY,
    WEIGHTS,
    LoadCellCalibration,
    WeightRun,
    calibrate_load_cell,
    displayed_curve,
    lacking_for_iso_376,
    load_cell_curve,
    quantities,
    rounding_u,
    short_of_iso_376,
    slope_u,
)
from palpate.instrument.errors import DeviceError, EstimateError, RangeError, UnknownName, UsageError, quoted
from palpate.instrument.quantity import LARGEST_TOLERANCE, check_tolerance, counted, plus_minus, show
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR, mean_u
from palpate.instrument.uncertainty.interpolation import interpolate, polynomials
from palpate.procedures.engine.plan import Plan, Predicted, Step
from palpate.procedures.engine.procedure import (
    RESULTS,
    Expected,
    Finished,
    Measurement,
    Procedure,
    Report,
    predicted,
    until_full,
)
from palpate.procedures.engine.settings import Setting
from palpate.procedures.lab.calibrations import keep
from palpate.procedures.lab.lab import MOUNTING, Lab, Target
from palpate.procedures.lab.session import CalibrationKeys
from palpate.procedures.measurements.load_cell.report import (
    CREEP,
    CREEP_TIMES,
    FILTER,
    INTERVAL,
    LOADING,
    PLACING,
    REPEATS,
    SENSITIVITY,
    SETTLING,
    UNLOADING,
    ZERO_AFTER,
    ZERO_BEFORE,
    LoadCellPoint,
    LoadCellResult,
    runs_of,
)
from palpate.procedures.measurements.prospects import (
    binding,
    display_scatter,
    probable_cell_of,
    reachable,
    share,
    wanted_of,
)
from palpate.procedures.measurements.settings import LONGEST_VALIDITY, ValidDays, tolerance_setting
from palpate.procedures.records.columns import gathered
from palpate.procedures.records.record import Recorder
from palpate.procedures.showing.plan import duration
from palpate.procedures.steps.policy import carry_out
from palpate.procedures.steps.servo import steady

if TYPE_CHECKING:
    from palpate.drivers.bench import Bench


# --- What a calibration of the load cell is expected to give: the uncertainty of its sensitivity -------
#
# It is that of the line through the mean readings, which the fit itself gives for readings without an error of their
# own. A reading is off by the display's steps and its noise (`displayed_curve`). The cell is assumed to be straight
# and to repeat [A]: what it does else is found by the run alone.


def expected_sensitivity(
    loads: Sequence[float], readings: int, degree: int | None, cell: LoadCellCalibration, loads_u: float = 0.0
) -> list[Expected]:
    """Relative uncertainty of the sensitivity.

    Args:
        loads: the weights [N].
        readings: displayed values of each, in all runs and directions.
        degree: degree of the curve; None: 1.
        cell: what is known of the cell and its display.
        loads_u: relative standard uncertainty of all loads together.
    """
    load = np.asarray(loads, dtype=np.float64)
    straight = cell.sensitivity_mV_per_N * load
    curve = displayed_curve(load, straight, display_scatter(cell), cell.resolution_mV, readings, degree or 1)
    u = math.sqrt(curve.covariance[1, 1]) / cell.sensitivity_mV_per_N
    return [Expected(SENSITIVITY, math.hypot(u, loads_u))]


# --- A tolerance of a load cell's sensitivity: with which of the weights, and how often, they are put on and taken off
#
# A run takes each of its loads up and down. More runs lower what noise leaves; what the display's steps leave depends
# on the loads alone, since a load is rounded alike in every run. So each number of loads is planned by itself, and
# the quickest plan is taken. The first run tells how much the display scatters, and that fixes how many runs there
# are.


READINGS, RESOLUTION, DEVIATION = "scatter of readings", "resolution", "deviation from the curve"
FEWEST_LOADS = 5  # of a curve of degree 1: three degrees of freedom tell whether readings are off it
MOST_RUNS = 1000  # in all positions together
MOST = 5, 4  # times the planned runs, and runs besides: a series that needs more ends without its tolerance
ALIKE = 1.05  # rounding that is greater than the independent one by this is told to be shared
EXACT = "weights and gravity count as exact: see --loads-u"


@dataclass(frozen=True, slots=True)
class PlannedRuns:
    """The loads of each run [N], the number of runs in each position, and the plan of which they are part.

    `allocation.sets` are the runs in all positions together, and `allocation.seconds` is all their time.
    """

    loads: tuple[float, ...]
    runs: int
    allocation: Allocation

    def most(self) -> int:
        """The most runs in each position."""
        return MOST[0] * self.runs + MOST[1]


@dataclass(frozen=True, slots=True)
class Learned:
    """What the runs so far tell.

    Attributes:
        half: half-width of the 95 % interval of the sensitivity that they give, relative.
        runs: number of runs in each position that reach the tolerance, at least those that are done.
        why_not: why no further run reaches it; empty: the runs do.
    """

    half: float
    runs: int
    why_not: str

    def ended(self, tolerance: float) -> str:
        """Why the series ended, for people."""
        outcome = f"{plus_minus(self.half, 3)} reached, {plus_minus(tolerance, 3)} was asked for"
        most = "the most runs that were planned are done" if self.half > tolerance else ""
        why = self.why_not or most
        return f"{outcome}; {why}" if why else outcome


def run_seconds(loads: int) -> float:
    """Bench time of one run up and down with some loads, and of its zeros before and after [s]."""
    return (2 * loads + 2) * weighing_seconds()


def weighing_seconds() -> float:
    """Time in which a weight is placed, settles and is read [s]."""
    return PLACING + SETTLING + (REPEATS - 1) * INTERVAL


def lines_of(
    loads: Sequence[float], reading: Floats, degree: int, scatter: float, step: float, runs: int, loads_u: float
) -> list[BudgetLine]:
    """Lines of the sensitivity by runs with some loads.

    Args:
        loads: the loads [N].
        reading: readings on the curve at these loads (n,) [mV].
        degree: degree of the curve.
        scatter: standard deviation of single displayed values [mV].
        step: step of the display [mV].
        runs: number of runs in all positions, which tell how well the slope is known, and so what loads share of the
            rounding.
        loads_u: relative standard uncertainty of all loads together.
    """
    load = np.asarray(loads, dtype=np.float64)
    weights, powers = polynomials(load, degree)
    sensitivity = float(interpolate(load, reading, 0.0, degree).coefficients[1])
    rounded = powers[1] * rounding_u(load, reading, weights, scatter, step, 2 * REPEATS * runs)
    lines = [
        BudgetLine(READINGS, slope_u(load, degree) / sensitivity * scatter / math.sqrt(2 * REPEATS), RepeatUnit.SET),
        BudgetLine(RESOLUTION, float(np.linalg.norm(rounded)) / sensitivity, RepeatUnit.NOTHING),
    ]
    return lines + ([BudgetLine(WEIGHTS, loads_u, RepeatUnit.NOTHING)] if loads_u else [])


def spread(weights: Sequence[float], count: int) -> tuple[float, ...]:
    """So many of the weights, evenly spread, with the least and the greatest."""
    numbers = np.round(np.linspace(0, len(weights) - 1, count)).astype(int)
    return tuple(weights[number] for number in numbers)


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


WeightPlan = Plan[WeightStep, PlannedRuns | None]


def parse_degree(text: str) -> int | None:
    """Degree of a curve, "1" or "2"; None for "auto". Raises UnknownName."""
    if text not in DEGREES:
        raise UnknownName("degree", text, DEGREES)
    return DEGREES[text]


@dataclass(frozen=True)
class LoadCellSeries(Procedure[WeightStep, LoadCellPoint, LoadCellResult, PlannedRuns | None]):
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
        measured = {"repeatability": self.runs > 1, "reproducibility": len(self.positions) > 1}
        if lacking := lacking_for_iso_376(
            np.asarray(self.loads), [each for each, is_measured in measured.items() if not is_measured]
        ):
            raise RangeError(
                f"--class {name}: {'; '.join(lacking)}; give for example --loads '300 gf:1000 gf:100 gf' --runs 2 "
                "--positions 0,120,240"
            )

    def plan(self, target: Target) -> WeightPlan:
        """All points: every weight of every run, then the creep test; with a tolerance, of the most runs."""
        cell = probable_cell_of(target)
        if self.tolerance is not None:
            planned = self.quickest(cell, self.tolerance)
            steps = list(self._steps(planned.loads, planned.most()))
            return Plan(self.name, steps, self._forecast(planned, self.tolerance), planned)
        steps = list(self._steps(self.loads, self.runs))
        readings = 2 * REPEATS * self.runs * len(self.positions)
        found = expected_sensitivity(self.loads, readings, self.degree, cell, self.loads_u)
        return Plan(self.name, steps, predicted(steps, found))

    def quickest(self, cell: LoadCellCalibration, tolerance: float) -> PlannedRuns:
        """The quickest runs for a tolerance, by what is known of the cell before.

        Raises:
            RangeError: no number of runs reaches the tolerance; the message says what binds and what would do.
        """
        display, degree = (display_scatter(cell), cell.resolution_mV), self.degree or 1
        found: list[PlannedRuns] = []
        refused: list[tuple[OutOfReach, tuple[float, ...]]] = []
        for count in range(min(len(self.loads), max(FEWEST_LOADS, degree + 2)), len(self.loads) + 1):
            loads = spread(self.loads, count)
            reading = cell.sensitivity_mV_per_N * np.asarray(loads, dtype=np.float64)

            def lines_by(number: int, loads: tuple[float, ...] = loads, reading: Floats = reading) -> list[BudgetLine]:
                return lines_of(loads, reading, degree, *display, number, self.loads_u)

            try:
                found.append(self._planned(tolerance, loads, lines_by))
            except OutOfReach as error:
                refused.append((error, loads))
        if not found:
            nearest = min(refused, key=lambda each: each[0].best)
            raise self._refusal(tolerance, cell, *nearest)
        return min(found, key=lambda each: (each.allocation.seconds, -len(each.loads)))

    def _refusal(
        self, tolerance: float, cell: LoadCellCalibration, error: OutOfReach, loads: Sequence[float]
    ) -> RangeError:
        """The refusal of a tolerance that no number of runs reaches, by the loads that come nearest to it [N]."""
        loads_u = self.loads_u
        whole, wanted = error.floor / NORMAL_FACTOR, tolerance / NORMAL_FACTOR
        refused = f"--tolerance {share(tolerance, 3)} cannot be reached: "
        best = f"best now  --tolerance '{reachable(error.best)}'"
        if wanted <= loads_u:
            left_by_loads = plus_minus(NORMAL_FACTOR * loads_u, 3)
            lines = [
                f"{refused}--loads-u {share(loads_u, 3)} leaves {left_by_loads}, which no run lowers",
                best,
                "or        weights of a better class, or the local gravity, and a smaller --loads-u",
            ]
            return RangeError("\n  ".join(lines))
        if error.floor < tolerance:
            return RangeError(f"{refused}{error.binds} binds, and a series has {MOST_RUNS} runs at most\n  {best}")
        rounded = mean_u(display_scatter(cell), cell.resolution_mV, math.inf)
        apart = rounded * slope_u(np.asarray(loads, dtype=np.float64), self.degree or 1) / cell.sensitivity_mV_per_N
        left, free = (math.sqrt(u**2 - loads_u**2) for u in (whole, wanted))  # by the display alone
        heavier = (loads[-1] - loads[0]) * left / free + loads[0]
        alone = NORMAL_FACTOR * math.hypot(apart, loads_u)
        lines = [
            f"{refused}resolution leaves {plus_minus(NORMAL_FACTOR * left, 3)}"
            f"{f', and --loads-u {share(loads_u, 3)}' if loads_u else ''}: the display of "
            f"the load cell has steps of {show(cell.resolution_mV, 'mV')}, and no run lowers what they leave",
            best,
            f"or        weights up to {show(heavier, 'N')} or more, if the cell takes them, or more weights",
            "or        an indicator with finer steps",
        ]
        if error.floor > ALIKE * alone:
            lines.append(
                f"or        {plus_minus(alone, 3)} by weights that are rounded independently: these are"
                " nearly whole steps of the display apart, and rounded alike"
            )
        lines.append(f"note      by {cell.source}; a calibration without --tolerance tells the steps of this indicator")
        return RangeError("\n  ".join(lines))

    def _planned(
        self, tolerance: float, loads: tuple[float, ...], lines_by: Callable[[int], list[BudgetLine]]
    ) -> PlannedRuns:
        """The plan with some loads; `lines_by`: lines of the sensitivity by a number of runs in all positions.

        Raises OutOfReach.
        """
        places, dwell = len(self.positions), weighing_seconds()
        # The runs are the sets; turning the cell is paid once.
        costs = Costs(MOUNTING * places if places > 1 else 0.0, 0.0, run_seconds(len(loads)) - dwell)
        fewest = self.runs * places
        way, most = RunOption(lines_by(fewest), costs, dwell), max(MOST_RUNS, fewest)
        runs = Table.of([way], rounds=places, fewest=fewest, most=most).for_tolerance(tolerance).sets
        return PlannedRuns(loads, runs // places, allocation(lines_by(runs), costs, 1, runs, dwell))

    def learned(self, tolerance: float, loads: Sequence[float], runs: Sequence[WeightRun], step: float) -> Learned:
        """What complete runs with some loads [N] tell; `step`: step of the indicator's display [mV]."""
        load, places = np.asarray(loads, dtype=np.float64), len(self.positions)
        done = math.ceil(len(runs) / places)
        fitted = load_cell_curve(load, runs, step, self.degree, self.loads_u)
        found, curve = fitted.sensitivity, fitted.curve
        half = found.expanded() / found.value
        degree, scatter = curve.coefficients.size - 1, fitted.scatter_mV or step / math.sqrt(12)
        parts = {part.name: part for part in found.components}
        fixed = (
            [BudgetLine(POSITIONS, parts[POSITIONS].u / found.value, RepeatUnit.NOTHING)] if parts[POSITIONS].u else []
        )

        def lines_by(number: int, loads_u: float = self.loads_u) -> list[BudgetLine]:
            return lines_of(loads, curve.reading(load), degree, scatter, step, number, loads_u)

        if curve.by_scatter:
            of_noise = budget(lines_by(len(runs), 0.0), 1, len(runs), 1)
            off = math.sqrt(max((parts[CURVE].u / found.value) ** 2 - of_noise.u**2, 0.0))
            fixed.append(BudgetLine(DEVIATION, off, RepeatUnit.NOTHING))
        least = done
        if differing := parts.get(REPEATABILITY):
            of_run, freedom = differing.u / found.value * math.sqrt(len(runs)), differing.degrees_of_freedom
            fixed.append(BudgetLine("runs", of_run, RepeatUnit.SET, freedom))
            least = max(done, FIRST)  # the scatter of the runs themselves decides: few of them tell little of it
        if half <= tolerance and len(runs) >= least * places:
            return Learned(half, done, "")
        try:
            plan = self._planned(tolerance, tuple(loads), lambda number: lines_by(number) + fixed)
        except OutOfReach as error:
            why = "by the scatter that was found no number of runs is enough"
            if error.floor >= tolerance:
                why = f"{error.binds} leaves {plus_minus(error.floor, 3)}, which no further run lowers"
            return Learned(half, done, why)
        return Learned(half, max(plan.runs, least, done + 1), "")

    def _forecast(self, planned: PlannedRuns, tolerance: float) -> Predicted:
        """What the series is predicted to take and to give; a plan for people."""
        plan, count, places = planned.allocation, len(planned.loads), len(self.positions)
        each = "" if places == 1 else f" in each of {counted(places, 'position')}"
        counts = f"loads count with u = {share(self.loads_u, 3)}" if self.loads_u else EXACT
        lines = [
            wanted_of("the sensitivity", plus_minus(tolerance, 3)),
            f"plan           {counted(planned.runs, 'run')} up and down{each} with {counted(count, 'weight')}:"
            f" {duration(plan.seconds)}",
            f"weights        {', '.join(f'{load:.4g}' for load in planned.loads)} N",
            f"expected       {plus_minus(plan.half, 3)}; {counts}",
            binding(plan),
        ]
        of_series = {"loads_N": list(planned.loads), "runs": planned.runs, "positions": places, **plan.summary()}
        results = [{"name": SENSITIVITY, "u": plan.u, "unit": "relative"}]
        details = {"tolerance": tolerance, "planned": of_series, RESULTS: results}
        return Predicted(plan.seconds, plan.u, details, lines)

    def course(self, plan: WeightPlan, points: Sequence[LoadCellPoint], lab: Lab) -> Generator[int, None, str]:
        """The runs in each position end once the tolerance needs no further one."""
        planned, tolerance, step_mV = plan.basis, self.tolerance, lab.bench.role(LoadIndicator).resolution_mV

        def full(step: WeightStep, own: Sequence[LoadCellPoint]) -> bool:
            if planned is None or tolerance is None or own or step.creep_s or step.run <= self.runs:
                return False
            runs = list(runs_of(points, len(planned.loads)))
            return step.run > self.learned(tolerance, planned.loads, runs, step_mV).runs

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

    def begin(self, plan: WeightPlan, lab: Lab, record: Recorder) -> Weighing:
        return Weighing(lab.bench, len(self.positions) > 1, self.creep)

    def evaluate(self, points: Sequence[LoadCellPoint], plan: WeightPlan, lab: Lab) -> LoadCellResult:
        indicator = lab.bench.role(LoadIndicator)
        step = indicator.resolution_mV
        loads = tuple(self.loads) if plan.basis is None else plan.basis.loads
        runs = list(runs_of(points, len(loads)))
        stopped = ""
        if self.tolerance is not None:
            stopped = self.learned(self.tolerance, loads, runs, step).ended(self.tolerance)
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
