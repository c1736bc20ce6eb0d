"""Shows and plots the result of a temperature sweep."""

from __future__ import annotations

import itertools
from pathlib import Path

from palpate.instrument.sensor.design import Design
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.temperature.result import TemperaturePoint, TemperatureResult
from palpate.procedures.records.columns import columns_of
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, stamped


def show_sweep(result: TemperatureResult, design: Design, outcome: Outcome) -> list[object]:
    """Each change with the force ratio and its errors, then the slopes."""
    title = "What a change of temperature adds (errors against the fit with a trend)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(TemperaturePoint))
    said = [
        f"offset {name:<16} " + ("-" if found is None else f"{found[0]:+z.4f} N/K, u = {found[1]:z.4f} N/K")
        for name, found in result.offsets.items()
    ]
    if result.ratio_per_K is not None:
        slope, u = (100 * value for value in result.ratio_per_K)
        said.append(f"force ratio, with trend  {slope:+z.3f} %/K, u = {u:z.3f} %/K")
    return [points, *legend(points), *said]


def plot_sweep(result: TemperatureResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot the apparent force of each film, and the errors of the ratio, against the change; returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"warming films, design {design.name}")
    change = [p.step_K for p in result.points]
    for i, (marker, film) in enumerate(zip(itertools.cycle(MARKERS), design.films)):
        offsets = with_u([p.films[i] for p in result.points], "offset_N")
        left.errorbar(change, *offsets, fmt=marker, ms=5, lw=1, capsize=2, label=film.name)
    left.set(xlabel="change of temperature (K)", ylabel="apparent force (N; bars: u)")
    name_all(left)
    right.plot(change, [100 * p.error_lock_in for p in result.points], "o", ms=5, label="lock-in amplifier")
    right.plot(change, [100 * p.error_rms for p in result.points], "s", ms=5, label="voltmeter (RMS)")
    right.axhline(0, color="k", lw=1, label="fit with trend")
    right.set(xlabel="change of temperature (K)", ylabel="error of the force ratio (%)")
    name_all(right)
    return save(figure, folder)
