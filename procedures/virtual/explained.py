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
from palpate.simulators.planning.weights import DRAWS, Progress, Weight, weigh
from palpate.simulators.scenes.scene import Scene, shipped

if TYPE_CHECKING:
    from rich.table import Table

    from palpate.simulators.planning.plan import SteadyState


# --- The names of the effects that a scene can call for ------------------------------------------------

__all__ = ["GROUP", "effect_names"]


# --- Lists the scenes, shows all parameters of one, and checks whether it can be simulated -------------

SHOWN = 12  # digits


def all_shipped() -> list[dict[str, Any]]:
    """A row for JSON about each scene that comes with palpate."""
    return [_head(read_scene(name)) for name in shipped()]


def parameters(scene: str) -> dict[str, Any]:
    """All parameters of a scene, for JSON. Raises ConfigError, UnknownName: the scene is wrong."""
    chosen = read_scene(scene)
    return {
        **_head(chosen),
        "rig": chosen.rig.model_dump(mode="json"),
        "parameters": {name: effect.model_dump(mode="json") for name, effect in chosen.effects.items()},
    }


def run_briefly(scene: str) -> dict[str, Any]:
    """Simulate a scene for a moment; a row for JSON about it. Raises PalpateError: it cannot be simulated."""
    chosen = read_scene(scene)
    waveforms(chosen, Question(), periods=1)
    return _head(chosen)


def _head(scene: Scene) -> dict[str, Any]:
    return {
        "scene": scene.name,
        "purpose": scene.purpose,
        "design": scene.design.name,
        "model": scene.model,
        "parameter_set": scene.file.parameters,
        "seed": scene.seed,
        "nodes": scene.nodes,
        "effects": list(scene.effects),
    }


def print_list(scenes: Sequence[dict[str, Any]]) -> None:
    """Print a row for each scene, with its purpose."""
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("scene", "design", "nodes", "effects", "purpose"):
        table.add_column(column, justify="right" if column in ("nodes", "effects") else "left")
    for scene in scenes:
        table.add_row(
            scene["scene"], scene["design"], str(scene["nodes"]), str(len(scene["effects"])), scene["purpose"]
        )
    console().print(table)


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

MEASURED = ("force\nchanges", "ratio\nchanges", "ms")  # titles of columns
WHY = "why"  # the column that is folded in a narrow terminal


@dataclass(frozen=True, slots=True)
class Explained:
    """A scene, its plan for a question, what each effect changes and costs, and the tolerance for omitted ones.

    Attributes:
        tolerance: an omitted effect that could change more is marked.
        weights: measured changes and times, of effects in the scene and of the omitted ones, by name.
        unmeasured: why there are no weights; empty if there are.
    """

    scene: Scene
    answer: AnswerPlan
    tolerance: float
    weights: Mapping[str, Weight]
    unmeasured: str = ""

    @classmethod
    def of(
        cls, name: str, question: Question, tolerance: float, *, strict: bool = False, progress: Progress | None = None
    ) -> Self:
        """Explain a scene by its name or file.

        Args:
            name: the scene.
            question: the measurement.
            tolerance: an omitted effect that could change more is marked.
            strict: whether a warning is an error.
            progress: called while effects are measured, as by `weigh`.

        Raises:
            ConfigError: the scene is wrong, or it has warnings with `strict`.
        """
        scene = read_scene(name)
        answer = plan(scene, question)
        if strict and answer.warnings:
            raise ConfigError(f"scene {name!r}: {answer.warnings[0]}")
        omitted = [each.name for each in answer.omitted]
        try:
            weights, unmeasured = weigh(scene, question, omitted, progress), ""
        except EstimateError as error:
            weights = [Weight(name, None, None, None) for name in (*scene.effects, *omitted)]
            unmeasured = str(error)
        return cls(scene, answer, tolerance, {each.name: each for each in weights}, unmeasured)

    def summary(self) -> dict[str, Any]:
        """The explanation for JSON."""
        return {
            "scene": self.scene.name,
            "model": self.scene.model,
            "parameter_set": self.scene.file.parameters,
            "tolerance": self.tolerance,
            **asdict(self.answer),
            "measured": [asdict(each) for each in self.weights.values()],
            "unmeasured": self.unmeasured,
            "faults": self.scene.file.fault or [],
        }


def print_explained(found: Explained) -> None:
    """Print the path, the simulated and the omitted effects, the settled state if it was asked for, and warnings."""
    scene, answer, tolerance = found.scene, found.answer, found.tolerance
    inside = [
        (e.name, e.kind, "yes" if e.cancels_in_ratio else "no", *_measured(found.weights[e.name]), e.why)
        for e in answer.included
    ]
    outside = [
        (
            e.name, e.kind, *("no limit *" if b is None else _marked(b, tolerance) for b in (e.force, e.ratio)),
            *_measured(found.weights[e.name]),
        )
        for e in answer.omitted
    ]  # fmt: skip
    changes = f"measured with and without it, the root mean square over {DRAWS} draws of all noise and scatter"
    print_all(
        f"Scene {scene.name}: {scene.purpose}",
        f"path: {answer.path}: {answer.why}",
        f"{answer.transitions:g} transitions a second, about {answer.seconds:.2g} s of computing",
        "simulated",
        _table(("effect", "kind", "cancels\nin ratio", *MEASURED, WHY), inside),
        f"left out, and the most that it could change (* above {tolerance:g})",
        _table(("effect", "kind", "force\nat most", "ratio\nat most", *MEASURED), outside),
        f"force changes, ratio changes: {found.unmeasured or changes}",
        "ms: processor time that it adds to a second of bench; below 0: it saves time, or adds next to none",
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


def _measured(weight: Weight) -> tuple[str, ...]:
    if weight.force is None or weight.ratio is None or weight.seconds is None:
        return ("-", "-", "-")
    return f"{weight.force:.1e}", f"{weight.ratio:.1e}", f"{1e3 * weight.seconds:.1f}"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich.table import Column, Table

    table = Table(*(Column(name, no_wrap=name != WHY) for name in columns), box=None)
    for row in rows:
        table.add_row(*row)
    return table


def _marked(bound: float, tolerance: float) -> str:
    return f"{bound:.1e}{' *' if bound > tolerance else ''}"
