"""Measures methods that integrate a stiff chain in time, with a table and a work-precision diagram."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.procedures.console.progress import Progress
from palpate.procedures.console.terminal import console
from palpate.procedures.showing.figure import MARKERS, save_in_new
from palpate.simulators.linear import bouc_wen, integrators

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = Sequence[Mapping[str, Any]]  # method, setting, error, seconds, failure

BOUC_WEN = "Bouc-Wen"  # methods of the second task begin so
SECONDS = 5.0  # s of processor time that `measure` takes [M]


def measure(progress: Progress) -> Rows:
    """A row for JSON about each method at each setting."""
    rows = []
    for done in chain(integrators.compare(), bouc_wen.compare()):
        rows.append(asdict(done))
        progress(len(rows), 0, done.method)
    return rows


def task() -> dict[str, Any]:
    """The task of the methods, for JSON."""
    return {
        "states": integrators.STATES,
        "stiffness_ratio": integrators.STIFFNESS,
        "duration_s": integrators.DURATION,
    }


def print_integrators(rows: Rows, title: str, plot: Path | None) -> None:
    """Print one line for each method and setting; failures are shown as failures."""
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for column, justify in (("method", "left"), ("step or tolerance", "right"), ("error", "right"), ("CPU s", "right")):
        table.add_column(column, justify=justify)  # type: ignore[arg-type]
    table.add_column("")
    for row in rows:
        setting = "" if row["setting"] is None else f"{row['setting']:.3g}"
        error = "-" if row["error"] is None else f"{row['error']:.0e}"
        table.add_row(row["method"], setting, error, f"{row['seconds']:.2g}", row["failure"])
    out = console(width=max(console().width, 110))
    out.print(table)
    if plot is not None:
        out.print(f"plot           {plot}", soft_wrap=True)


def plot_integrators(rows: Rows, title: str, folder: Path) -> Path:
    """Draws `integrators.png` in a folder: error against CPU time, failures at the upper edge.

    Raises:
        RecordError: the folder or file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13, 5.2), layout="constrained")
    figure.suptitle(title, fontsize=10)
    for place, bent in enumerate((False, True)):  # each task has an output and axes of its own
        own = [row for row in rows if row["method"].startswith(BOUC_WEN) == bent]
        name = "the force of a Bouc-Wen operator" if bent else "the output of the chain"
        _draw(own, figure.add_subplot(1, 2, place + 1), name)
    return save_in_new(figure, folder, "integrators.png")


def _draw(rows: Rows, ax: Axes, name: str) -> None:
    for number, method in enumerate(dict.fromkeys(row["method"] for row in rows)):
        own = [row for row in rows if row["method"] == method]
        good = [(row["seconds"], row["error"]) for row in own if row["error"] is not None]
        style = f"C{number % 10}{MARKERS[number % len(MARKERS)]}-"
        ax.plot([x for x, _ in good], [y for _, y in good], style, ms=7, lw=1, label=method)
        for row in own:
            if row["error"] is None:
                ax.plot(row["seconds"], 1.0, f"C{number % 10}x", ms=11, mew=2.5, clip_on=False, zorder=3)
    ax.set(xscale="log", yscale="log", xlabel="processor time (s)", ylabel=f"greatest error of {name}, relative")
    ax.set_ylim(top=1.0)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, title="crosses: no answer", title_fontsize=8)
