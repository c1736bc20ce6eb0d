"""Figures with panels side by side, stamped SIMULATED if they are, saved into the folder of a run."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Protocol

from palpate.procedures.records.run import storing
from palpate.procedures.showing.text import STAMP

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "osD^vP*X"
_as_svg = ContextVar("as_svg", default=False)
STAMP_ABOVE = 4  # above all bars, bands and curves (3 at most), which would cover it; below legends (5)


def new_figure(simulated: bool, panels: int, title: str) -> tuple[Figure, list[Axes]]:
    """A figure with this many panels in a row below a title, and their axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * panels, 4.2), layout="constrained")
    figure.suptitle(f"{STAMP}: {title}" if simulated else title)
    axes = [figure.add_subplot(1, panels, i + 1) for i in range(panels)]
    for ax in axes:
        ax.grid(alpha=0.3)
        if simulated:
            ax.text(
                0.5, 0.5, STAMP, transform=ax.transAxes, fontsize=34, color="red", alpha=0.12, rotation=25,
                ha="center", va="center", zorder=STAMP_ABOVE,
            )  # fmt: skip
    return figure, axes


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Make the horizontal axis logarithmic, from low to high, with plain labels that do not touch."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

    axes.set(xscale="log", xlim=(low, high))
    axes.xaxis.set_major_locator(MaxNLocator(5) if high < 8 * low else LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


class PlottedLoadSet(Protocol):
    """A point of a run that has a force ratio."""

    @property
    def load_N(self) -> float: ...
    @property
    def force_ratio(self) -> float: ...
    @property
    def force_ratio_u(self) -> float: ...
    @property
    def valid(self) -> bool: ...


def plot_over_loads(axes: Axes, number: int, label: str, sets: Sequence[PlottedLoadSet]) -> None:
    """Draw load sets with their uncertainties, and one line through the mean of the valid ones at each load.

    `number` chooses colour and marker.
    """
    color = f"C{number % 10}"
    axes.errorbar(
        [each.load_N for each in sets], [each.force_ratio for each in sets], [each.force_ratio_u for each in sets],
        fmt=MARKERS[number % len(MARKERS)], color=color, ms=4, lw=1, capsize=2, label=label,
    )  # fmt: skip
    loads = sorted({each.load_N for each in sets if each.valid})
    means = [fmean(each.force_ratio for each in sets if each.valid and each.load_N == load) for load in loads]
    axes.plot(loads, means, color=color, lw=1)


def save(figure: Figure, folder: Path, name: str = "plot.png") -> Path:
    """Save a figure as PNG; returns its path. Raises RecordError: the file cannot be written."""
    path = folder / name
    if _as_svg.get():
        path = path.with_suffix(".svg")
    write(figure, path)
    return path


@contextmanager
def saved_as_svg() -> Iterator[None]:
    """Inside, `save` writes SVG in the place of PNG."""
    token = _as_svg.set(True)
    try:
        yield
    finally:
        _as_svg.reset(token)


def save_in_new(figure: Figure, folder: Path, name: str) -> Path:
    """As `save`, in a folder that is made if there is none."""
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return save(figure, folder, name)


def write(figure: Figure, path: Path, dpi: int = 120) -> None:
    """Write a figure into a file. Raises RecordError: the file cannot be written."""
    from matplotlib import rc_context

    with storing(path), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Creating legend with loc", UserWarning)  # comes on a busy machine
        vectors = path.suffix == ".svg"
        with rc_context({"svg.hashsalt": ""}):  # else the names in it are random
            figure.savefig(path, dpi=dpi, metadata={"Date": None} if vectors else {"Software": None})
