"""Shows and plots the result of a frequency sweep."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

from palpate.instrument.sensor.design import Design
from palpate.instrument.signals.frequency_response import TACTILE
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements.frequency.result import FrequencyPoint, FrequencyResult
from palpate.procedures.records.columns import columns_of
from palpate.procedures.showing.figure import MARKERS, name_all, new_figure, save, with_u
from palpate.procedures.showing.tables import table_of
from palpate.procedures.showing.text import legend, new_table, stamped


def show_sweep(result: FrequencyResult, design: Design, outcome: Outcome) -> list[object]:
    """Gains and phases, the corner of each film, and the resonance."""
    title = "Gain (mV/N) and phase (degrees, before the first base film)"
    points = table_of(stamped(outcome["simulated"], title), result.points, columns_of(FrequencyPoint))
    corners = new_table(
        stamped(outcome["simulated"], "Charge amplifiers: corner of each film"),
        "film", "corner\nHz", "u", "time constant\ns", "gain above it\nmV/N", "u",
    )  # fmt: skip
    for name, c in result.corners.items():
        if c is None:
            corners.add_row(name, "not seen", "-", "-", "-", "-")
        else:
            corners.add_row(
                name, f"{c.corner_Hz:z.4f}", f"{c.corner_u:z.4f}", f"{c.time_constant:z.3f}", f"{1e3 * c.gain:z.3f}",
                f"{1e3 * c.gain_u:z.3f}",
            )  # fmt: skip
    r = result.resonance
    said = (
        "resonance      none within the sweep"
        if r is None
        else f"resonance      {r.frequency_Hz:z.1f} Hz, u = {r.frequency_u:z.1f} Hz, damping ratio {r.damping:z.2f}"
    )
    touch = f"touch          within the band of touch, to {TACTILE:g} Hz"
    unseen = {"not seen": "the sweep does not reach low enough, or has too few valid points"}
    return [
        points, *legend(points), *([touch] if any(p.tactile for p in result.points) else []), corners,
        *legend(corners, marks=unseen), said,
    ]  # fmt: skip


def plot_sweep(result: FrequencyResult, design: Design, simulated: bool, folder: Path) -> Path:
    """Plot gains and phases with the band of touch, and the drive's response; returns the PNG file."""
    figure, (left, middle, right) = new_figure(simulated, 3, f"frequency response, design {design.name}")
    frequency = [p.frequency_Hz for p in result.points]
    for i, (marker, film) in enumerate(zip(itertools.cycle(MARKERS), design.films)):
        responses = [p.films[i] for p in result.points]
        look: dict[str, Any] = {"marker": marker, "ms": 4, "lw": 1, "capsize": 2}
        left.errorbar(frequency, *with_u(responses, "gain_V_per_N", 1e3), **look, label=film.name)
        middle.errorbar(frequency, *with_u(responses, "phase_deg"), **look)
        corner = result.corners[film.name]
        if corner is not None:
            left.axvline(corner.corner_Hz, color=f"C{i % 10}", lw=1, ls=":", label="" if i else "corner")
    response = [p.response_N_per_V for p in result.points]
    u = [p.response_N_per_V * p.load_measured_u / p.load_measured_N for p in result.points]
    right.errorbar(frequency, response, u, fmt="ko-", ms=4, lw=1, capsize=2)
    for ax in (left, middle, right):
        ax.set_xscale("log")
        ax.axvspan(min(*frequency, TACTILE), TACTILE, color="tab:green", alpha=0.08, label=f"touch, to {TACTILE:g} Hz")
        ax.set_xlabel("frequency (Hz)")
    left.set_yscale("log")
    left.set_ylabel("gain (mV/N; bars: u)")
    middle.set_ylabel("phase before first base film (°; bars: u)")
    right.set_ylabel("load for the drive (N/V; bars: u of the load)")
    name_all(left)
    return save(figure, folder)
