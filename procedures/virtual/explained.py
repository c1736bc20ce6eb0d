"""Shows a scene: its parameters, what it simulates and omits, what its effects are worth, and its waveforms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import FILM_KINDS, Design, Film
from palpate.procedures.console.terminal import console
from palpate.procedures.lab.store import store
from palpate.procedures.showing.figure import new_figure, picture_file, write
from palpate.procedures.showing.text import STAMP, new_table, print_all, stamped
from palpate.simulators.effects import GROUP, effect_names
from palpate.simulators.planning.plan import AnswerPlan, Question, SteadyState, plan
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import Waveforms, waveforms
from palpate.simulators.planning.weights import (
    DRAWS,
    PRICE,
    PRICE_OF,
    PriceLine,
    Progress,
    Subset,
    Weight,
    front,
    nested,
    priced,
    weigh,
)
from palpate.simulators.scenes.heads import SceneHead, head_of
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.table import Table


__all__ = ["GROUP", "Question", "effect_names"]  # also for commands and templates


# --- All parameters of a scene, and whether it can be simulated ----------------------------------------

SHOWN = 12  # digits


def parameters(scene: str) -> dict[str, Any]:
    """All parameters of a scene, for JSON. Raises ConfigError, UnknownName: the scene is wrong."""
    chosen = read_scene(scene)
    return {
        **head_of(chosen),
        "rig": chosen.rig.model_dump(mode="json"),
        "parameters": {name: effect.model_dump(mode="json") for name, effect in chosen.effects.items()},
    }


def run_briefly(scene: str) -> SceneHead:
    """Simulate a scene for a moment; a row for JSON about it. Raises PalpateError: it cannot be simulated."""
    chosen = _checked(scene)
    waveforms(chosen, Question(), periods=1)
    return head_of(chosen)


def _checked(scene: str) -> Scene:
    """A scene whose bench has what it asks to read or to sample. Raises ConfigError, UnknownName: it is wrong."""
    from palpate.simulators.bench import SimulatedBench

    chosen = read_scene(scene)
    SimulatedBench(chosen).check_beside()
    return chosen


def print_scene(scene: dict[str, Any]) -> None:
    """Print a scene with all its parameters."""
    from rich.table import Table

    out = console()
    out.print(f"{scene['scene']}: {scene['purpose']}", soft_wrap=True)
    chosen = f" with the {scene['parameter_set']} set" if scene["parameter_set"] else ""
    out.print(
        f"design {scene['design']}, model {scene['model']}{chosen}, seed {scene['seed']}, nodes {scene['nodes']}\n"
    )
    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("", "parameter", "value"):
        table.add_column(column)
    for name, parameters in {"rig": scene["rig"], **scene["parameters"]}.items():
        for number, (parameter, value) in enumerate(parameters.items() or [("", "")]):
            table.add_row("" if number else name, parameter, _shown(value))
    out.print(table)


def _shown(value: Any) -> str:
    """A parameter without the last digits of binary arithmetic, which JSON keeps: 0.00181 V."""
    if isinstance(value, list):
        return ", ".join(map(_shown, value))
    number, space, unit = str(value).partition(" ")
    try:
        return f"{float(number):.{SHOWN}g}{space}{unit}"
    except ValueError:
        return str(value)


# --- the explanation -----------------------------------------------------------------------------------

CHANGES = ("force\nchanges", "ratio\nchanges")  # titles of columns
WHY = "why"  # the column that is folded in a narrow terminal


@dataclass(frozen=True, slots=True)
class Explained:
    """A scene, its plan for a question, and what each effect changes and costs.

    Attributes:
        mark: an omitted effect that could change more is marked.
        weights: measured changes, of effects in the scene and of the omitted ones, by name.
        prices: processor time of the scene under "", and what each of its effects adds; none where it is not measured.
        unmeasured: why there are no weights; empty if there are.
    """

    scene: Scene
    answer: AnswerPlan
    mark: float
    weights: Mapping[str, Weight]
    prices: Mapping[str, PriceLine]
    unmeasured: str = ""

    @classmethod
    def of(
        cls,
        name: str,
        question: Question,
        mark: float,
        *,
        strict: bool = False,
        with_prices: bool = False,
        progress: Progress | None = None,
    ) -> Self:
        """Explain a scene by its name or file.

        Args:
            name: the scene.
            question: the measurement.
            mark: an omitted effect that could change more is marked.
            strict: whether a warning is an error.
            with_prices: whether it is measured what the scene and each of its effects cost, which may take a minute.
            progress: called while effects are measured, as by `weigh`.

        Raises:
            ConfigError: the scene is wrong, or it has warnings with `strict`.
        """
        scene = read_scene(name)
        answer = plan(scene, question)
        if strict and answer.warnings:
            raise ConfigError(f"scene {name!r}: {answer.warnings[0]}")
        omitted = [each.name for each in answer.omitted]
        prices, unmeasured = dict[str, PriceLine](), ""
        try:
            weights = weigh(scene, question, omitted, progress)
            prices = priced(scene, question, progress) if with_prices else prices
        except EstimateError as error:
            weights = [Weight(name, None, None) for name in (*scene.effects, *omitted)]
            unmeasured = str(error)
        return cls(scene, answer, mark, {each.name: each for each in weights}, prices, unmeasured)

    def summary(self) -> dict[str, Any]:
        """The explanation for JSON."""
        return {
            "scene": self.scene.name,
            "model": self.scene.model,
            "parameter_set": self.scene.file.parameters,
            "mark": self.mark,
            **asdict(self.answer),
            "price": self._price(""),
            "measured": [{**asdict(each), "price": self._price(each.name)} for each in self.weights.values()],
            "unmeasured": self.unmeasured,
            "faults": self.scene.file.fault or [],
        }

    def _price(self, name: str) -> dict[str, float] | None:
        return asdict(self.prices[name]) if name in self.prices else None

    def changes(self, name: str) -> tuple[str, ...]:
        """Texts of what an effect changes, in the order of `CHANGES`."""
        weight = self.weights[name]
        return tuple("-" if each is None else f"{each:.1e}" for each in (weight.force, weight.ratio))

    def cost(self, name: str) -> tuple[str, str]:
        """Texts of what an effect adds, in the order of `PRICE`."""
        return self.prices[name].texts() if name in self.prices else ("-", "-")


def print_explained(found: Explained) -> None:
    """Print the path, the simulated and the omitted effects, the settled state if it was asked for, and warnings."""
    scene, answer, mark = found.scene, found.answer, found.mark
    inside = [
        (
            e.name, e.kind, "yes" if e.cancels_in_ratio else "no", *found.changes(e.name),
            *(found.cost(e.name) if found.prices else ()), e.why,
        )
        for e in answer.included
    ]  # fmt: skip
    outside = [
        (
            e.name, e.kind, *("no limit *" if b is None else _marked(b, mark) for b in (e.force, e.ratio)),
            *found.changes(e.name),
        )
        for e in answer.omitted
    ]  # fmt: skip
    cost = ""
    if "" in found.prices:
        a, b = found.prices[""].texts()
        cost = f", {a} ms of processor time and {b} µs for each second of bench"
    changes = f"measured with and without it, the root mean square over {DRAWS} draws of all noise and scatter"
    print_all(
        f"Scene {scene.name}: {scene.purpose}",
        f"path: {answer.path}: {answer.why}",
        f"{answer.transitions:g} transitions a second{cost}",
        "simulated",
        _table(("effect", "kind", "cancels\nin ratio", *CHANGES, *(PRICE if found.prices else ()), WHY), inside),
        f"left out, and the most that it could change (* above {mark:g})",
        _table(("effect", "kind", "force\nat most", "ratio\nat most", *CHANGES), outside),
        f"force changes, ratio changes: {found.unmeasured or changes}",
        *([f"processor time that it adds: {PRICE_OF}"] if found.prices else []),
        "-: not known: the films do not show what it changes, or it cannot be put in",
        *([] if answer.steady is None else _settled(answer.steady)),
        *("fault: " + ", ".join(f"{key} {value}" for key, value in fault.items()) for fault in scene.file.fault or []),
        *(f"warning: {warning}" for warning in answer.warnings),
    )


def _settled(steady: SteadyState) -> list[object]:
    films = [
        (f.film, f"{1e3 * f.amplitude:.6g}", f"{f.phase:.4f}", "" if f.ratio is None else f"{f.ratio:.6g}")
        for f in steady.films
    ]
    return [
        f"settled, at {steady.force:.6g} N peak to peak on the load cell",
        _table(("film", "amplitude (mV)", "phase (rad)", "force ratio"), films),
    ]


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich.table import Column, Table

    table = Table(*(Column(name, no_wrap=name != WHY) for name in columns), box=None)
    for row in rows:
        table.add_row(*row)
    return table


def _marked(bound: float, mark: float) -> str:
    return f"{bound:.1e}{' *' if bound > mark else ''}"


# --- What the effects of a scene are worth: with ever fewer of them, what changes and what time is saved

PLOT = "scene.png"


@dataclass(frozen=True, slots=True)
class SceneFront:
    """The subsets of a scene's effects than which no other that was tried is both nearer to the scene and quicker.

    Attributes:
        scene: name of the scene.
        question: sample, load, frequency and dwell for which all was measured.
        weights: what each of the scene's effects changes and costs by itself.
        tried: the subsets that were tried, from all effects to none.
    """

    scene: str
    question: Question
    weights: tuple[Weight, ...]
    tried: tuple[Subset, ...]

    @classmethod
    def of(cls, name: str, question: Question, progress: Progress) -> Self:
        """Measure a scene by its name or file.

        Raises:
            ConfigError, UnknownName: the scene is wrong.
            EstimateError: the films of the scene give no force ratio.
        """
        scene = read_scene(name)
        weights = weigh(scene, question, progress=progress)
        return cls(scene.name, question, tuple(weights), tuple(nested(scene, question, weights, progress)))

    @property
    def front(self) -> list[Subset]:
        """The best of the tried subsets, from the nearest to the scene on."""
        return front(self.tried, self.question.dwell)

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        best = self.front
        return {
            "simulated": True,
            "scene": self.scene,
            "sample": self.question.sample,
            "load_N": self.question.load,
            "frequency_Hz": self.question.frequency,
            "dwell_s": self.question.dwell,
            "effects": [asdict(each) for each in self.weights],
            "subsets": [{**asdict(each), "change": each.change, "front": each in best} for each in self.tried],
        }


def print_front(found: SceneFront, plot: str | None) -> None:
    """Print a line for each subset, with what was left out since the line before."""
    title = f"scene {found.scene}, sample {found.question.sample}: fewer effects, less time"
    table = new_table(
        stamped(True, title), "left out, also", "effects left", "force changes", "ratio changes", *PRICE, "on the front"
    )
    best, count, before = found.front, len(found.weights), set[str]()
    for each in found.tried:
        more = ", ".join(name for name in each.without if name not in before) or "nothing"
        table.add_row(
            more, str(count - len(each.without)), f"{each.force:.1e}", f"{each.ratio:.1e}", *each.price.texts(),
            "yes" if each in best else "",
        )  # fmt: skip
        before = set(each.without)
    stay = ", ".join(each.name for each in found.weights if each.change is None)
    print_all(
        table,
        f"changes: root mean square of {DRAWS} draws, against the whole scene with the same noise",
        f"processor time: {PRICE_OF}",
        f"on the front: for {found.question.dwell:g} s of bench",
        *([f"always simulated, since the films do not show what they change: {stay}"] if stay else []),
        *([] if plot is None else [f"plot           {plot}"]),
    )


def plot_front(found: SceneFront, file: Path) -> None:
    """Draw into a file: a row for each subset, with its changes on the left and its time on the right.

    Raises RecordError: the file cannot be written.
    """
    title = f"scene {found.scene}, sample {found.question.sample}: one effect after the other left out"
    figure, (left, right) = new_figure(True, 2, title)
    rows = range(len(found.tried))
    changes = [change for each in found.tried for change in (each.force, each.ratio) if change > 0]
    none = min(changes, default=1e-6) / 10  # a logarithmic axis has no place for 0
    for quantity, style in (("ratio", "C0o"), ("force", "C1s")):
        sizes = [getattr(each, quantity) for each in found.tried]
        left.plot([size or none for size in sizes], rows, style, ms=5, label=quantity)
    left.axvline(none, color="0.5", ls=":", lw=1)
    left.annotate("no change", (none, 0), xytext=(3, -3), textcoords="offset points", fontsize=7, va="top")
    left.set(xscale="log", xlabel="relative change against the whole scene")
    left.legend(fontsize=8)
    dwell = found.question.dwell
    right.barh(rows, [1e3 * each.price.seconds(dwell) for each in found.tried], height=0.6, color="0.6")
    right.set(xlabel=f"processor time of {dwell:g} s of bench (ms)")
    left.set_yticks(rows, ["all effects", *(f"- {each.without[-1]}" for each in found.tried[1:])], fontsize=8)
    right.set_yticks(rows, [""] * len(found.tried))
    for axes in (left, right):
        axes.set_ylim(len(found.tried) - 0.4, -0.6)
    write(figure, file)


# --- Computes and draws the waveforms at each stage of a scene, from the shaker's coil to the samples --

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
    chosen = _checked(scene)
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
    if seen.load is not None:
        grid[0, 1].set_title("load cell, and samples of its output", fontsize=10)
        output = grid[0, 1].twinx()
        output.plot(1e3 * seen.sample_time, 1e3 * seen.load, ".", ms=4)
        output.set_ylabel("output (mV)", color="C0")
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
