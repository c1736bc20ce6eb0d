"""The series of weights that gives the sensitivity of a load cell a tolerance: which loads, how many runs up and down.

A run takes each of its loads up and down. More runs lower what noise leaves; what the display's steps leave is lowered
by more loads alone, since a load is rounded alike in every run. So each number of loads is planned by itself, and the
quickest plan is taken. The first run tells how much the display scatters, and that fixes how many runs there are.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate
from palpate.instrument.allocation.lines import Costs, Line, Unit, budget
from palpate.instrument.allocation.stopping import FIRST
from palpate.instrument.calibration.classification import Run
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_curve import load_cell_curve, slope_u
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import counted, show
from palpate.instrument.uncertainty.rounding import mean_u
from palpate.procedures.engine.plan import MOUNTING, Predicted
from palpate.procedures.engine.promise import RESULTS
from palpate.procedures.measurements.load_cell.expected import SENSITIVITY
from palpate.procedures.measurements.load_cell.result import INTERVAL, PLACING, REPEATS, SETTLING
from palpate.procedures.measurements.prospects import display_scatter
from palpate.procedures.showing.plan import duration

Floats = npt.NDArray[np.float64]

REPEATABILITY, RESOLUTION, DEVIATION, POSITIONS = "repeatability", "resolution", "deviation from the curve", "positions"
FEWEST_LOADS = 5  # of a curve of degree 1: three degrees of freedom tell whether readings are off it
MOST_RUNS = 1000  # in all positions together
MOST = 5, 4  # times the planned runs, and runs besides: a series that needs more ends without its tolerance
EXACT = "weights and gravity count as exact"


@dataclass(frozen=True)
class Wanted:
    """A tolerance of the sensitivity.

    Attributes:
        tolerance: relative standard uncertainty of the sensitivity.
        weights: loads at hand, increasing [N].
        runs: least number of runs in each position.
        positions: number of positions of the cell.
        degree: degree of the curve; None: 1 is expected, and the readings decide.
        cell: what is known of the cell and its display before.
    """

    tolerance: float
    weights: tuple[float, ...]
    runs: int
    positions: int
    degree: int | None
    cell: LoadCellCalibration


@dataclass(frozen=True, slots=True)
class Series:
    """The loads of each run [N], the number of runs in each position, and the plan of which they are part.

    `allocation.sets` are the runs in all positions together, and `allocation.seconds` is all their time.
    """

    loads: tuple[float, ...]
    runs: int
    allocation: Allocation


def run_seconds(loads: int) -> float:
    """Bench time of one run up and down with some loads, and of its zeros before and after [s]."""
    return (2 * loads + 2) * weighing_seconds()


def weighing_seconds() -> float:
    """Time in which a weight is placed, settles and is read [s]."""
    return PLACING + SETTLING + (REPEATS - 1) * INTERVAL


def lines_of(loads: Sequence[float], degree: int, scatter: float, step: float, sensitivity: float) -> list[Line]:
    """Lines of the sensitivity by runs with some loads [N].

    Args:
        loads: the loads [N].
        degree: degree of the curve.
        scatter: standard deviation of single displayed values [mV].
        step: step of the display [mV].
        sensitivity: the sensitivity [mV/N].
    """
    of_reading = slope_u(np.asarray(loads, dtype=np.float64), degree) / sensitivity
    return [
        Line(REPEATABILITY, of_reading * scatter / math.sqrt(2 * REPEATS), Unit.SET),
        Line(RESOLUTION, of_reading * mean_u(scatter, step, math.inf), Unit.NOTHING),
    ]


@functools.lru_cache(maxsize=64)
def series_for(wanted: Wanted) -> Series:
    """The quickest series for a tolerance.

    Raises:
        RangeError: no number of runs reaches it, or it takes too many; the message says what binds, the best there is,
            and what would do.
    """
    cell, degree = wanted.cell, wanted.degree or 1
    found: list[Series] = []
    refused: list[tuple[BelowFloor, tuple[float, ...]]] = []
    least = min(len(wanted.weights), max(FEWEST_LOADS, degree + 2))
    for count in range(least, len(wanted.weights) + 1):
        loads = spread(wanted.weights, count)
        lines = lines_of(loads, degree, display_scatter(cell), cell.resolution_mV, cell.sensitivity_mV_per_N)
        try:
            found.append(_planned(wanted, loads, lines))
        except BelowFloor as error:
            refused.append((error, loads))
    if not found:
        raise _refusal(wanted, *min(refused, key=lambda each: each[0].floor))
    best = min(found, key=lambda each: (each.allocation.seconds, -len(each.loads)))
    if best.allocation.sets > MOST_RUNS:
        raise RangeError(
            f"--tolerance {told(wanted.tolerance)} takes {counted(best.allocation.sets, 'run')} up and down, "
            f"{duration(best.allocation.seconds)}, above the limit of {MOST_RUNS} runs; ask for more"
        )
    return best


def _planned(wanted: Wanted, loads: tuple[float, ...], lines: Sequence[Line]) -> Series:
    places = wanted.positions
    turning = MOUNTING * places if places > 1 else 0.0
    costs = Costs(turning, 0.0, run_seconds(len(loads)) - weighing_seconds())
    plan = allocate(lines, costs, wanted.tolerance, weighing_seconds(), wanted.runs * places)
    runs = math.ceil(plan.sets / places)
    reached = budget(lines, 1, runs * places, 1.0)
    shares = {row["name"]: row["share"] for row in reached.rows()}
    binds = max(shares, key=lambda name: shares[name])
    seconds = turning + runs * places * run_seconds(len(loads))
    whole = Allocation(1, runs * places, plan.dwell, seconds, reached.u, shares, binds)
    return Series(loads, runs, whole)


def spread(weights: Sequence[float], count: int) -> tuple[float, ...]:
    """So many of the weights, evenly spread, with the least and the greatest."""
    numbers = np.round(np.linspace(0, len(weights) - 1, count)).astype(int)
    return tuple(weights[number] for number in numbers)


@dataclass(frozen=True, slots=True)
class Learned:
    """What the runs so far tell.

    Attributes:
        u: relative standard uncertainty of the sensitivity that they give.
        runs: number of runs in each position that reach the tolerance, at least those that are done.
        why_not: why no further run reaches it; empty: the runs do.
    """

    u: float
    runs: int
    why_not: str


def learned(wanted: Wanted, loads: Sequence[float], runs: Sequence[Run], step: float) -> Learned:
    """What complete runs tell of the tolerance; `step`: step of the indicator's display [mV]."""
    load, done = np.asarray(loads, dtype=np.float64), math.ceil(len(runs) / wanted.positions)
    fitted = load_cell_curve(load, runs, step, wanted.degree)
    found = fitted.sensitivity
    u = found.u / found.value
    degree, scatter = fitted.curve.coefficients.size - 1, fitted.scatter_mV or step / math.sqrt(12)
    lines = lines_of(loads, degree, scatter, step, found.value)
    parts = {part.name: part for part in found.components}
    fixed = {POSITIONS: parts[POSITIONS].u / found.value}
    if fitted.curve.by_scatter:
        of_noise = budget(lines, 1, len(runs), 1.0).u
        fixed[DEVIATION] = math.sqrt(max((parts["curve"].u / found.value) ** 2 - of_noise**2, 0.0))
    lines += [Line(name, part, Unit.NOTHING) for name, part in fixed.items() if part]
    least = done
    if differing := parts.get(REPEATABILITY):
        lines.append(Line("runs", differing.u / found.value * math.sqrt(len(runs)), Unit.SET))
        least = max(done, FIRST)  # the scatter of the runs themselves decides: few of them tell little of it
    if u <= wanted.tolerance and len(runs) >= least * wanted.positions:
        return Learned(u, done, "")
    try:
        plan = _planned(wanted, tuple(loads), lines)
    except BelowFloor as error:
        return Learned(u, done, f"{error.line} leaves {told(error.floor)}, which no further run lowers")
    except RangeError:  # by the scatter that was found no time is enough
        return Learned(u, done, "by the scatter that was found no number of runs is enough")
    return Learned(u, max(plan.runs, least), "")


