"""The points and the result of a load-cell calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration, WeightRun, load_budget
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column

FILTER = 0.1  # s, time constant of the indicator's filter
SETTLING = 1.0  # s between placing a weight and reading it
REPEATS = 10  # readings of each weight
INTERVAL = 0.1  # s between two readings: the display is updated ten times a second
PLACING = 10.0  # s that a person takes to change the weights [A]
CREEP, ZERO_BEFORE, ZERO_AFTER, LOADING, UNLOADING = "creep", "zero_before", "zero_after", "loading", "unloading"
SENSITIVITY = "sensitivity"
CREEP_TIMES = (30.0, 300.0)  # s after the weight was placed, ISO 376


TOLD = (
    "sensitivity_mV_per_N", "sensitivity_u", "zero_mV", "zero_u", "least_N", "greatest_N", "linearity", "reversibility",
    "reversibility_of_reading", "repeatability", "reproducibility", "interpolation", "zero_return", "creep",
    "lower_limit_factor_N", "astm_e74", "iso_376", "expires",
)  # fmt: skip
"""What of a calibration its result tells under the same name."""


@dataclass(frozen=True, slots=True)
class LoadCellPoint:
    """The readings under one weight."""

    position_deg: Annotated[
        float, Column("position of the cell about its axis", "°", "position", "{0.position_deg:g}°")
    ]
    run: Annotated[int, Column("number of the run, from 1", head="run")]
    direction: Annotated[str, Column('"loading", "unloading", "zero_before", "zero_after", or "creep_..._s"')]
    load_gf: Annotated[float, Column("the load", "gf", "load gf", "g")]
    load_N: Annotated[float, Column("the load", "N", "load N", "z.4f")]
    reading_mV: Annotated[float, replace(columns.READING, head="loading mV", cell="z.2f")]
    readings_mV: columns.Readings
    incidents: columns.Incidents = 0


@dataclass(frozen=True, slots=True)
class LoadCellResult:
    """The calibration and the points that it comes from.

    Attributes:
        stopped: why the series ended, where a tolerance was asked for; empty: it was fixed.
        missed: why the class that was asked for is not reached; empty: it is, or none was asked for.
    """

    calibration: LoadCellCalibration
    points: Sequence[LoadCellPoint]
    stopped: str = ""
    missed: str = ""

    def summary(self) -> dict[str, Any]:
        """The results for JSON. Values without a unit are fractions; linearity and reversibility of the span."""
        c = self.calibration
        found = c.model_dump(include=set(TOLD))
        return {
            **{name: found[name] for name in TOLD},
            "curvature_mV_per_N2": c.curvature.mV_per_N2 if c.curvature else None,
            "curvature_u": c.curvature.u if c.curvature else None,
            "resolution": c.resolution_mV,
            "resolution_N": c.resolution(),
            **({"stopped": self.stopped} if self.stopped else {}),
        }

    @property
    def budgets(self) -> tuple[Budget, ...]:
        """The budgets of the sensitivity, and of the least, the middle and the greatest load."""
        c = self.calibration
        freedom = math.inf if c.degrees_of_freedom is None else float(c.degrees_of_freedom)
        curve = Component("curve through the loads", c.sensitivity_u, 1.0, freedom, "A")
        loads = (c.least_N, 0.5 * (c.least_N + c.greatest_N), c.greatest_N)
        return Budget(SENSITIVITY, c.sensitivity_mV_per_N, "mV/N", (curve,)), *(load_budget(c, load) for load in loads)


def runs_of(points: Sequence[LoadCellPoint], loads: int) -> Iterator[WeightRun]:
    """The runs up and down with this number of loads each, with their zeros before and after."""
    length = 2 * loads + 2
    for start in range(0, len(points) - length + 1, length):
        before, *weighed, after = points[start : start + length]
        mean = [point.reading_mV for point in weighed]
        displays = [point.readings_mV for point in weighed]
        scatter = float(np.sqrt(np.var(displays, axis=1, ddof=1).mean()))
        loading, unloading = np.array(mean[:loads]), np.array(mean[loads:][::-1])
        zeros = before.reading_mV, after.reading_mV
        yield WeightRun(before.position_deg, loading, unloading, *zeros, len(displays[0]), scatter)
