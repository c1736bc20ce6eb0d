"""Computes and draws the waveforms at each stage of a scene, from the shaker's coil to the samples."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.instrument.arrays import Floats
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.procedures.lab.store import store
from palpate.procedures.showing.figure import picture_file, write
from palpate.procedures.showing.text import STAMP
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import Waveforms, waveforms

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# --- waveforms of a scene ------------------------------------------------------------------------------

PLACES = ("under the tooth", "under the base")
SEVERAL = ("under the teeth", "under the base")


def plot(scene: str, question: Question, periods: int, out: Path | None) -> dict[str, Any]:
    """Draw a scene's waveforms into a file; returns what JSON says about the picture.

    Args:
        scene: name or file of the scene.
        question: the measurement to simulate.
        periods: number of periods of the drive to draw.
        out: the file; None: a new file in the store.

    Raises:
        UsageError, RecordError: the file cannot be written.
        ConfigError, UnknownName: the scene is wrong.
    """
    chosen = read_scene(scene)
    file = picture_file("".join(c if c.isalnum() or c in "-_" else "-" for c in chosen.name), out, store())
    load, frequency = show(question.load, "N"), show(question.frequency, "Hz")
    title = f"scene {chosen.name}: sample {question.sample}, {load} peak to peak at {frequency}"
    draw(chosen.design, waveforms(chosen, question, periods), title, file)
    return {"scene": chosen.name, "sample": question.sample, "load_N": question.load, "file": str(file)}


def draw(design: Design, seen: Waveforms, title: str, file: Path) -> None:
    """Draw waveforms into a file: first the drive, then the films stage by stage; teeth left, bases right.

    Raises:
        RecordError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 9.5), layout="constrained")
    figure.suptitle(f"{STAMP} {title}")
    grid = figure.subplots(4, 2, sharex=True)
    milliseconds = 1e3 * seen.time
    drive = ((seen.coil, "shaker's coil", "voltage (V)"), (seen.force, "load cell", "force (N)"))
    for axes, (values, what, quantity) in zip(grid[0], drive, strict=True):
        axes.plot(milliseconds, values, "k", lw=1.2)
        axes.set_title(what, fontsize=10)
        axes.set_ylabel(quantity)
    places = PLACES if len(design.teeth) == 1 else SEVERAL
    for column, (kind, place) in enumerate(zip(FILM_KINDS, places, strict=True)):
        films = [(number, film) for number, film in enumerate(design.films) if film.kind == kind]
        before, behind, sampled = grid[1:, column]
        _draw_films(before, films, milliseconds, seen.before, f"films {place}, before their amplifiers")
        _draw_films(behind, films, milliseconds, seen.films, f"films {place}, behind their amplifiers")
        _draw_samples(sampled, films, seen, f"samples of the films {place}")
    for axes in grid.flat:
        axes.grid(alpha=0.3)
        axes.margins(x=0)
        axes.ticklabel_format(axis="y", useOffset=False)
    write(figure, file)


def _draw_films(axes: Axes, films: Sequence[tuple[int, Film]], milliseconds: Floats, volts: Floats, title: str) -> None:
    for place, (number, film) in enumerate(films):
        axes.plot(milliseconds, 1e3 * volts[number], lw=1.2, color=_colour(place, len(films)), label=film.name)
    axes.set_title(title, fontsize=10)
    axes.set_ylabel("voltage (mV)")


def _draw_samples(axes: Axes, films: Sequence[tuple[int, Film]], seen: Waveforms, title: str) -> None:
    time = 1e3 * seen.sample_time
    saturated = "saturated"
    for place, (number, film) in enumerate(films):
        volts, cut = 1e3 * seen.samples[number], seen.saturated[number]
        axes.plot(time, volts, ".-", ms=4, lw=0.5, color=_colour(place, len(films)), label=film.name)
        if cut.any():
            axes.plot(time[cut], volts[cut], "rx", ms=7, label=saturated)
            saturated = "_"  # hides all but the first from the legend
    axes.set_title(title, fontsize=10)
    axes.set_ylabel("voltage (mV)")
    axes.set_xlabel("time (ms)")
    # one legend below the column, because its panels share their colours
    axes.legend(fontsize=8, ncols=6, loc="upper center", bbox_to_anchor=(0.5, -0.25), frameon=False)


def _colour(place: int, count: int) -> Any:
    from matplotlib import colormaps

    return f"C{place}" if count <= 10 else colormaps["viridis"](place / (count - 1))
