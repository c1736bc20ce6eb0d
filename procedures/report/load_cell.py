"""What a calibration of the load cell found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from instrument.quantity import show
from procedures.load_cell import LoadCellResult
from procedures.report.figure import new_figure, save
from procedures.report.text import STAMP, new_table, print_all, stamped, where


def print_load_cell(result: LoadCellResult, outcome: dict[str, Any], plot: Path) -> None:
    """Readings, the line and its figures of merit."""
    readings = new_table(
        stamped(outcome["simulated"], "Load-cell calibration"), "load gf", "load N", "loading mV", "unloading mV"
    )
    up = [p for p in result.points if p["direction"] == "loading"]
    down = {p["load_gf"]: p for p in result.points if p["direction"] == "unloading"}
    for p in up:
        readings.add_row(
            f"{p['load_gf']:g}",
            f"{p['load_N']:.4f}",
            f"{p['reading_mV']:.2f}",
            f"{down[p['load_gf']]['reading_mV']:.2f}",
        )
    c = result.calibration
    print_all(
        readings,
        f"sensitivity    {c.sensitivity_mV_per_N:.3f} mV/N, u = {c.sensitivity_u:.3f} mV/N   (thesis: 10.3 mV/N)",
        f"zero           {c.zero_mV:.2f} mV, u = {c.zero_u:.2f} mV",
        f"linearity      {100 * c.linearity:.2f} % of the span",
        f"reversibility  {100 * c.reversibility:.2f} % of the span",
        f"resolution     {c.resolution_mV:g} mV = {show(c.resolution(), 'N')}",
        f"calibration    {outcome['calibration_file']}",
        *where({**outcome, "calibration": None}, plot),
    )


def plot_load_cell(result: LoadCellResult, simulated: bool, folder: Path) -> Path:
    """Readings with the line, and their deviation from it; returns the PNG."""
    figure, (left, right) = new_figure(simulated, 2)
    figure.suptitle(f"{STAMP + ': ' if simulated else ''}load-cell calibration")
    c = result.calibration
    for direction, marker in (("loading", "^"), ("unloading", "v")):
        load = [p["load_N"] for p in result.points if p["direction"] == direction]
        reading = [p["reading_mV"] for p in result.points if p["direction"] == direction]
        left.plot(load, reading, marker, label=direction)
        right.plot(load, [y - c.reading(x) for x, y in zip(load, reading, strict=True)], marker, label=direction)
    ends = [0.0, max(p["load_N"] for p in result.points)]
    left.plot(ends, [c.reading(x) for x in ends], "k-", lw=1, label=f"{c.sensitivity_mV_per_N:.3f} mV/N")
    left.set(xlabel="load (N)", ylabel="reading (mV)")
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="load (N)", ylabel="deviation from the line (mV)")
    left.legend(fontsize=8)
    right.legend(fontsize=8)
    return save(figure, folder)
