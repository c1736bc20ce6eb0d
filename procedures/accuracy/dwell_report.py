"""Prices of dwells: a table of uncertainty and bias by estimator, and a log-log plot of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.showing.figure import MARKERS, new_figure, save_in_new
from palpate.procedures.showing.plan import duration
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from palpate.procedures.accuracy.dwell import DwellPrices, RecommendedDwell

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
    lines = [
        "bound: the least that noise allows where offset, trend and hum are fitted, too (Cramér–Rao); what takes them"
        " for none may scatter less",
        f"floor that no dwell beats: {prices.floor_u:.2%}: {parts}",
    ]
    mixed = {p.dwell_s: p.hum for p in prices.points if p.hum > 0}
    lines += [
        f"least squares over {d:.4g} s lets {hum:.2g} of the mains' hum into an amplitude" for d, hum in mixed.items()
    ]
    if not mixed:
        lines.append("least squares tells the mains' hum from the drive over each of these dwells")
    if prices.saturated:
        lines.append("a film is over-ranged: none of these figures is of use")
    else:
        lines += [f"for {100 * each.target:g} %: {way_of(each)}" for each in prices.recommended]
    print_all(table, *lines, *([] if plot is None else [f"plot           {plot}"]))


def way_of(found: RecommendedDwell) -> str:
    """The way to a target in words, or why there is none."""
    if found.sets is None or found.dwell_s is None or found.seconds is None:
        return found.why
    sets = "one load set" if found.sets == 1 else f"the mean of {found.sets:,} load sets"
    return f"{sets} of {found.dwell_s:g} s by {found.estimator}: {duration(found.seconds)} on the bench"


def plot_dwell(prices: DwellPrices, title: str, folder: Path) -> Path:
    """Draws `dwell.png` in a folder: the uncertainty of one load set with all its parts, then its noise and bias alone.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    figure, (whole, noise, bias) = new_figure(True, 3, title)
    for number, name in enumerate(dict.fromkeys(p.estimator for p in prices.points)):
        own = [p for p in prices.points if p.estimator == name]
        style = f"C{number}{MARKERS[number]}-"
        dwells = [p.dwell_s for p in own]
        whole.plot(dwells, [p.whole_u for p in own], style, ms=5, lw=1, label=name)
        noise.plot(dwells, [p.u for p in own], style, ms=5, lw=1, label=name)
        bias.errorbar(dwells, [abs(p.bias) for p in own], [p.bias_u for p in own], fmt=style, ms=5, lw=1, label=name)
    if prices.floor_u > 0:
        whole.axhline(prices.floor_u, color="0.4", ls=":", label="floor that no dwell beats")
    bound = {p.dwell_s: p.bound for p in prices.points}
    noise.plot(list(bound), list(bound.values()), "k--", lw=1, label="Cramér–Rao bound")
    labels = "uncertainty of one load set, all in", "noise alone", "size of the bias alone"
    for ax, label in zip((whole, noise, bias), labels, strict=True):
        ax.set(xscale="log", yscale="log", xlabel="dwell (s)", ylabel=f"{label}, relative")
        ax.legend(fontsize=7)
    return save_in_new(figure, folder, PLOT)
