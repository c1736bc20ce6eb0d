"""The benches of tests: the scene that a marker asks for, and the report about the bench of a failed test."""

from __future__ import annotations

import functools
import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.clock import WallClock
from palpate.instrument.bench.description import BenchDescription, read_bench
from palpate.instrument.errors import PalpateError
from palpate.procedures.lab.chosen import DEFAULT_SCENE
from palpate.procedures.lab.operator import ConsoleOperator
from palpate.procedures.testing.wire import Traffic
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene, with_faults
from palpate.simulators.scenes.heads import shipped
from palpate.simulators.scenes.scene import Scene


@dataclass(frozen=True, slots=True)
class WatchedBench:
    """The bench of a test.

    Attributes:
        bench: the bench, not open yet.
        what: what the bench is, with its scene, seed and faults.
        traffic: the messages that went over its links.
    """

    bench: Bench
    what: str
    traffic: Traffic


def described(file: Path) -> BenchDescription:
    """The description in a bench file. Raises UsageError: the file is missing or wrong."""
    try:
        return read_bench(file)
    except PalpateError as error:
        raise pytest.UsageError(f"--bench: {error}") from None


def marked_scene(item: pytest.Item) -> Scene:
    """The scene that a test's marker asks for. Raises UsageError: the scene or one of its faults is not possible."""
    marker = item.get_closest_marker("scene")
    try:
        return _asked(item.path.parent, *marker.args, **marker.kwargs) if marker else _read(DEFAULT_SCENE)
    except (PalpateError, TypeError) as error:
        raise pytest.UsageError(f"{item.nodeid}: marker scene: {error}") from None


def _asked(
    folder: Path, name: str = DEFAULT_SCENE, *, seed: int | None = None, faults: Sequence[Mapping[str, Any]] = ()
) -> Scene:
    """The scene for a marker's arguments; a scene file is looked for in the test's folder."""
    is_file = name not in shipped() and name.endswith(".toml")
    scene = _read(str(folder / name) if is_file else name)
    if seed is not None:
        scene = scene.with_seed(seed)
    return with_faults(scene, faults) if faults else scene


@functools.cache
def _read(name: str) -> Scene:
    return read_scene(name)


@contextmanager
def simulated_bench(scene: Scene) -> Iterator[WatchedBench]:
    """Serve a scene, and give its bench."""
    with SimulatedBench(scene, stepped=True) as simulated:
        bench = Bench(simulated.description, simulated.clock, simulated.operator)
        faults = [f"fault {table}" for table in scene.file.fault or ()]
        yield WatchedBench(bench, "\n".join([f"scene {scene.name}, seed {scene.seed}", *faults]), Traffic(bench))


@contextmanager
def real_bench(description: BenchDescription) -> Iterator[WatchedBench]:
    """The real bench of a bench file."""
    bench = Bench(description, WallClock(), ConsoleOperator())
    bench.waits = lambda why: click.echo(f"palpate: note: {why}", err=True)
    for caution in bench.cautions:
        click.echo(f"palpate: note: {caution}", err=True)
    yield WatchedBench(bench, f"bench {description.name}", Traffic(bench))


def failure_report(item: pytest.Item, watch: WatchedBench) -> str:
    """A report about the bench of a failed test, with the command that runs the test again."""
    config = item.config
    place = os.path.relpath(item.path, config.invocation_params.dir)
    name = item.nodeid.partition("::")[2]
    real = config.getoption("palpate_bench")
    command = ["pytest", f"{place}::{name}", *(["--bench", real] if real else [])]
    return f"{watch.what}\n{watch.traffic.report()}\nagain: {shlex.join(command)}"
