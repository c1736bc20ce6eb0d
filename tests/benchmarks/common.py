"""What benchmarks share: rows, times taken in turn, commands, benches, and campaigns that are ended and gone on with.

It imports the project only where it is called: `bounds` counts what its trials import.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
PALPATE = (sys.executable, "-c", "from palpate.procedures.commands import main; main()")
HEADER = {"procedure": "benchmark", "simulated": True, "started": "2026-01-02T03:04:05+00:00"}
USED = """
import json, os, resource, sys, time
def used():
    use = resource.getrusage(resource.RUSAGE_SELF)
    return {"cpu": use.ru_utime + use.ru_stime, "wall": time.perf_counter(), "switches": use.ru_nvcsw}
def spent(before):
    now = used()
    return {name: now[name] - before[name] for name in now}
"""


@dataclass(frozen=True, slots=True)
class Row:
    """One figure of the benchmark table."""

    figure: str
    measured: str
    goal: str = ""
    met: bool | None = None


def at_most(figure: str, value: float, goal: float, form: str, measured: str = "") -> Row:
    """A figure that shall not be above its goal; `form` shows both, `measured` says more of the first."""
    return Row(figure, measured or form.format(value), f"<= {form.format(goal)}", bool(value <= goal))


def at_least(figure: str, value: float, goal: float, form: str, measured: str = "") -> Row:
    """A figure that shall not be below its goal."""
    return Row(figure, measured or form.format(value), f">= {form.format(goal)}", bool(value >= goal))


def between(figure: str, value: float, ends: tuple[float, float], form: str, measured: str = "") -> Row:
    """A figure that shall lie between two."""
    goal = " to ".join(map(form.format, ends))
    return Row(figure, measured or form.format(value), goal, bool(ends[0] <= value <= ends[1]))


def none(figure: str, count: int, measured: str = "") -> Row:
    """Something of which there shall be none."""
    return Row(figure, measured or str(count), "0", not count)


# --- times ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, order=True)
class Spent:
    """Time that passed, and processor time of this process and of the programs that it ran [s]."""

    wall: float
    cpu: float


def spent(call: Callable[[], object]) -> Spent:
    """What a call takes."""
    before, start = _processor_seconds(), time.perf_counter()
    call()
    return Spent(time.perf_counter() - start, _processor_seconds() - before)


def _processor_seconds() -> float:
    whose = [resource.getrusage(each) for each in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in whose)


def least(call: Callable[[], object], rounds: int) -> float:
    """Processor time of a call, the least of some: what other processes take is not counted [s]."""
    return min(spent(call).cpu for _ in range(rounds))


def interleaved(first: Callable[[], object], second: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Median seconds of a call of each, taken in turn so that both see the same machine."""
    taken = [(spent(first).wall, spent(second).wall) for _ in range(rounds)]
    one, other = map(statistics.median, zip(*taken, strict=True))
    return one, other


# --- programs ------------------------------------------------------------------------------------------


def palpate(*words: str | Path, folder: Path | None = None, **more: Any) -> str:
    """What a command prints, in this folder or an empty one, where its store is, too."""
    with tempfile.TemporaryDirectory() as empty:
        place = str(folder or empty)
        options = {"cwd": place, "env": {**os.environ, "PALPATE_STORE": place}, "check": True, **more}
        options = {"stdin": subprocess.DEVNULL, "stderr": subprocess.PIPE, **options}
        return subprocess.run([*PALPATE, *words], stdout=subprocess.PIPE, text=True, **options).stdout


