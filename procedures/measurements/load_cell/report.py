"""What a load-cell calibration finds: its points and result, and how they are shown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from palpate.instrument.calibration.load_cell import (
    Classification,
    LoadCellCalibration,
    WeightRun,
    iso_376_class_of,
    load_budget,
)
from palpate.instrument.quantity import show
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import name_all, new_figure, save
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import new_table, stamped

# --- The points and the result of a load-cell calibration ----------------------------------------------

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


# --- what it shows -------------------------------------------------------------------------------------


def show_load_cell(result: LoadCellResult, wanted: str | None, outcome: Outcome) -> list[object]:
    """The readings, the curve, its figures of merit and its classes."""
    down = {_place(p): p.reading_mV for p in result.points if p.direction == UNLOADING}

    def unloading(point: LoadCellPoint) -> str:
        return f"{down[_place(point)]:z.2f}"

    columns = columns_of(LoadCellPoint) | {"unloading": Column(head="unloading mV", cell=unloading)}
    up = [p for p in result.points if p.direction == LOADING]
    readings = table_of(stamped(outcome["simulated"], "Load-cell calibration"), up, columns)
    c = result.calibration
    quantities = new_table(None, "", "greatest of\nall loads", "ISO 376 class")
    for name, value in (
        ("repeatability", c.repeatability),
        ("reproducibility", c.reproducibility),
        ("interpolation", c.interpolation),
        ("reversibility", c.reversibility_of_reading),
        ("zero_return", c.zero_return),
        ("creep", c.creep),
        ("resolution", c.resolution() / c.least_N),
    ):
        cells = ("not measured", "-") if value is None else (f"{100 * value:z.3f} %", iso_376_class_of(name, value))
        quantities.add_row(name.replace("_", " "), *cells)
    bent = c.curvature
    return [
        readings,
        quantities,
        f"sensitivity    {c.sensitivity_mV_per_N:z.3f} mV/N, u = {c.sensitivity_u:z.3f} mV/N   (thesis: 10.3 mV/N)",
        f"zero           {c.zero_mV:z.2f} mV, u = {c.zero_u:z.2f} mV",
        *([f"curvature      {bent.mV_per_N2:.3g} mV/N², u = {bent.u:.2g} mV/N²"] if bent else []),
        f"linearity      {100 * c.linearity:z.2f} % of the span",
        f"reversibility  {100 * c.reversibility:z.2f} % of the span",
        f"resolution     {c.resolution_mV:g} mV = {show(c.resolution(), 'N')}",
        f"range          {c.least_N:.4g} to {c.greatest_N:.4g} N, until {c.expires}",
        f"ISO 376        {_held(c.iso_376)}",
        *([f"wanted         class {wanted}: {'NOT REACHED' if result.missed else 'reached'}"] if wanted else []),
        *([f"stopped        {result.stopped}{_predicted(outcome)}"] if result.stopped else []),
        f"ASTM E74       {_held(c.astm_e74)}; LLF {c.lower_limit_factor_N:.3g} N",
        f"calibration    {outcome['calibration_file']}",
        f"certificate    {outcome['certificate']}",
    ]


def _predicted(outcome: Outcome) -> str:
    u, seconds = outcome["predicted_u"], outcome["predicted_seconds"]
    return "" if u is None or seconds is None else f" (predicted u {100 * u:.3g} % in {duration(seconds)})"


def _place(point: LoadCellPoint) -> tuple[float, int, float]:
    return point.position_deg, point.run, point.load_gf


def _held(found: Classification) -> str:
    over = "" if found.least_N is None else f" from {found.least_N:.4g} to {found.greatest_N:.4g} N"
    return f"{found.name}{over}{f': {found.reason}' if found.reason else ''}"


def plot_load_cell(result: LoadCellResult, simulated: bool, folder: Path) -> Path:
    """Plot the readings with the curve, and their deviation from it; returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, "load-cell calibration")
    c = result.calibration
    for direction, marker in (("loading", "^"), ("unloading", "v")):
        points = [p for p in result.points if p.direction == direction]
        load, reading = [p.load_N for p in points], [p.reading_mV for p in points]
        off = [p.reading_mV - c.reading(p.load_N) for p in points]
        u = [c.reading_u(len(p.readings_mV)) for p in points]
        for axes, values in ((left, reading), (right, off)):
            axes.errorbar(load, values, u, fmt=marker, capsize=2, label=direction)
    grid = [c.greatest_N * i / 50 for i in range(51)]
    left.plot(grid, [c.reading(x) for x in grid], "k-", lw=1, label=f"{c.sensitivity_mV_per_N:z.3f} mV/N")
    left.set(xlabel="load (N)", ylabel="reading (mV; bars: u)")
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="load (N)", ylabel="deviation from the curve (mV; bars: u)")
    name_all(left)
    name_all(right)
    return save(figure, folder)
