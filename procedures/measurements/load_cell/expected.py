"""What a calibration of the load cell is expected to give: the uncertainty of its sensitivity.

It is that of the line through the mean readings, which the fit itself gives for readings without an error of their
own. A reading is off by the display's steps and its noise (`displayed_curve`). The cell is assumed to be straight and
to repeat [A]: what it does else is found by the run alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.instrument.calibration.displayed import displayed_curve
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import display_scatter
from palpate.procedures.measurements.repeated_sets import share

SENSITIVITY = "sensitivity"


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


def share3(u: float) -> str:
    """A share in percent, with three digits: near what the steps leave, time rises fast."""
    return share(u, 3)
