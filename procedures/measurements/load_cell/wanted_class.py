"""A class of ISO 376 that is asked of a calibration: the runs and loads it needs, and what no run can mend.

The standard has two runs up and down in one position of the cell, and one in each of two more. More runs lower what
noise leaves of the deviations from the curve. The other quantities are greatest differences: more runs only raise them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor, allocate
from palpate.instrument.allocation.lines import Costs, Line, Unit
from palpate.instrument.calibration.classification import (
    ISO_376,
    ISO_376_LOADS,
    ISO_376_PART,
    Run,
    must_hold,
    quantities,
)
from palpate.instrument.calibration.displayed import rounding_u
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_curve import load_cell_curve
from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.quantity import counted, show
from palpate.instrument.uncertainty.budget import NORMAL_FACTOR
from palpate.instrument.uncertainty.interpolation import polynomials
from palpate.instrument.uncertainty.rounding import mean_u
from palpate.procedures.lab.mounts import MOUNTING
from palpate.procedures.measurements.load_cell.expected import told
from palpate.procedures.measurements.load_cell.result import REPEATS
from palpate.procedures.measurements.load_cell.series import run_seconds, spread, weighing_seconds
from palpate.procedures.measurements.prospects import display_scatter
from palpate.procedures.showing.plan import duration

RUNS, POSITIONS = 2, (0.0, 120.0, 240.0)  # of ISO 376: repeatability needs two runs, reproducibility several positions
RANGE_OF_2, RANGE_OF_3 = 1.128, 1.693  # mean range of so many normal values, in standard deviations (ISO 7870-2, d2)
MEAN_SIZE = 0.798  # mean size of a normal value, in standard deviations
ONLY_GROW = ("resolution", "repeatability", "reproducibility", "zero_return")  # with further runs


@dataclass(frozen=True)
class ClassSeries:
    """The quickest series that can have a class.

    Attributes:
        loads: loads of each run [N].
        runs: runs up and down in the first position; the others have one each, or as many as were asked for.
        further: runs in each further position.
        positions: positions of the cell about its axis [degrees].
        expected: expected value of each quantity of ISO 376 that the display decides, as a fraction.
        binds: the quantity that comes closest to its limit.
    """

    loads: tuple[float, ...]
    runs: int
    further: int
    positions: tuple[float, ...]
    expected: Mapping[str, float]
    binds: str

    def runs_in(self, position: float) -> int:
        """Number of runs in a position."""
        return self.runs if position == self.positions[0] else self.further

    @property
    def seconds(self) -> float:
        """Bench time of all runs [s]."""
        number = self.runs + self.further * (len(self.positions) - 1)
        return number * run_seconds(len(self.loads)) + MOUNTING * len(self.positions)

    def lines(self, name: str) -> list[str]:
        """The plan for people; `name`: name of the class."""
        others = ", ".join(f"{place:g}°" for place in self.positions[1:])
        expected = ", ".join(f"{key.replace('_', ' ')} {told(value)}" for key, value in self.expected.items())
        limit = ISO_376[name][self.binds]
        return [
            f"wanted         class {name} of ISO 376",
            f"plan           {counted(self.runs, 'run')} up and down at {self.positions[0]:g}°, {self.further} each at "
            f"{others}, with {counted(len(self.loads), 'weight')}: {duration(self.seconds)}",
            f"weights        {', '.join(f'{load:.4g}' for load in self.loads)} N",
            f"expected       {expected}, by the display alone",
            f"binds          {self.binds.replace('_', ' ')}, {self.expected[self.binds] / limit:.0%} of the class'"
            f" {told(limit)}",
        ]


@functools.lru_cache(maxsize=64)
def class_series(
    name: str, weights: tuple[float, ...], runs: int, positions: tuple[float, ...], cell: LoadCellCalibration
) -> ClassSeries:
    """The quickest series for a class; what it cannot give, whatever is read, is refused before anything moves.

    Args:
        name: name of the class.
        weights: loads at hand, increasing [N].
        runs: least number of runs up and down in each position.
        positions: positions of the cell about its axis [degrees]; fewer than three: those of the standard.
        cell: what is known of the cell and its display.

    Raises:
        UnknownName: there is no such class.
        RangeError: the standard asks for more loads, or a quantity that the display decides binds; the message names
            the best class, and what would do.
    """
    if name not in ISO_376:
        raise UnknownName("class of ISO 376", name, list(ISO_376))
    lacking = [
        f"{ISO_376_LOADS} loads, not {len(weights)}" if len(weights) < ISO_376_LOADS else "",
        f"a load of {ISO_376_PART:.0%} of the greatest or less" if weights[0] > ISO_376_PART * weights[-1] else "",
    ]
    if any(lacking):
        raise RangeError(
            f"--class {name}: ISO 376 asks for {'; '.join(filter(None, lacking))}: give for example --loads "
            f"'300 gf:1000 gf:100 gf'"
        )
    loads = spread(weights, ISO_376_LOADS)
    half = loads[must_hold(np.asarray(loads))]  # a class holds from here at the latest
    expected = _expected(half, loads[-1], cell)
    limits = ISO_376[name]
    places = positions if len(positions) >= len(POSITIONS) else POSITIONS
    try:
        first = _first_runs(limits["interpolation"], loads, runs, len(places), cell)
    except BelowFloor as error:
        expected["interpolation"], first = NORMAL_FACTOR * error.floor, RUNS
    binds = max(expected, key=lambda key: expected[key] / limits[key])
    if expected[binds] > limits[binds]:
        raise _refusal(name, binds, expected, half, cell)
    return ClassSeries(loads, first, runs, places, expected, binds)


def _expected(half: float, greatest: float, cell: LoadCellCalibration) -> dict[str, float]:
    """Mean values of the quantities that the display decides, at the load from which a class must hold [N]."""
    noise = math.sqrt(2 / REPEATS) * display_scatter(cell)  # of a reading less the zero before it
    at_half, at_greatest = half * cell.sensitivity_mV_per_N, greatest * cell.sensitivity_mV_per_N
    return {
        "resolution": cell.resolution_mV / at_half,
        "repeatability": RANGE_OF_2 * noise / at_half,
        "reproducibility": RANGE_OF_3 * noise / at_half,
        "zero_return": MEAN_SIZE * noise / at_greatest,
    }


def _first_runs(limit: float, loads: Sequence[float], runs: int, positions: int, cell: LoadCellCalibration) -> int:
    """Runs in the first position, so that noise alone keeps the deviations from the curve in 95 % below their limit.

    Raises BelowFloor: what the display's steps leave is above the limit.
    """
    load, scatter, step = np.asarray(loads), display_scatter(cell), cell.resolution_mV
    half, others = must_hold(load), runs * (positions - 1)
    fewest = max(RUNS, runs) + others
    reading = cell.sensitivity_mV_per_N * load
    weights, _ = polynomials(load, 1)
    off_line = np.eye(load.size)[:, [half]] - weights @ weights[[half]].T
    rounded = float(rounding_u(load, reading, off_line, scatter, step, 2 * REPEATS * fewest)[0])
    lines = [
        Line("noise", scatter / math.sqrt(2 * REPEATS) / reading[half], Unit.SET),
        Line("resolution", max(rounded, mean_u(scatter, step, math.inf)) / reading[half], Unit.NOTHING),
    ]
    costs = Costs(0.0, 0.0, run_seconds(load.size) - weighing_seconds())
    return allocate(lines, costs, limit / NORMAL_FACTOR, weighing_seconds(), fewest).sets - others


def why_not(name: str, loads: Sequence[float], runs: Sequence[Run], step: float) -> str:
    """Why no further run gives a class, by the runs so far: a quantity that only grows is above its limit; else empty.

    Args:
        name: name of the class.
        loads: the loads [N].
        runs: complete runs.
        step: step of the indicator's display [mV].
    """
    load = np.asarray(loads, dtype=np.float64)
    found = quantities(load, runs, load_cell_curve(load, runs, step, None).curve, step, None)
    for key in ONLY_GROW:
        values = found[key]
        if values is not None and (worst := float(values[must_hold(load) :].max())) > ISO_376[name][key]:
            limit = told(ISO_376[name][key])
            return f"{key.replace('_', ' ')} is {told(worst)}, above the {limit} of class {name}; no run lowers it"
    return ""


def _refusal(
    name: str, binds: str, expected: Mapping[str, float], half: float, cell: LoadCellCalibration
) -> RangeError:
    limit = ISO_376[name][binds]
    best = next(
        (each for each, limits in ISO_376.items() if all(value <= limits[key] for key, value in expected.items())), None
    )
    part = limit / expected[binds]
    what = (
        f"a step of the indicator, {show(cell.resolution_mV, 'mV')}, is"
        if binds == "resolution"
        else f"with a display that scatters by {show(display_scatter(cell), 'mV')} it is expected to be"
    )
    lines = [
        f"--class {name} cannot be reached: {binds.replace('_', ' ')} binds: {what}"
        f" {100 * expected[binds]:.3g} % of {show(half, 'N')}, above the {100 * limit:.3g} % of that class; no number"
        " of runs lowers it",
        f"best now  {'no class' if best is None else f'--class {best}'}",
        f"or        an indicator with steps of {part * cell.resolution_mV:.2g} mV or less",
        f"or        loads up to {show(half / part / ISO_376_PART, 'N')} or more, if the cell takes them",
        f"note      by {cell.source}; a calibration without --class tells the steps of this indicator",
    ]
    return RangeError("\n  ".join(lines))
