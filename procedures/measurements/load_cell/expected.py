"""What a calibration of the load cell is expected to give: the uncertainty of its sensitivity.

It is that of the line through the mean readings, which the fit itself gives for readings without an error of their
own. A reading is off by the display's steps and its noise (`display_u`). The cell is assumed to be straight and to
repeat [A]: what it does else is found by the run alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.uncertainty.interpolation import interpolate
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import display_u

SENSITIVITY = "sensitivity"


def expected_sensitivity(
    loads: Sequence[float], readings: int, degree: int | None, cell: LoadCellCalibration
) -> list[Expected]:
    """Relative uncertainty of the sensitivity.

    Args:
        loads: the weights [N].
        readings: displayed values of each, in all runs and directions.
        degree: degree of the curve; None: 1.
        cell: what is known of the cell and its display.
    """
    straight = cell.sensitivity_mV_per_N * np.asarray(loads, dtype=np.float64)
    curve = interpolate(loads, straight, display_u(cell, readings), degree or 1)
    return [Expected(SENSITIVITY, math.sqrt(curve.covariance[1, 1]) / cell.sensitivity_mV_per_N)]
