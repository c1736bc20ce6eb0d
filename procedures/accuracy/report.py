"""The page of prices: a table and a panel for each part, from the same ways."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.procedures.showing.figure import MARKERS, save_in_new
from palpate.procedures.showing.text import new_table, print_all, stamped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from palpate.procedures.accuracy.page import PagePart

PLOT = "accuracy.png"
LEAST = 1e-16  # an exact result is drawn at this error


def print_page(parts: Sequence[PagePart], plot: Path | None) -> None:
    """Print a table for each part: the quickest way within each tolerance, or the reason why there is none."""
    from palpate.procedures.accuracy.page import BENCH

    for part in parts:
        named = part.name if part.error_of in part.name else f"{part.name}: {part.error_of}"
        table = new_table(stamped(part.time == BENCH, named), "tolerance", "take", "error", part.time)
        table.columns[1].justify = "left"
        reasons = []
        for each in part.recommended:
            take = " ".join(text for text in (each.name, each.setting) if text)
            if each.error is None or each.seconds is None:
                take = "nothing"
                reasons.append(f"{100 * each.tolerance:g} %: {each.why}")
            error = "" if each.error is None else f"{each.error:.1e}"
            seconds = "" if each.seconds is None else f"{each.seconds:.2g}"
            table.add_row(f"{100 * each.tolerance:g} %", take, error, seconds)
        print_all(table, *reasons, *([part.note] if part.note else []), "")
    if plot is not None:
        print_all(f"plot           {plot}")


def plot_page(parts: Sequence[PagePart], folder: Path) -> Path:
    """Draw `accuracy.png` in a folder: a panel for each part, and one for all of arithmetic.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    from palpate.procedures.accuracy.page import ARITHMETIC

    drawn = [part for part in parts if not part.name.startswith(ARITHMETIC)]
    tasks = [part for part in parts if part.name.startswith(ARITHMETIC)]
    rows = -(-len(drawn) // 2)
    figure = Figure(figsize=(14, 4.6 * rows + 4.2), layout="constrained")
    # The long names of the lower panel do not push the upper ones aside.
    upper, lower = figure.subfigures(2, 1, height_ratios=(4.6 * rows, 4.2), squeeze=False)[:, 0]
    for place, part in enumerate(drawn):
        _draw(part, upper.add_subplot(rows, 2, place + 1))
    _draw_tasks(tasks, lower.add_subplot())
    return save_in_new(figure, folder, PLOT)


def _draw(part: PagePart, ax: Axes) -> None:
    """Error against time of the ways of one part; rings: the ways that the table recommends."""
    from palpate.procedures.accuracy.page import BENCH

    for place, name in enumerate(dict.fromkeys(way.name for way in part.ways)):
        own = [(w.seconds, max(w.error, LEAST)) for w in part.ways if w.name == name and w.error is not None]
        if own:
            style = f"C{place % 10}{MARKERS[place % len(MARKERS)]}-"
            ax.plot(*zip(*own, strict=True), style, ms=4, lw=0.9, label=name)
    told = [(r.seconds, max(r.error, LEAST)) for r in part.recommended if r.seconds is not None and r.error is not None]
    if told:
        ax.plot(*zip(*told, strict=True), "o", ms=11, mfc="none", mec="k", mew=1, label="recommended")
    if part.floor > 0:
        ax.axhline(part.floor, color="0.4", ls=":", lw=1, label=f"floor: {part.floor_of}")
    title = f"{part.name}: {part.error_of}"
    ax.set_title(f"SIMULATED, {title}" if part.time == BENCH else title, fontsize=10)
    ax.set(xscale="log", yscale="log", xlabel=part.time, ylabel="relative error")
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7.5)


def _draw_tasks(tasks: Sequence[PagePart], ax: Axes) -> None:
    """A row for each way of each task of arithmetic, with its error and its time."""
    rows = [(number, part, way) for number, part in enumerate(tasks) for way in part.ways if way.error is not None]
    for row, (number, _, way) in enumerate(rows):
        error = max(way.error or 0.0, LEAST)
        ax.plot([LEAST, error], [row, row], color=f"C{number}", lw=0.8, alpha=0.5)
        ax.plot(error, row, "o", color=f"C{number}", ms=5)
        ax.annotate(
            f"{way.seconds:.1e} s", (error, row), xytext=(6, 0), textcoords="offset points", fontsize=7, va="center"
        )
    ax.set_yticks(range(len(rows)), [f"{part.error_of}: {way.name}" for _, part, way in rows], fontsize=7)
    ax.set(xscale="log", xlim=(LEAST / 2, 100), xlabel="relative error, with processor time beside it")
    ax.set_title("arithmetic", fontsize=10)
    ax.invert_yaxis()
    ax.grid(alpha=0.3, axis="x")
