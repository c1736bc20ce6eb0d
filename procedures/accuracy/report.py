"""The page of prices: a table of recommended choices, and one log-log plot."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.records.run import storing
from palpate.procedures.showing.figure import MARKERS, write
from palpate.procedures.showing.text import new_table, print_all

if TYPE_CHECKING:
    from palpate.procedures.accuracy.page import Part

PLOT = "accuracy.png"
LEAST = 1e-16  # an exact result is drawn at this error


def print_page(parts: Sequence[Part], plot: Path | None) -> None:
    """Print the recommended method for each tolerance, or the reason why there is none."""
    table = new_table(None, "", "tolerance", "take", "error", "seconds")
    table.columns[0].justify = table.columns[2].justify = "left"
    for part in parts:
        for number, each in enumerate(part.recommended):
            take = " ".join(text for text in (each.name, each.setting) if text)
            if each.error is None or each.seconds is None:
                below = each.tolerance <= part.floor
                take = f"nothing: {f'the floor is {part.floor:.2%}' if below else each.why}"
            error = "" if each.error is None else f"{each.error:.1e}"
            seconds = "" if each.seconds is None else f"{each.seconds:.2g}"
            table.add_row("" if number else part.name, f"{100 * each.tolerance:g} %", take, error, seconds)
    print_all(table, "seconds are CPU time, of a dwell time on the bench")
    if plot is not None:
        print_all(f"plot           {plot}")


def plot_page(parts: Sequence[Part], folder: Path) -> Path:
    """Draws `accuracy.png` in a folder: error against seconds of every way.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.5, 7), layout="constrained")
    ax = figure.add_subplot()
    for number, part in enumerate(parts):
        names = dict.fromkeys(way.name for way in part.ways)
        for place, name in enumerate(names):
            own = [(w.seconds, max(w.error, LEAST)) for w in part.ways if w.name == name and w.error is not None]
            if own:
                style = f"C{number}{MARKERS[place % len(MARKERS)]}-"
                ax.plot(*zip(*own, strict=True), style, ms=5, lw=0.8, label=f"{part.name}: {name}")
        if part.floor > 0:
            ax.axhline(part.floor, color=f"C{number}", ls=":", lw=1, label=f"{part.name}: floor that none beats")
    ax.set(xscale="log", yscale="log", xlabel="seconds (CPU; of a dwell, on the bench)", ylabel="relative error")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=6.5, loc="center left", bbox_to_anchor=(1.0, 0.5))
    path = folder / PLOT
    with storing(path):
        folder.mkdir(parents=True, exist_ok=True)
        write(figure, path)
    return path