def predicted(wanted: Wanted, series: Series) -> Predicted:
    """What the series is predicted to take and to give; a plan for people."""
    plan = series.allocation
    each = "" if wanted.positions == 1 else f" in each of {counted(wanted.positions, 'position')}"
    loads = ", ".join(f"{load:.4g}" for load in series.loads)
    lines = [
        f"wanted         {told(wanted.tolerance)} of the sensitivity",
        f"plan           {counted(series.runs, 'run')} up and down{each} with {counted(len(series.loads), 'weight')}:"
        f" {duration(plan.seconds)}",
        f"weights        {loads} N",
        f"expected       {told(plan.u)}; {EXACT}",
        f"binds          {plan.binds}, {plan.shares[plan.binds]:.0%} of the variance",
    ]
    planned = {"loads_N": list(series.loads), "runs": series.runs, "positions": wanted.positions,
               "seconds": plan.seconds, "u": plan.u, "binds": plan.binds, "shares": plan.shares}  # fmt: skip
    results = [{"name": SENSITIVITY, "u": plan.u, "unit": "relative"}]
    return Predicted(plan.seconds, plan.u, {"tolerance": wanted.tolerance, "planned": planned, RESULTS: results}, lines)


def most_runs(series: Series) -> int:
    """The most runs in each position."""
    return MOST[0] * series.runs + MOST[1]


def told(u: float) -> str:
    """A share in percent, with three digits."""
    return f"{100 * u:.3g} %"


def _refusal(wanted: Wanted, error: BelowFloor, loads: Sequence[float]) -> RangeError:
    """The refusal of a tolerance that the display's steps alone exceed, whatever the number of loads."""
    part = wanted.tolerance / error.floor
    return RangeError(
        f"--tolerance {told(wanted.tolerance)} cannot be reached: {error.line} leaves {told(error.floor)}: the display "
        f"of the load cell has steps of {show(wanted.cell.resolution_mV, 'mV')}, and no run lowers what they leave"
        f"\n  best now  {told(1.01 * error.floor)}"
        f"\n  or        weights up to {show((loads[-1] - loads[0]) / part + loads[0], 'N')} or more, if the cell takes "
        "them, or more weights"
        f"\n  or        an indicator with finer steps"
        f"\n  note      by {wanted.cell.source}; a calibration without --tolerance tells the steps of this indicator"
    )
