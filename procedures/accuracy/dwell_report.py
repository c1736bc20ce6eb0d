"""Prices of dwells: a table of uncertainty and bias by estimator, and a log-log plot of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.records.run import storing
from palpate.procedures.showing.figure import MARKERS, new_figure, write
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from palpate.procedures.accuracy.dwell import DwellPrices

PLOT = "dwell.png"


def print_dwell(prices: DwellPrices, title: str, plot: Path | None) -> None:
    """Print a line for each dwell: the bound, and each estimator's uncertainty and bias in percent of the ratio."""
    estimators = list(dict.fromkeys(p.estimator for p in prices.points))
    table = new_table(
        stamped(True, title), "dwell s", "repeats", "bound %", *(f"{name}\nu %  bias %" for name in estimators)
    )
    for dwell in dict.fromkeys(p.dwell_s for p in prices.points):
        row = [p for p in prices.points if p.dwell_s == dwell]
        cells = [f"{100 * p.u:.2g} {100 * p.bias:+8.2g}" for p in row]
        table.add_row(f"{dwell:.4g}", str(row[0].repeats), f"{100 * row[0].bound:.3g}", *cells)
    parts = ", ".join(f"{name} {u:.2%}" for name, u in prices.floor.items())
    lines = [f"floor that no dwell beats: {prices.floor_u:.2%}: {parts}"]
    mixed = {p.dwell_s: p.hum for p in prices.points if p.hum > 0}
    lines += [
        f"least squares over {d:.4g} s lets {hum:.2g} of the mains' hum into an amplitude" for d, hum in mixed.items()
    ]
    if not mixed:
        lines.append("least squares tells the mains' hum from the drive over each of these dwells")
    if prices.saturated:
        lines.append("a film is over-ranged: none of these figures is of use")
    for each in prices.recommended:
        told = f"{each.why}, {each.dwell_s:g} s" if each.dwell_s is not None else each.why
        if each.target <= prices.floor_u:
            told = "no dwell: that is below the floor"
        lines.append(f"for {100 * each.target:g} %: {told}")
    print_all(table, *lines, *([] if plot is None else [f"plot           {plot}"]))


def plot_dwell(prices: DwellPrices, title: str, folder: Path) -> Path:
    """Draws `dwell.png` in a folder: uncertainty and size of the bias against the dwell.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    figure, axes = new_figure(True, 2, title)
    for number, name in enumerate(dict.fromkeys(p.estimator for p in prices.points)):
        own = [p for p in prices.points if p.estimator == name]
        style = f"C{number}{MARKERS[number]}-"
        dwells = [p.dwell_s for p in own]
        axes[0].plot(dwells, [p.u for p in own], style, ms=5, lw=1, label=name)
        axes[1].errorbar(dwells, [abs(p.bias) for p in own], [p.bias_u for p in own], fmt=style, ms=5, lw=1, label=name)
    bound = {p.dwell_s: p.bound for p in prices.points}
    axes[0].plot(list(bound), list(bound.values()), "k--", lw=1, label="Cramér–Rao bound")
    for ax, label in zip(axes, ("standard uncertainty of the ratio", "size of its bias"), strict=True):
        if prices.floor_u > 0:
            ax.axhline(prices.floor_u, color="0.4", ls=":", label="floor that no dwell beats")
        ax.set(xscale="log", yscale="log", xlabel="dwell (s)", ylabel=f"{label}, relative")
        ax.legend(fontsize=7)
    path = folder / PLOT
    with storing(path):
        folder.mkdir(parents=True, exist_ok=True)
        write(figure, path)
    return path
