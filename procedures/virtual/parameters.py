"""Lists the scenes, shows all parameters of one, and checks whether it can be simulated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate.procedures.console.terminal import console
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import waveforms
from palpate.simulators.scenes.scene import Scene, shipped

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
