"""Figures with panels side by side, stamped SIMULATED if they are, saved into the folder of a run."""

from __future__ import annotations

import math
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Sequence
from contextvars import ContextVar
from datetime import UTC, datetime
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any, Protocol
from xml.sax.saxutils import escape

import numpy as np

from palpate.instrument.bench.description import Beside
from palpate.instrument.durable import numbered
from palpate.procedures.records.chain import is_run
from palpate.procedures.records.columns import columns_of
from palpate.procedures.records.run import Run, check_new, storing
from palpate.procedures.showing.text import STAMP

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = "osD^vP*X"
FORMATS = (".png", ".svg")
MANY = 2000  # points of a line or a cloud that SVG has as an image: as a path it would have 100 bytes for each
_drawn_anew: ContextVar[tuple[Path, str] | None] = ContextVar("drawn_anew", default=None)  # run, format of its figure
STAMP_ABOVE = 4  # above all bars, bands and curves (3 at most), which would cover it; below legends (5)


def new_figure(simulated: bool, panels: int, title: str) -> tuple[Figure, list[Axes]]:
    """A figure with this many panels in a row below a title, and their axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.2 * panels, 4.2), layout="constrained")
    figure.suptitle(f"{STAMP}: {title}" if simulated else title)
    axes = [figure.add_subplot(1, panels, i + 1) for i in range(panels)]
    for ax in axes:
        _prepare(ax, simulated)
    return figure, axes


def _prepare(axes: Axes, simulated: bool) -> None:
    axes.grid(alpha=0.3)
    if simulated:
        axes.text(
            0.5, 0.5, STAMP, transform=axes.transAxes, fontsize=34, color="red", alpha=0.12, rotation=25,
            ha="center", va="center", zorder=STAMP_ABOVE,
        )  # fmt: skip


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Make the horizontal axis logarithmic, from low to high, with plain labels that do not touch."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, StrMethodFormatter

    axes.set(xscale="log", xlim=(low, high))
    axes.xaxis.set_major_locator(MaxNLocator(5) if high < 8 * low else LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))


def name_all(axes: Axes, columns: int = 3, **look: Any) -> None:
    """Draw the legend of a panel above it, where it covers no point."""
    axes.legend(fontsize=8, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False, **look)


def with_u(
    rows: Sequence[Any], name: str, scale: float = 1.0, item: int | None = None
) -> tuple[list[float], list[float] | None]:
    """Values of a field of points, and their standard uncertainties by its column, for `errorbar`.

    Args:
        rows: the points.
        name: the field.
        scale: factor of both.
        item: of a field that holds a list: which entry.
    """
    u = columns_of(type(rows[0]))[name].u if rows else ""

    def values(field: str) -> list[float]:
        found = (getattr(row, field) if item is None else getattr(row, field)[item] for row in rows)
        return [math.nan if each is None else scale * each for each in found]

    return values(name), values(u) if u else None


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


def picture_file(subject: str, out: Path | None, store: Path) -> Path:
    """Path of a new picture: `out`, or a file in `plots/` of the store, named after time and subject.

    Raises as `check_new` does, and RecordError: the store cannot be written to.
    """
    if out is None:
        plots = store / "plots"
        with storing(plots):
            plots.mkdir(parents=True, exist_ok=True)
            names = (f"{name}.png" for name in numbered(f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{subject}"))
            return next(plots / name for name in names if not (plots / name).exists()).absolute()
    check_new(out, FORMATS)
    return out.absolute()


def save(figure: Figure, folder: Path) -> Path:
    """Save a figure as PNG; in the folder of a run with what stood beside its points.

    Returns its path. Raises RecordError: the file cannot be written, or the run not be read.
    """
    run, suffix = _drawn_anew.get() or (folder, ".png")
    path = folder / f"plot{suffix}"
    if is_run(run):
        _add_beside(figure, Run.open(run))
    write(figure, path)
    return path


def drawn_anew(draw: Callable[[Path], Path], run: Path, suffix: str) -> bytes:
    """The picture that `draw` draws into a folder of a run, in another format; PNG if it does not use `save`."""
    token = _drawn_anew.set((run, suffix))
    try:
        with tempfile.TemporaryDirectory() as folder:
            return draw(Path(folder)).read_bytes()
    finally:
        _drawn_anew.reset(token)


def is_png(picture: bytes) -> bool:
    """Whether a picture is PNG."""
    return picture.startswith(b"\x89PNG")


def _add_beside(figure: Figure, run: Run) -> None:
    """Draw what was read beside each point of a run, one panel below the other on the right of a figure's panels."""
    asked = tomllib.loads(str(run.header.get("bench", ""))).get("beside", {})
    if not asked:
        return
    points, panels = run.points(), figure.axes
    width, height = figure.get_size_inches()
    figure.set_size_inches(width * (len(panels) + 1) / len(panels), height)
    grid = figure.add_gridspec(1, len(panels) + 1)
    for number, axes in enumerate(panels):
        axes.set_subplotspec(grid[number])
    column = grid[-1].subgridspec(len(asked), 1)
    for number, (name, table) in enumerate(asked.items()):
        beside, axes = Beside.model_validate(table), figure.add_subplot(column[number])
        values = [math.nan if (value := point.get(beside.column(name))) is None else value for point in points]
        axes.errorbar(range(1, len(points) + 1), values, beside.u, fmt=".", color="k", lw=1, capsize=2)
        axes.set(xlabel="number of the point", ylabel=f"{name} ({beside.unit or '1'}{'; bars: u' if beside.u else ''})")
        _prepare(axes, run.simulated)


