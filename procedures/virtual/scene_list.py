"""Lists the scenes that come with palpate."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.procedures.console.terminal import console
from palpate.simulators.scenes.heads import SceneHead, head_in, head_of, shipped


def all_shipped() -> list[SceneHead]:
    """The head of each scene that comes with palpate. Raises ConfigError: the file of one is wrong."""
    return [head_in(path) or _whole(name) for name, path in shipped().items()]


def _whole(name: str) -> SceneHead:
    from palpate.simulators.planning.settle import read_scene

    return head_of(read_scene(name))


def names() -> list[str]:
    """The names of the scenes that come with palpate."""
    return list(shipped())


def print_list(scenes: Sequence[SceneHead]) -> None:
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
