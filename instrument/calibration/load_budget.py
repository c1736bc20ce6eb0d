"""Uncertainty budget of a load that the load cell measured."""

from __future__ import annotations

import math

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.uncertainty.budget import Budget, Component


def load_budget(calibration: LoadCellCalibration, load: float, displays: int = 1) -> Budget:
    """Budget of a load [N] that was measured by the mean of some displayed values.

    Its `u` is that of `LoadCellCalibration.load`.
    """
    c = calibration
    bend = 0.0 if c.curvature is None else c.curvature.mV_per_N2
    slope = c.sensitivity_mV_per_N + 2 * bend * load
    freedom = math.inf if c.degrees_of_freedom is None else float(c.degrees_of_freedom)
    components = [
        Component("zero", c.zero_u, -1 / slope, freedom, "A"),
        Component("sensitivity", c.sensitivity_u, -load / slope, freedom, "A"),
        Component("reading", c.reading_u(displays), 1 / slope),
    ]
    correlations = {("zero", "sensitivity"): c.covariance / (c.zero_u * c.sensitivity_u)}
    if c.curvature is not None:
        bent = c.curvature
        components.append(Component("curvature", bent.u, -(load**2) / slope, freedom, "A"))
        correlations["zero", "curvature"] = bent.with_zero / (c.zero_u * bent.u)
        correlations["sensitivity", "curvature"] = bent.with_sensitivity / (c.sensitivity_u * bent.u)
    return Budget("load", load, "N", tuple(components), correlations)
