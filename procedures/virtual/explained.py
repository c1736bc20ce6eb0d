"""Explains what a scene simulates and how, and how much the omitted effects could change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Self

from palpate.instrument.errors import ConfigError
from palpate.procedures.console.terminal import console
from palpate.simulators.planning.plan import Plan, plan
from palpate.simulators.planning.plan import Question as Question  # commands ask by it
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene

if TYPE_CHECKING:
    from rich.table import Table


@dataclass(frozen=True, slots=True)
class Explained:
    """A scene, its plan for a question, and the tolerance above which an omitted effect is marked."""

    scene: Scene
    answer: Plan
    tolerance: float

    @classmethod
    def of(cls, name: str, question: Question, tolerance: float, *, strict: bool = False) -> Self:
        """Explain a scene by its name or file. Raises ConfigError: it is wrong, or it has warnings with `strict`."""
        scene = read_scene(name)
        answer = plan(scene, question)
        if strict and answer.warnings:
            raise ConfigError(f"scene {name!r}: {answer.warnings[0]}")
        return cls(scene, answer, tolerance)

    def summary(self) -> dict[str, Any]:
        """The explanation for JSON."""
        return {
            "scene": self.scene.name,
            "model": self.scene.model,
            "parameter_set": self.scene.file.parameters,
            "tolerance": self.tolerance,
            **asdict(self.answer),
            "faults": self.scene.file.fault or [],
        }


def print_explained(found: Explained) -> None:
    """Print the path, the simulated and the omitted effects, the settled state if it was asked for, and warnings."""
    scene, answer, tolerance = found.scene, found.answer, found.tolerance
    out = console()
    out.print(f"Scene {scene.name}: {scene.purpose}", soft_wrap=True)
    out.print(f"path: {answer.path}: {answer.why}", soft_wrap=True)
    out.print(f"{answer.transitions:g} transitions a second, about {answer.seconds:.2g} s of computing")
    inside = [
        (e.name, e.kind, "yes" if e.cancels_in_ratio else "no", f"{1e3 * e.seconds:.2g}", e.why)
        for e in answer.included
    ]
    out.print("simulated")
    out.print(_table(("effect", "kind", "cancels in the ratio", "cost (ms)", "why"), inside))
    outside = [
        (e.name, e.kind, *("no limit *" if b is None else _marked(b, tolerance) for b in (e.force, e.ratio)))
        for e in answer.omitted
    ]
    out.print(f"left out, and the most that it could change (* above {tolerance:g})", soft_wrap=True)
    out.print(_table(("effect", "kind", "force", "ratio"), outside))
    if answer.steady is not None:
        films = [
            (f.film, f"{1e3 * f.amplitude:.6g}", f"{f.phase:.4f}", "" if f.ratio is None else f"{f.ratio:.6g}")
            for f in answer.steady.films
        ]
        out.print(f"settled, at {answer.steady.force:.6g} N peak to peak on the load cell", soft_wrap=True)
        out.print(_table(("film", "amplitude (mV)", "phase (rad)", "force ratio"), films))
    for fault in scene.file.fault or []:
        out.print("fault: " + ", ".join(f"{key} {value}" for key, value in fault.items()), soft_wrap=True)
    for warning in answer.warnings:
        out.print(f"warning: {warning}", soft_wrap=True)


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    from rich.table import Table

    table = Table(*columns, box=None)
    for row in rows:
        table.add_row(*row)
    return table


def _marked(bound: float, tolerance: float) -> str:
    return f"{bound:.1e}{' *' if bound > tolerance else ''}"
