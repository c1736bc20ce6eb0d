"""A tolerance of the sensitivity that no run reaches: what binds, the best there is, and what would do."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_curve import slope_u
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.uncertainty.rounding import mean_u
from palpate.procedures.measurements.load_cell.expected import told
from palpate.procedures.measurements.prospects import display_scatter

ALIKE = 1.05  # rounding that is greater than the independent one by this is told to be shared


def below_floor(
    error: BelowFloor,
    tolerance: float,
    loads: Sequence[float],
    degree: int,
    cell: LoadCellCalibration,
    loads_u: float,
) -> RangeError:
    """The refusal of a tolerance below what weights and display leave.

    Args:
        error: what binds with these loads.
        tolerance: relative standard uncertainty of the sensitivity that was asked for.
        loads: the loads that leave the least [N].
        degree: degree of the curve.
        cell: what is known of the cell and its display.
        loads_u: relative standard uncertainty of all loads together.
    """
    best = f"best now  {told(1.01 * error.floor)}"
    if tolerance <= loads_u:
        lines = [
            f"--tolerance {told(tolerance)} cannot be reached: --loads-u says {told(loads_u)}, which no run lowers",
            best,
            "or        weights of a better class, or the local gravity, and a smaller --loads-u",
        ]
        return RangeError("\n  ".join(lines))
    rounded = mean_u(display_scatter(cell), cell.resolution_mV, math.inf)
    apart = rounded * slope_u(np.asarray(loads, dtype=np.float64), degree) / cell.sensitivity_mV_per_N
    left, wanted = (math.sqrt(u**2 - loads_u**2) for u in (error.floor, tolerance))  # by the display alone
    heavier = (loads[-1] - loads[0]) * left / wanted + loads[0]
    lines = [
        f"--tolerance {told(tolerance)} cannot be reached: resolution leaves {told(left)}"
        f"{f', and --loads-u {told(loads_u)}' if loads_u else ''}: the display of "
        f"the load cell has steps of {show(cell.resolution_mV, 'mV')}, and no run lowers what they leave",
        best,
        f"or        weights up to {show(heavier, 'N')} or more, if the cell takes them, or more weights",
        "or        an indicator with finer steps",
    ]
    if error.floor > ALIKE * math.hypot(apart, loads_u):
        lines.append(
            f"or        {told(math.hypot(apart, loads_u))} by weights that are rounded independently: these are nearly"
            " whole steps of the display apart, and rounded alike"
        )
    lines.append(f"note      by {cell.source}; a calibration without --tolerance tells the steps of this indicator")
    return RangeError("\n  ".join(lines))
