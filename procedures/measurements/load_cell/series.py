"""The series of weights that gives the sensitivity of a load cell a tolerance, or as well as a time allows.

A run takes each of its loads up and down. More runs lower what noise leaves; what the display's steps leave depends on
the loads alone, since a load is rounded alike in every run. So each number of loads is planned by itself, and the best
plan is taken. The first run tells how much the display scatters, and that fixes how many runs there are.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate, allocate_time
from palpate.instrument.allocation.lines import Costs, Line, Unit, budget
from palpate.instrument.calibration.displayed import rounding_u
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_curve import WEIGHTS, slope_u
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import as_typed, counted
from palpate.instrument.uncertainty.interpolation import interpolate, polynomials
from palpate.procedures.engine.plan import Predicted
from palpate.procedures.engine.promise import RESULTS
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.measurements.load_cell.expected import SENSITIVITY, told
from palpate.procedures.measurements.load_cell.refusal import below_floor
from palpate.procedures.measurements.load_cell.result import INTERVAL, PLACING, REPEATS, SETTLING
from palpate.procedures.measurements.prospects import display_scatter
from palpate.procedures.showing.plan import duration

Floats = npt.NDArray[np.float64]

READINGS, RESOLUTION = "scatter of readings", "resolution"
FEWEST_LOADS = 5  # of a curve of degree 1: three degrees of freedom tell whether readings are off it
MOST_RUNS = 1000  # in all positions together
RESERVE = 1.0  # s, for a run that takes longer than usual
MOST = 5, 4  # times the planned runs, and runs besides: a series that needs more ends without its tolerance
EXACT = "weights and gravity count as exact: see --loads-u"


@dataclass(frozen=True)
class Wanted:
    """A tolerance of the sensitivity, or a time.

    Attributes:
        tolerance: relative standard uncertainty of the sensitivity; None: as good as the time allows.
        weights: loads at hand, increasing [N].
        runs: least number of runs in each position.
        positions: number of positions of the cell.
        degree: degree of the curve; None: 1 is expected, and the readings decide.
        cell: what is known of the cell and its display before.
        time: bench time that is not exceeded [s]; None: as long as the tolerance takes.
        loads_u: relative standard uncertainty of all loads together, as by gravity.
    """

    tolerance: float | None
    weights: tuple[float, ...]
    runs: int
    positions: int
    degree: int | None
    cell: LoadCellCalibration
    time: float | None = None
    loads_u: float = 0.0


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


def lines_of(
    loads: Sequence[float], reading: Floats, degree: int, scatter: float, step: float, runs: int, loads_u: float
) -> list[Line]:
    """Lines of the sensitivity by runs with some loads.

    Args:
        loads: the loads [N].
        reading: readings on the curve at these loads (n,) [mV].
        degree: degree of the curve.
        scatter: standard deviation of single displayed values [mV].
        step: step of the display [mV].
        runs: number of runs in all positions, which tell how well the slope is known, and so what loads share of the
            rounding.
        loads_u: as in `Wanted`.
    """
    load = np.asarray(loads, dtype=np.float64)
    weights, powers = polynomials(load, degree)
    sensitivity = float(interpolate(load, reading, 0.0, degree).coefficients[1])
    rounded = powers[1] * rounding_u(load, reading, weights, scatter, step, 2 * REPEATS * runs)
    lines = [
        Line(READINGS, slope_u(load, degree) / sensitivity * scatter / math.sqrt(2 * REPEATS), Unit.SET),
        Line(RESOLUTION, float(np.linalg.norm(rounded)) / sensitivity, Unit.NOTHING),
    ]
    return lines + ([Line(WEIGHTS, loads_u, Unit.NOTHING)] if loads_u else [])


@functools.lru_cache(maxsize=64)
def series_for(wanted: Wanted) -> Series:
    """The quickest series for a tolerance, or the best one in a time where that is too short for the tolerance.

    Raises:
        RangeError: no number of runs reaches it, it takes too many, or no run fits into the time; the message says what
            binds, the best there is, and what would do.
    """
    if wanted.tolerance is not None:
        best = _for_tolerance(wanted)
        if wanted.time is None or best.allocation.seconds <= wanted.time:
            return best
    return _for_time(wanted)


def _choices(wanted: Wanted) -> list[tuple[float, ...]]:
    """The loads that a run may have: some of the weights, the fewest first."""
    least = min(len(wanted.weights), max(FEWEST_LOADS, (wanted.degree or 1) + 2))
    return [spread(wanted.weights, count) for count in range(least, len(wanted.weights) + 1)]


def _expected_lines(wanted: Wanted, loads: tuple[float, ...]) -> Callable[[int], list[Line]]:
    """The lines by numbers of runs, by what is known of the cell before."""
    cell, degree = wanted.cell, wanted.degree or 1
    reading = cell.sensitivity_mV_per_N * np.asarray(loads, dtype=np.float64)
    return lambda runs: lines_of(
        loads, reading, degree, display_scatter(cell), cell.resolution_mV, runs, wanted.loads_u
    )


def _for_tolerance(wanted: Wanted) -> Series:
    found: list[Series] = []
    refused: list[tuple[BelowFloor, tuple[float, ...]]] = []
    for loads in _choices(wanted):
        try:
            found.append(planned(wanted, loads, _expected_lines(wanted, loads)))
        except BelowFloor as error:
            refused.append((error, loads))
    if not found:
        floor, loads = min(refused, key=lambda each: each[0].floor)
        raise below_floor(floor, wanted.tolerance or 0.0, loads, wanted.degree or 1, wanted.cell, wanted.loads_u)
    best = min(found, key=lambda each: (each.allocation.seconds, -len(each.loads)))
    if best.allocation.sets > MOST_RUNS:
        raise RangeError(
            f"--tolerance {told(wanted.tolerance or 0.0)} takes {counted(best.allocation.sets, 'run')} up and down, "
            f"{duration(best.allocation.seconds)}, above the limit of {MOST_RUNS} runs; give a greater --tolerance"
        )
    return best


def _for_time(wanted: Wanted) -> Series:
    asked, time = replace(wanted, tolerance=None), wanted.time or 0.0
    loads = [each for each in _choices(wanted) if _least_seconds(wanted, each) <= time]
    if not loads:
        fewest = _choices(wanted)[0]
        raise RangeError(
            f"--time {as_typed(time, 's')} is too short: {counted(wanted.runs * wanted.positions, 'run')} up and down "
            f"with {counted(len(fewest), 'weight')} {'takes' if wanted.runs * wanted.positions == 1 else 'take'} "
            f"{duration(math.ceil(_least_seconds(wanted, fewest)))}; give more time"
        )
    found = [planned(asked, each, _expected_lines(asked, each)) for each in loads]
    best = min(found, key=lambda each: (each.allocation.u, each.allocation.seconds))
    if best.allocation.sets > MOST_RUNS:
        raise RangeError(
            f"--time {as_typed(time, 's')} holds {counted(best.allocation.sets, 'run')} up and down, above the limit "
            f"of {MOST_RUNS} runs; give less time"
        )
    return best


def costs_of(wanted: Wanted, loads: int) -> Costs:
    """Bench times of runs with some loads, which are the sets; turning the cell is paid once."""
    turning = MOUNTING * wanted.positions if wanted.positions > 1 else 0.0
    return Costs(turning, 0.0, run_seconds(loads) - weighing_seconds())


def _least_seconds(wanted: Wanted, loads: tuple[float, ...]) -> float:
    """Bench time of the fewest runs with some loads [s]."""
    return costs_of(wanted, len(loads)).seconds(1, wanted.runs * wanted.positions, weighing_seconds())


def planned(wanted: Wanted, loads: tuple[float, ...], lines_by: Callable[[int], list[Line]]) -> Series:
    """The plan with some loads; `lines_by`: lines of the sensitivity by a number of runs in all positions."""
    places, dwell, costs = wanted.positions, weighing_seconds(), costs_of(wanted, len(loads))
    fewest = wanted.runs * places
    if wanted.tolerance is not None:
        runs = math.ceil(allocate(lines_by(fewest), costs, wanted.tolerance, dwell, fewest).sets / places)
    else:
        time = max((wanted.time or 0.0) - RESERVE, _least_seconds(wanted, loads))
        runs = allocate_time(lines_by(fewest), costs, time, dwell, fewest).sets // places
    reached = budget(lines_by(runs * places), 1, runs * places, 1.0)
    shares = {row["name"]: row["share"] for row in reached.rows()}
    binds = max(shares, key=lambda name: shares[name])
    seconds = costs.seconds(1, runs * places, dwell)
    return Series(loads, runs, Allocation(1, runs * places, dwell, seconds, reached.u, shares, binds))


def spread(weights: Sequence[float], count: int) -> tuple[float, ...]:
    """So many of the weights, evenly spread, with the least and the greatest."""
    numbers = np.round(np.linspace(0, len(weights) - 1, count)).astype(int)
    return tuple(weights[number] for number in numbers)


def _wanted_of(wanted: Wanted) -> str:
    time = "" if wanted.time is None else duration(wanted.time)
    if wanted.tolerance is None:
        return f"the sensitivity as well as {time} allow"
    return f"{told(wanted.tolerance)} of the sensitivity{time and f', within {time}'}"


def predicted(wanted: Wanted, series: Series) -> Predicted:
    """What the series is predicted to take and to give; a plan for people."""
    plan = series.allocation
    each = "" if wanted.positions == 1 else f" in each of {counted(wanted.positions, 'position')}"
    loads = ", ".join(f"{load:.4g}" for load in series.loads)
    lines = [
        f"wanted         {_wanted_of(wanted)}",
        f"plan           {counted(series.runs, 'run')} up and down{each} with {counted(len(series.loads), 'weight')}:"
        f" {duration(plan.seconds)}",
        f"weights        {loads} N",
        f"expected       {told(plan.u)}; {f'loads count with {told(wanted.loads_u)}' if wanted.loads_u else EXACT}",
        f"binds          {plan.binds}, {plan.shares[plan.binds]:.0%} of the variance",
    ]
    of_series = {"loads_N": list(series.loads), "runs": series.runs, "positions": wanted.positions,
               "seconds": plan.seconds, "u": plan.u, "binds": plan.binds, "shares": plan.shares}  # fmt: skip
    results = [{"name": SENSITIVITY, "u": plan.u, "unit": "relative"}]
    return Predicted(
        plan.seconds, plan.u, {"tolerance": wanted.tolerance, "planned": of_series, RESULTS: results}, lines
    )


def most_runs(series: Series) -> int:
    """The most runs in each position."""
    return MOST[0] * series.runs + MOST[1]
