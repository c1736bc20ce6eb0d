"""A tolerance of a load cell's sensitivity: with which of the weights, and how often, they are put on and taken off.

A run takes each of its loads up and down. More runs lower what noise leaves; what the display's steps leave depends on
the loads alone, since a load is rounded alike in every run. So each number of loads is planned by itself, and the
quickest plan is taken. The first run tells how much the display scatters, and that fixes how many runs there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import numpy.typing as npt

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.table import FIRST, Allocation, OutOfReach, allocate, allocation
from palpate.instrument.calibration.load_cell import (
    CURVE,
    POSITIONS,
    REPEATABILITY,
    WEIGHTS,
    LoadCellCalibration,
    WeightRun,
    displayed_curve,
    load_cell_curve,
    rounding_u,
    slope_u,
)
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import counted, plus_minus, show
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR, mean_u
from palpate.instrument.uncertainty.interpolation import interpolate, polynomials
from palpate.procedures.engine.plan import Predicted
from palpate.procedures.engine.promise import RESULTS, Expected
from palpate.procedures.lab.lab import MOUNTING
from palpate.procedures.measurements.load_cell.result import INTERVAL, PLACING, REPEATS, SENSITIVITY, SETTLING
from palpate.procedures.measurements.prospects import binding, display_scatter, reachable, share
from palpate.procedures.showing.plan import duration

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


# --- the repeated runs ---------------------------------------------------------------------------------

Floats = npt.NDArray[np.float64]

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


@dataclass(frozen=True)
class CellRepeats:
    """The runs that give the sensitivity of a load cell a tolerance.

    Attributes:
        tolerance: half-width of the 95 % interval of the sensitivity, relative.
        weights: loads at hand, increasing [N].
        runs: least number of runs in each position.
        positions: number of positions of the cell.
        degree: degree of the curve; None: 1 is expected, and the readings decide.
        cell: what is known of the cell and its display before.
        loads_u: relative standard uncertainty of all loads together, as by gravity.
    """

    tolerance: float
    weights: tuple[float, ...]
    runs: int
    positions: int
    degree: int | None
    cell: LoadCellCalibration
    loads_u: float = 0.0

    @cached_property
    def quickest(self) -> PlannedRuns:
        """The quickest runs.

        Raises:
            RangeError: no number of runs reaches the tolerance; the message says what binds and what would do.
        """
        return _quickest(self)

    def lines_before(self, loads: Sequence[float], runs: int) -> list[BudgetLine]:
        """Lines of the sensitivity by so many runs with some loads [N], by what is known of the cell before."""
        cell = self.cell
        reading = cell.sensitivity_mV_per_N * np.asarray(loads, dtype=np.float64)
        known = display_scatter(cell), cell.resolution_mV
        return lines_of(loads, reading, self.degree or 1, *known, runs, self.loads_u)

    def learned(self, loads: Sequence[float], runs: Sequence[WeightRun], step: float) -> Learned:
        """What complete runs with some loads [N] tell; `step`: step of the indicator's display [mV]."""
        load, done = np.asarray(loads, dtype=np.float64), math.ceil(len(runs) / self.positions)
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
            of_run, known = differing.u / found.value * math.sqrt(len(runs)), differing.degrees_of_freedom
            fixed.append(BudgetLine("runs", of_run, RepeatUnit.SET, known))
            least = max(done, FIRST)  # the scatter of the runs themselves decides: few of them tell little of it
        if half <= self.tolerance and len(runs) >= least * self.positions:
            return Learned(half, done, "")
        try:
            plan = self.by_lines(tuple(loads), lambda number: lines_by(number) + fixed)
        except OutOfReach as error:
            why = "by the scatter that was found no number of runs is enough"
            if error.floor >= self.tolerance:
                why = f"{error.binds} leaves {plus_minus(error.floor, 3)}, which no further run lowers"
            return Learned(half, done, why)
        return Learned(half, max(plan.runs, least, done + 1), "")

    def stopped(self, found: Learned) -> str:
        """Why the series ended, for people."""
        why = found.why_not
        if not why and found.half > self.tolerance:
            why = "the most runs that were planned are done"
        told = f"{plus_minus(found.half, 3)} reached, {plus_minus(self.tolerance, 3)} was asked for"
        return f"{told}; {why}" if why else told

    def by_lines(self, loads: tuple[float, ...], lines_by: Callable[[int], list[BudgetLine]]) -> PlannedRuns:
        """The plan with some loads; `lines_by`: lines of the sensitivity by a number of runs in all positions.

        Raises OutOfReach.
        """
        places, dwell = self.positions, weighing_seconds()
        # The runs are the sets; turning the cell is paid once.
        costs = Costs(MOUNTING * places if places > 1 else 0.0, 0.0, run_seconds(len(loads)) - dwell)
        fewest = self.runs * places
        runs = allocate(
            lines_by(fewest), costs, self.tolerance, [dwell], rounds=places, fewest=fewest, most=max(MOST_RUNS, fewest)
        ).sets
        return PlannedRuns(loads, runs // places, allocation(lines_by(runs), costs, 1, runs, dwell))

    def predicted(self) -> Predicted:
        """What the series is predicted to take and to give; a plan for people."""
        planned = self.quickest
        plan, count = planned.allocation, len(planned.loads)
        each = "" if self.positions == 1 else f" in each of {counted(self.positions, 'position')}"
        lines = [
            f"wanted         {plus_minus(self.tolerance, 3)} of the sensitivity",
            f"plan           {counted(planned.runs, 'run')} up and down{each} with {counted(count, 'weight')}:"
            f" {duration(plan.seconds)}",
            f"weights        {', '.join(f'{load:.4g}' for load in planned.loads)} N",
            f"expected       {plus_minus(plan.half, 3)}; "
            f"{f'loads count with u = {share(self.loads_u, 3)}' if self.loads_u else EXACT}",
            binding(plan),
        ]
        of_series = {"loads_N": list(planned.loads), "runs": planned.runs, "positions": self.positions,
                   "seconds": plan.seconds, "u": plan.u, "half": plan.half, "binds": plan.binds,
                   "shares": plan.shares}  # fmt: skip
        results = [{"name": SENSITIVITY, "u": plan.u, "unit": "relative"}]
        said = {"tolerance": self.tolerance, "planned": of_series, RESULTS: results}
        return Predicted(plan.seconds, plan.u, said, lines)


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


def _quickest(asked: CellRepeats) -> PlannedRuns:
    least = min(len(asked.weights), max(FEWEST_LOADS, (asked.degree or 1) + 2))
    found: list[PlannedRuns] = []
    refused: list[tuple[OutOfReach, tuple[float, ...]]] = []
    for count in range(least, len(asked.weights) + 1):
        loads = spread(asked.weights, count)
        try:
            found.append(asked.by_lines(loads, partial(asked.lines_before, loads)))
        except OutOfReach as error:
            refused.append((error, loads))
    if not found:
        raise _refusal(asked, *min(refused, key=lambda each: each[0].best))
    return min(found, key=lambda each: (each.allocation.seconds, -len(each.loads)))


def _refusal(asked: CellRepeats, error: OutOfReach, loads: Sequence[float]) -> RangeError:
    """The refusal of a tolerance that no number of runs reaches, by the loads that come nearest to it [N]."""
    loads_u, cell = asked.loads_u, asked.cell
    whole, wanted = error.floor / NORMAL_FACTOR, asked.tolerance / NORMAL_FACTOR
    told = f"--tolerance {share(asked.tolerance, 3)} cannot be reached: "
    best = f"best now  --tolerance '{reachable(error.best)}'"
    if wanted <= loads_u:
        lines = [
            f"{told}--loads-u {share(loads_u, 3)} leaves {plus_minus(NORMAL_FACTOR * loads_u, 3)}, which no run lowers",
            best,
            "or        weights of a better class, or the local gravity, and a smaller --loads-u",
        ]
        return RangeError("\n  ".join(lines))
    if error.floor < asked.tolerance:
        return RangeError(f"{told}{error.binds} binds, and a series has {MOST_RUNS} runs at most\n  {best}")
    rounded = mean_u(display_scatter(cell), cell.resolution_mV, math.inf)
    apart = rounded * slope_u(np.asarray(loads, dtype=np.float64), asked.degree or 1) / cell.sensitivity_mV_per_N
    left, free = (math.sqrt(u**2 - loads_u**2) for u in (whole, wanted))  # by the display alone
    heavier = (loads[-1] - loads[0]) * left / free + loads[0]
    alone = NORMAL_FACTOR * math.hypot(apart, loads_u)
    lines = [
        f"{told}resolution leaves {plus_minus(NORMAL_FACTOR * left, 3)}"
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
