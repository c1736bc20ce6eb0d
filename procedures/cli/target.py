"""Which bench a command will meet, known before anything of it is opened or simulated."""

from __future__ import annotations

from dataclasses import dataclass

from instrument.bench import BenchDescription, read_bench
from instrument.design import Design
from instrument.designs import get_design
from procedures.cli.options import Choice


@dataclass(frozen=True, slots=True)
class Target:
    """The sensor on it, its force limit in N, and its number of sensor nodes."""

    design: Design
    force_limit: float
    nodes: int


def target_of(choice: Choice) -> Target:
    """The bench of a file, or that of a scene.

    Raises:
        ConfigError, UnknownName: there is no such file or scene, or it is wrong.
    """
    if choice.bench is not None:
        bench = read_bench(choice.bench)
        return Target(get_design(bench.design), bench.force_limit, len(bench.can.nodes))
    from procedures.cli.session import DEFAULT_SCENE
    from simulators.scene import read_scene

    scene = read_scene(DEFAULT_SCENE if choice.scene is None else choice.scene)
    return Target(scene.design, BenchDescription.model_fields["force_limit"].default, scene.nodes)
