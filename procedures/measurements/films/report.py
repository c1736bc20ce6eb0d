"""Shows and plots the result of a film calibration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from palpate.instrument.quantity import counted, plus_minus
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.films.result import FilmResult
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.text import new_table, percent, stamped


def show_films(result: FilmResult, design: Design, outcome: Outcome) -> list[object]:
    """Each film's results, the crosstalk between several teeth, and the gain over several frequencies."""
    c = result.calibration
    table = new_table(
        stamped(c.simulated, f"Film calibration, design {c.design}"),
        "film", "mV/N", "u mV/N", "design's mV/N", "clamping", "linearity", "degrees of freedom",
    )  # fmt: skip
    for film, own in zip(c.films, design.films, strict=True):
        table.add_row(
            film.name,
            f"{film.sensitivity_mV_per_N:z.3f}",
            f"{film.sensitivity_u:z.3f}",
            f"{1e3 * own.sensitivity:z.3f}",
            f"{film.clamping:z.3f}",
            f"{100 * film.linearity:z.2f} %",
            f"{film.degrees_of_freedom}",
        )
    tables: list[Any] = [table]
    if len(design.teeth) > 1:
        teeth = range(1, len(design.teeth) + 1)
        crosstalk = new_table(stamped(c.simulated, "Crosstalk"), "film \\ tooth", *map(str, teeth))
        for name, row in zip(_rigid(design), c.crosstalk, strict=True):
            crosstalk.add_row(name, *(f"{value:z.4f}" for value in row))
        tables.append(crosstalk)
    if len(c.frequencies_Hz) > 1:
        gain = new_table(stamped(c.simulated, "Gain"), "film", *(f"{frequency:g} Hz" for frequency in c.frequencies_Hz))
        for film, row in zip(c.films, c.gain, strict=True):
            gain.add_row(film.name, *(f"{value:z.4f}" for value in row))
        tables.append(gain)
    outside = sum(point.extrapolated for point in result.points)
    return [
        *tables,
        *([f"extrapolated   {counted(outside, 'point')} outside the load cell's calibrated range"] if outside else []),
        f"uncertainty    {plus_minus(result.reached)} of a sensitivity at most; u {percent(result.achieved_u)} %"
        f"{_predicted(outcome)}",
        f"loads          {c.least_N:g} to {c.greatest_N:g} N peak to peak, until {c.expires}",
        f"stored in      {outcome['film_calibration_file']}",
    ]


def _predicted(outcome: Outcome) -> str:
    u = outcome["predicted_u"]
    return "" if u is None else f" (predicted {percent(u)} %)"


def _rigid(design: Design) -> list[str]:
    return [film.name for film in design.films if film.kind == FILM_KINDS[0]]


def plot_films(result: FilmResult, design: Design, folder: Path) -> Path:
    """Plot each film's voltages against the load, with its line, and their deviation from it; returns the PNG file."""
    c = result.calibration
    figure, (left, right) = new_figure(c.simulated, 2, f"film calibration, design {c.design}")
    for number, (film, own) in enumerate(zip(c.films, design.films, strict=True)):
        mine = [p for p in result.points if p.tooth - 1 in own.teeth]
        (load, load_u), (volts, u) = with_u(mine, "load_measured_N"), with_u(mine, "voltages_V", 1e3, number)
        marker = MARKERS[number % len(MARKERS)]
        look: dict[str, Any] = {"fmt": marker, "ms": 4, "lw": 1, "capsize": 2}
        left.errorbar(load, volts, u, load_u, **look, label=f"{film.name}: {film.sensitivity_mV_per_N:.3g} mV/N")
        by_line = [100 / (film.sensitivity_mV_per_N * x) for x in load]
        off = [each * y - 100 for each, y in zip(by_line, volts, strict=True)]
        right.errorbar(load, off, [each * y for each, y in zip(by_line, u or (), strict=True)], load_u, **look)
        ends = [0.0, max(load)]
        left.plot(ends, [film.sensitivity_mV_per_N * x for x in ends], "k-", lw=0.7)
    left.set(xlabel="load peak to peak (N)", ylabel="film voltage peak to peak (mV; bars: u)")
    right.axhline(0, color="k", lw=1)
    right.set(xlabel="load peak to peak (N)", ylabel="deviation from the line (%; bars: u)")
    name_all(left, 2)
    return save(figure, folder)
