"""Calibrates a load cell from runs of dead weights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.calibration.classification import (
    WeightRun,
    classify_astm_e74,
    classify_iso_376,
    lower_limit_factor,
    quantities,
)
from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.calibration.load_cell_curve import load_cell_curve
from palpate.instrument.config import check, read_hashed

STANDARD_GRAVITY = 9.80665
"""m/s², turns the gram-force of dead weights into newtons."""


def calibrate_load_cell(
    load_N: npt.ArrayLike,
    runs: Sequence[WeightRun],
    resolution_mV: float,
    *,
    degree: int | None = None,
    creep_mV: float | None = None,
    loads_u: float = 0.0,
    gage_factor: float,
    **origin: Any,
) -> LoadCellCalibration:
    """Calibrate a load cell from runs of dead weights that are put on and taken off again.

    The curve is fitted to the mean reading at each load, since repeats at one load share its rounding. The span is that
    of the line between the least and the greatest load. The spread of the sensitivity over several positions of the
    cell adds to its uncertainty, since nobody knows in which position the cell will be used.

    Args:
        load_N: (k,) N, increasing.
        runs: readings (k,) each.
        resolution_mV: smallest step of the indicator.
        degree: degree of the curve; None: 2 where an F-test finds it better than 1.
        creep_mV: change of the reading from 30 s to 300 s under the greatest load; None: not measured.
        loads_u: relative standard uncertainty of all loads together, as by gravity.
        gage_factor: as in `LoadCellCalibration`.
        origin: the fields of `Calibration`.

    Raises:
        EstimateError: as in `interpolate`, or loads do not increase, shapes do not match, there is no run, or the
            sensitivity is not above three of its standard uncertainties.
        RangeError: the resolution is not positive.
        ConfigError: a text is empty.
    """
    load = np.asarray(load_N, dtype=np.float64)
    fitted = load_cell_curve(load, runs, resolution_mV, degree, loads_u)
    curve, sensitivity, span = fitted.curve, fitted.sensitivity, fitted.span
    freedom = sensitivity.degrees_of_freedom
    found = quantities(load, runs, curve, resolution_mV, creep_mV)
    factor = lower_limit_factor(load, runs, curve)
    up_less_down = np.mean([run.loading_mV - run.unloading_mV for run in runs], axis=0)
    fields: dict[str, Any] = {
        "sensitivity_mV_per_N": sensitivity.value,
        "sensitivity_u": sensitivity.u,
        "zero_mV": float(curve.coefficients[0]),
        "zero_u": math.sqrt(curve.covariance[0, 0]),
        "covariance": float(curve.covariance[0, 1]),
        "degrees_of_freedom": max(math.floor(freedom), 1) if math.isfinite(freedom) else None,
        "least_N": float(load[0]),
        "greatest_N": float(load[-1]),
        "linearity": fitted.linearity,
        "reversibility": float(np.abs(up_less_down).max()) / span,
        "reversibility_of_reading": _greatest(found["reversibility"]),
        **{
            name: _greatest(found[name])
            for name in ("repeatability", "reproducibility", "interpolation", "zero_return", "creep")
        },
        "resolution_mV": float(resolution_mV),
        "scatter_mV": fitted.scatter_mV,
        "lower_limit_factor_N": factor,
        "astm_e74": classify_astm_e74(load, 2 * load.size * len(runs), factor, resolution_mV / sensitivity.value),
        "iso_376": classify_iso_376(load, found),
        "gage_factor": gage_factor,
        **origin,
    }
    if curve.coefficients.size == 3:
        bend = float(curve.coefficients[2])
        by_loads = 2 * bend * loads_u  # loads that are all too great by a share move it by twice that share
        fields["curvature"] = {
            "mV_per_N2": bend,
            "u": math.hypot(math.sqrt(curve.covariance[2, 2]), by_loads),
            "with_sensitivity": float(curve.covariance[1, 2]) + by_loads * loads_u * sensitivity.value,
            "with_zero": float(curve.covariance[0, 2]),
        }
    return check(fields, LoadCellCalibration, "load cell calibration")


def _greatest(values: npt.NDArray[np.float64] | None) -> float | None:
    return None if values is None else float(values.max())


THESIS_LOAD_CELL = read_hashed(Path(__file__).with_name("thesis_load_cell.toml"), LoadCellCalibration)
"""Load cell of thesis Table 5.1 [T]: 10.306 ± 0.056 mV/N, zero 1.81 mV, resolution 1 mV.

A simulated bench without a calibration of its own uses it. It is stored, since every command would fit it anew;
`tests/instrument/test_calibration.py` fits it to the table and compares.
"""
