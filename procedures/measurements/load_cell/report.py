"""Shows and plots the result of a load-cell calibration."""

from __future__ import annotations

from pathlib import Path

from palpate.instrument.calibration.load_cell import Classification, iso_376_class_of
from palpate.instrument.quantity import show
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.load_cell.result import LOADING, UNLOADING, LoadCellPoint, LoadCellResult
from palpate.procedures.records.columns import Column, columns_of
from palpate.procedures.showing.figure import name_all, new_figure, save
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import new_table, stamped


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
        known = ("not measured", "-") if value is None else (f"{100 * value:z.3f} %", iso_376_class_of(name, value))
        quantities.add_row(name.replace("_", " "), *known)
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
