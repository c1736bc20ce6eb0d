"""Explains what a scene simulates and how, and how much the omitted effects could change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

from palpate.instrument.errors import ConfigError, EstimateError
from palpate.procedures.console.terminal import console
from palpate.procedures.showing.text import print_all
from palpate.simulators.effects import GROUP, effect_names
from palpate.simulators.planning.plan import AnswerPlan, plan
from palpate.simulators.planning.plan import Question as Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import waveforms
from palpate.simulators.planning.weights import DRAWS, PRICE, PRICE_OF, PriceLine, Progress, Weight, priced, weigh
from palpate.simulators.scenes.heads import SceneHead, head_of
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.simulators.planning.plan import SteadyState


# --- The names of the effects that a scene can call for ------------------------------------------------

__all__ = ["GROUP", "effect_names"]


# --- Shows all parameters of one, and checks whether it can be simulated -------------

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
    chosen = read_scene(scene)
    waveforms(chosen, Question(), periods=1)
    return head_of(chosen)


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
        return self.prices[name].told() if name in self.prices else ("-", "-")


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
        a, b = found.prices[""].told()
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