def write(figure: Figure, path: Path, dpi: int = 120) -> None:
    """Write a figure into a file, as PNG or SVG by its suffix, with its text for who cannot see it.

    Raises RecordError: the file cannot be written.
    """
    from matplotlib import rc_context

    title, description = described(figure)
    vector = path.suffix == ".svg"
    for artist in figure.findobj(_has_many) if vector else ():
        artist.set_rasterized(True)
    about = {"Title": title, "Description": description} | ({"Date": None} if vector else {"Software": None})
    with storing(path), warnings.catch_warnings(), rc_context({"svg.hashsalt": "palpate"}):
        warnings.filterwarnings("ignore", "Creating legend with loc", UserWarning)  # comes on a busy machine
        figure.savefig(path, dpi=dpi, metadata=about)
        if vector:  # matplotlib writes <title>, and the text only into its metadata
            text = path.read_text(encoding="utf-8")
            path.write_text(
                text.replace("</title>", f"</title>\n <desc>{escape(description)}</desc>", 1), encoding="utf-8"
            )


def _has_many(artist: Artist) -> bool:
    """Whether it is a line or a cloud of many points."""
    from matplotlib.collections import Collection
    from matplotlib.lines import Line2D

    if isinstance(artist, Line2D):
        return np.size(artist.get_xdata()) > MANY
    return isinstance(artist, Collection) and max(np.shape(artist.get_offsets())[0], len(artist.get_paths())) > MANY


def described(figure: Figure) -> tuple[str, str]:
    """The title of a figure, and in words what its panels show."""
    title = figure.get_suptitle().replace("\n", " ")
    panels = []
    for number, axes in enumerate((each for each in figure.axes if each.get_ylabel() or each.get_xlabel()), 1):
        names = [str(name) for name in axes.get_legend_handles_labels()[1]]
        words = f"{axes.get_title()} {axes.get_ylabel()} over {axes.get_xlabel()}".strip().replace("\n", " ")
        panels.append(f"Panel {number}: {words}" + (f"; {', '.join(dict.fromkeys(names))}" if names else "") + ".")
    return title, " ".join([f"{title}.", *panels])