@contextmanager
def served(folder: Path) -> Iterator[Path]:
    """The bench file of a bench that another process serves with its first sample."""
    bench = folder / "bench.toml"
    command = [*PALPATE, "serve", "thesis_single", "--samples", "1", "--out", str(bench), "--json"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        while server.stdout.readline() != "}\n":  # the bench is there
            pass
        try:
            yield bench
        finally:
            server.communicate("quit\n")
    assert server.returncode == 0


def checkouts() -> list[Path]:
    """This checkout, and the one that BESIDE names, beside which it is measured.

    Machines differ and have their moods, so what counts is the ratio of both. The other needs no environment of its
    own as long as it needs the same packages: `git worktree add ../before COMMIT`, then `BESIDE=../before`.
    """
    return [ROOT, *([Path(os.environ["BESIDE"]).resolve()] if "BESIDE" in os.environ else [])]


@contextmanager
def _started(script: str, checkout: Path) -> Iterator[subprocess.Popen[str]]:
    with tempfile.TemporaryDirectory() as folder:
        own = {**os.environ, "PYTHONPATH": str(checkout), "PALPATE_STORE": folder}
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        command = [sys.executable, "-c", USED + script]
        with subprocess.Popen(
            command, cwd=folder, env=own, text=True, **pipes
        ) as program:  # at its end input is closed
            yield program


def in_turn(script: str, rounds: int) -> list[dict[str, float]]:
    """What the script prints last, a JSON object of numbers: of each the least in some rounds, for each checkout."""
    found: list[list[dict[str, float]]] = [[] for _ in checkouts()]
    for _ in range(rounds):
        for checkout, results in zip(checkouts(), found, strict=True):
            with _started(script, checkout) as program:
                results.append(json.loads(program.communicate()[0].splitlines()[-1]))
    return [{name: min(each[name] for each in results) for name in results[0]} for results in found]


def in_turn_while_running(
    script: str, ask: Callable[[dict[str, Any], Callable[[], dict[str, float]]], float], rounds: int
) -> list[float]:
    """The least of what `ask` finds in some rounds, for each checkout, whose scripts run all the while.

    Args:
        script: prints a JSON object once it is ready, and then another one for each line that it reads.
        ask: gets the first object, and a function that returns the next ones.
        rounds: number of rounds.
    """
    with ExitStack() as stack:
        programs = [stack.enter_context(_started(script, checkout)) for checkout in checkouts()]
        ready = [json.loads(program.stdout.readline()) for program in programs]
        found = [
            [ask(said, partial(_next, program)) for said, program in zip(ready, programs, strict=True)]
            for _ in range(rounds)
        ]
    return [min(results) for results in zip(*found, strict=True)]


def _next(program: subprocess.Popen[str]) -> dict[str, float]:
    program.stdin.write("\n")
    program.stdin.flush()
    return json.loads(program.stdout.readline())


def beside(values: Sequence[float], shown: Callable[[float], str]) -> str:
    """A figure, and how it was in the other checkout."""
    own, *before = values
    return shown(own) + "".join(f"; before {shown(each)}: {own / each:.2f}" for each in before)


# --- benches -------------------------------------------------------------------------------------------


@contextmanager
def opened(scene: Any, **options: Any) -> Iterator[tuple[Any, Any]]:
    """The simulated bench of a scene, or of one by its name, and the drivers' bench on its wire."""
    from palpate.drivers.bench import Bench
    from palpate.simulators.bench import SimulatedBench
    from palpate.simulators.planning.settle import read_scene

    settled = read_scene(scene) if isinstance(scene, str) else scene
    with SimulatedBench(settled, **options) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        yield sim, bench


def pressed(bench: Any) -> None:
    """The first sample lies on the bench, which drives it at 10 Hz."""
    from palpate.instrument.sensor.sample import get_sample

    bench.operator.mount(get_sample("1"))
    bench.device("positioner").move(15e-3)
    bench.drive()
    bench.device("signal_generator").sine(10.0, 1.0)


def measured(procedure: Any, bench: Any, design: Any, folder: Path, progress: Any = None) -> Any:
    """The result of a procedure with the thesis' load cell, recorded into a folder."""
    from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
    from palpate.procedures.engine.conduct import conduct
    from palpate.procedures.lab.lab import Lab
    from palpate.procedures.records.record import Recorder

    with Recorder.create(folder, HEADER, *([progress] if progress else [])) as record:
        result = conduct(procedure, Lab(bench, design, THESIS_LOAD_CELL), record)
        record.finish("complete", {})
    return result


# --- campaigns -----------------------------------------------------------------------------------------


class Campaign:
    """What a campaign that can be ended and gone on with has found: JSON, a line each.

    It lies in `NAME-VERSION.jsonl` in `$PALPATE_CAMPAIGN` (`campaigns`). A command that is given again goes on from
    there, as long as the version is the same.
    """

    def __init__(self, name: str, version: str) -> None:
        self.file = Path(os.environ.get("PALPATE_CAMPAIGN", "campaigns")) / f"{name}-{version}.jsonl"
        self.file.parent.mkdir(parents=True, exist_ok=True)
        self.found: list[Any] = []
        for line in self.file.read_text(encoding="utf-8").splitlines() if self.file.exists() else []:
            with suppress(ValueError):  # cut off when the command was ended
                self.found.append(json.loads(line))

    def go_on(self, trials: Iterable[Any]) -> list[Any]:
        """All that was found, with what these trials find; Ctrl-C ends them."""
        with suppress(KeyboardInterrupt), self.file.open("a", encoding="utf-8") as out:
            for each in trials:
                print(json.dumps(each), file=out, flush=True)
                self.found.append(each)
        return self.found


def version_of(*patterns: str | Path) -> str:
    """A hash of all code that is tried: files, or patterns of them, from the root of the project."""
    files = [path for pattern in patterns for path in sorted(ROOT.glob(str(pattern)))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:12]
