"""How long commands keep people waiting: from a fresh clone on, alone, over large stores, and as their work grows."""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import palpate
from palpate.instrument.arithmetic import KERNELS
from palpate.instrument.config import parse
from palpate.procedures.records.run import Run
from palpate.procedures.study.description import StudyFile, study_of
from palpate.procedures.study.results import read_results
from palpate.procedures.study.run import Store, run
from palpate.procedures.virtual.study_cell import StudyComputation, executor_of
from tests.benchmarks import common, sweep, wire
from tests.benchmarks.common import ROOT, Row, at_least, at_most, in_turn_while_running, least, spent
from tests.runs import made

# --- start-up ------------------------------------------------------------------------------------------

QUICK = {"scene list": 0.12, "sweep loads --dry-run": 0.5, "scene explain thesis_single": 0.6, "accuracy": 2.0}  # s


def start_up(runs: int = 1000, rounds: int = 3) -> Iterator[Row]:
    """How long the command line and the tests keep people waiting."""
    helped = statistics.median(spent(lambda: common.palpate("--help")).wall for _ in range(rounds))
    yield at_most("palpate --help", helped, 0.3, "{:.3f} s")
    for command, goal in QUICK.items():
        seconds = least(partial(common.palpate, *command.split()), rounds)
        yield at_most(f"palpate {command}: processor time", seconds, goal, "{:.2f} s")
    with TemporaryDirectory() as folder:
        store = filled(Path(folder), runs)
        listed = ("runs", "list", "--json", "--out", store)
        common.palpate(*listed)
        seconds = least(lambda: common.palpate(*listed), rounds)
        yield at_most(f"palpate runs list, {runs} runs, by the index: processor time", seconds, 0.25, "{:.2f} s")
    said: list[str] = []
    tests = [sys.executable, "-m", "pytest", "-q"]
    tested = spent(
        lambda: said.append(subprocess.run(tests, stdout=subprocess.PIPE, text=True, check=False).stdout)
    ).wall
    yield at_most("pytest", tested, 180, "{:.0f} s", f"{tested:.0f} s: {said[0].splitlines()[-1].strip('= ')}")


def first_result(rounds: int = 3) -> Iterator[Row]:
    """How long a fresh machine takes from the clone to the first result by the README's commands; what is installed.

    `$PALPATE_BEFORE` names another commit, whose README is tried in turn with this one's. pip and uv find what they
    have downloaded before; only the plain form is paired.
    """
    ways = {"HEAD, pip": ("HEAD", "python3"), "HEAD, uv": ("HEAD", "uv")}
    if before := os.environ.get("PALPATE_BEFORE"):
        ways[before] = before, "python3"
    tried = [{name: _cloned(*way) for name, way in ways.items()} for _ in range(rounds)]
    best = {name: min(each[name] for each in tried) for name in ways}
    for name, (seconds, processor, size) in best.items():
        yield Row(f"{name}: clone to first result", f"{seconds:.1f} s, {processor:.1f} s of processor, {size:.0f} MB")
    if before:
        yield at_most(f"  of the time of {before}", best["HEAD, pip"][0] / best[before][0], 0.5, "{:.2f}")


def _cloned(commit: str, tool: str) -> tuple[float, float, float]:
    """Seconds on the clock and of the processor, and what lies in .venv [MB] afterwards."""
    with TemporaryDirectory() as folder:
        files = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
        subprocess.run(["tar", "-xf", "-"], cwd=folder, input=files, check=True)
        lines = iter((Path(folder) / "README.md").read_text(encoding="utf-8").splitlines())
        commands = [next(line for line in lines if line.startswith(f"{tool} "))]
        while "palpate sweep loads" not in commands[-1]:
            commands.append(next(lines))
        took = _shell(" && ".join(line.partition("#")[0].strip() for line in commands), folder)
        installed = sum(path.lstat().st_size for path in (Path(folder) / ".venv").rglob("*"))
        return took.wall, took.cpu, installed / 1e6


def _shell(command: str, folder: str, **more: str) -> common.Spent:
    """What a command line takes in a folder, outside of any environment for Python."""
    own = {name: value for name, value in os.environ.items() if name not in ("VIRTUAL_ENV", "UV_COMPILE_BYTECODE")}
    how = {"shell": True, "cwd": folder, "check": True, "capture_output": True, "env": own | more}
    return spent(lambda: subprocess.run(command, **how))


BEGUN = {
    "a sensor on Modbus TCP": "device own_gauge --kind sensor",
    "a CANopen actuator": "device own_valve --bus canopen",
    "an effect": "effect own_sag",
    "a procedure": "procedure own_scatter",
    "a bench with both devices": "bench own_corner --device own-gauge --device own-valve",
}


def walk_through() -> Iterator[Row]:
    """How long it takes from `palpate new …` to the tests of one's own package passing, beside an installed palpate.

    Each package is written, installed by `pip install -e` and tested, one after the other, as the guides say.
    """
    with TemporaryDirectory() as folder:
        path = {"PATH": f"{folder}/.venv/bin:{os.environ['PATH']}"}
        _shell(f"python3 -m venv .venv && pip install -q -e {ROOT} pytest-timeout hatchling editables", folder, **path)
        for what, words in BEGUN.items():
            kind, name, *_ = words.split()
            steps = [
                f"palpate new {words}",
                f"pip install -q --no-build-isolation -e {name}",
                f"cd {name} && pytest -q",
            ]
            done = [_shell(step, folder, **path).wall for step in steps if kind != "bench" or "pip" not in step]
            yield Row(
                f"palpate new {kind} to tests passed: {what}",
                f"{sum(done):.0f} s (written, installed and tested in {', '.join(f'{each:.1f}' for each in done)} s)",
            )


# --- whole commands ------------------------------------------------------------------------------------


def reproduce() -> Iterator[Row]:
    """`palpate reproduce` as a user runs it: how long it takes, and how much of the thesis it meets."""
    said: list[str] = []
    took = spent(lambda: said.append(common.palpate("reproduce", "--json", check=False))).wall  # 1: rows outside
    yield at_most("reproduce: whole process", took, 60, "{:.1f} s")
    found = json.loads(said[0])
    for name, one in found["evidence"].items():
        share = "" if one["share"] is None else f" = {one['share']:.1%}"
        yield Row(
            f"reproduce, {name}: rows within their stated scatter",
            f"{one['within']} of {one['judged']}{share}",
            one["required"],
            one["met"],
        )
    for design, right in found["softness_order_right"].items():
        yield Row(f"reproduce: softness order, {design}", "right" if right else "wrong", "right", right)


def report(many: int = 100_000, rounds: int = 3) -> Iterator[Row]:
    """`palpate runs report` as a command: of the default sweep of 36 points, and of 100,000 points like these."""
    with TemporaryDirectory() as name:
        store = Path(name)
        common.palpate("sweep", "loads", "--quiet", "--out", "36", folder=store)
        whole = palpate.read(store / "36")
        points = [{key: value for key, value in p.items() if key not in ("id", "bench_ns")} for p in whole.points()]
        made(store / str(many), whole.header, ((points[n % len(points)], {}) for n in range(many)), whole.summary)
        for count, goal, times in (("36", 2.0, rounds), (str(many), 30.0, 1)):
            page = store / f"{count}.html"
            words = ("runs", "report", count, "--out", page, "--quiet")
            took = [spent(lambda words=words: common.palpate(*words, folder=store)).wall for _ in range(times)]
            yield at_most(f"report of {count} points", statistics.median(took), goal, "{:.2f} s")
            yield at_most("its size", page.stat().st_size / 1e6, 2, "{:.2f} MB")


def run_table(runs: int = 5000) -> Iterator[Row]:
    """`palpate.runs()` over a store of many runs, without an index and with the one that it left."""
    with TemporaryDirectory() as name:
        store = filled(Path(name), runs)
        for how, goal in (("without index", 60.0), ("with index", 1.0)):
            seconds = spent(lambda: palpate.runs(store, where=["batch = B7"])).wall
            yield at_most(f"palpate.runs() over {runs:,} runs, {how}", seconds, goal, "{:.2f} s")


def filled(store: Path, runs: int) -> Path:
    """A store with copies of one short run, which it takes for settled: a run written a moment ago is read again."""
    with palpate.open_bench(about={"batch": "B7"}) as bench:
        short = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.1)
        first = palpate.run(short, bench, out=store / "0").folder
    for number in range(1, runs):
        shutil.copytree(first, store / str(number))
    for path in store.glob("*/run.*"):
        os.utime(path, (time.time() - 3600,) * 2)
    return store


# --- studies -------------------------------------------------------------------------------------------

STUDY = 'name = "benchmark"\n[axes]\nseed = "1-{last}"\n'


def study(thousand: int = 1000) -> Iterator[Row]:
    """Studies in closed form: `palpate study` as a user runs it, cells alone, and what a second worker brings."""
    few, many = 5 * thousand, 20 * thousand
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "study.toml").write_text(STUDY.format(last=thousand), encoding="utf-8")
        words = ("study", "study.toml", "--workers", "2", "--quiet")
        seconds = spent(lambda: common.palpate(*words, folder=folder)).wall
        yield at_most(f"study, {thousand} scenes of six load sets in closed form: the command", seconds, 60, "{:.1f} s")
        found = {}
        for workers, sizes in ((1, (few,)), (2, (thousand, few, many))):
            with executor_of(workers, None) as (executor, _):
                for cells in sizes:
                    found[workers, cells] = computed(folder / f"{workers} {cells}", executor, workers, cells)
        yield at_most(f"study, {thousand} cells, after start", found[2, thousand][0], 0.6, "{:.2f} s")
        one, two = found[1, few][0], found[2, few][0]
        yield at_least(
            f"study, {few} cells: one worker / two",
            one / two,
            1.8,
            "{:.1f}",
            f"{one:.1f} / {two:.1f} s = {one / two:.2f}",
        )
        yield at_most(f"study, 1,000,000 cells, from {many}", found[2, many][0] * 1e6 / many, 360, "{:.0f} s")
        used = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        yield at_most(f"study, {many} cells: largest process", used / 1e3, 1000, "{:.0f} MB")
        digests = {"both": found[2, few][1]}
        if importlib.util.find_spec("distributed"):
            from distributed import LocalCluster

            with (
                LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
                executor_of(None, cluster.scheduler_address) as (executor, workers),
            ):
                digests["dask"] = computed(folder / "dask", executor, workers, few)[1]
        for what, digest in digests.items():
            same = digest == found[1, few][1]
            yield Row(f"study: results of one and of {what}", "the same" if same else "differ", "the same", same)


def computed(folder: Path, executor: Executor, workers: int, cells: int) -> tuple[float, str]:
    """Seconds for so many cells alone, by workers that are there already, and the digest of the results."""
    for name, last in (("warm", 4 * workers), ("timed", cells)):
        file = parse(STUDY.format(last=last).encode(), StudyFile, name)
        whole = study_of(file, name)
        with Store(folder / name, {"study": file.model_dump(mode="json")}) as store:
            block = StudyComputation.of(whole, name).block
            took = spent(lambda: run(whole, block, executor, store, lambda *_: None, 4 * workers))  # noqa: B023
    return took.wall, read_results(folder / "timed").digest()


# --- the same bytes ------------------------------------------------------------------------------------

MEASURE = """
import palpate
def test_it():
    for seed in range(1, {seeds} + 1):
        with palpate.open_bench(scene="{scene}", seed=seed) as bench:
            sweep = palpate.LoadSweep(samples=("1", "4"), loads=(2.0, 3.0), dwell=0.2)
            palpate.run(sweep, bench, out="run-" + str(seed))
"""
SWEEP = ("sweep", "loads", "--samples", "1,4", "--loads", "2 N, 3 N", "--dwell", "0.2 s", "--quiet")


def entries(seeds: int = 20) -> Iterator[Row]:
    """The same bytes however a simulated bench is entered: by the command, by pytest, by a script; with numpy first.

    Each entry is a process of its own that inherits no kernels, twice with another store. A script and a test take all
    seeds of a scene.
    """
    for scene in ("thesis_single", "thesis_different_base", "everything", "noisy_lab"):
        digests, signals = ([set[str]() for _ in range(seeds)] for _ in range(2))
        for entry in 2 * ("command", "pytest", "script", "numpy"):
            with TemporaryDirectory() as folder:
                _enter(Path(folder), entry, scene, seeds)
                for seed in range(seeds):
                    found = Run.open(Path(folder) / f"run-{seed + 1}")
                    signals[seed].add(found.signal_digest())
                    digests[seed] |= {found.digest()} if entry != "numpy" else set()
        for what, each in (("command, pytest and script", digests), ("these and numpy first, of signals", signals)):
            most, all_ = max(map(len, each)), len(set().union(*each))
            yield Row(
                f"{scene}: digests a seed by {what}, 2 stores, {seeds} seeds",
                f"{most} at most, {all_} in all",
                f"1, {seeds}",
                most == 1 and all_ == seeds,
            )


def _enter(place: Path, entry: str, scene: str, seeds: int) -> None:
    script = MEASURE.format(seeds=seeds, scene=scene)
    own = {name: value for name, value in os.environ.items() if name not in KERNELS} | {"PALPATE_STORE": str(place)}
    if entry == "command":
        of = [("--scene", scene, "--seed", str(seed), "--out", f"run-{seed}") for seed in range(1, seeds + 1)]
        commands = [[*common.PALPATE, *SWEEP, *each] for each in of]
    elif entry == "pytest":
        (place / "test_it.py").write_text(script, encoding="utf-8")
        commands = [[sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"]]
    else:
        commands = [[sys.executable, "-c", ("import numpy\n" if entry == "numpy" else "") + script + "test_it()"]]
    for command in commands:
        subprocess.run(command, env=own, check=True, cwd=place, stdout=subprocess.DEVNULL)


# --- growth --------------------------------------------------------------------------------------------


def growth(rounds: int = 3) -> Iterator[Row]:
    """How cost grows with the amount of work: the exponent of the power of it that is fitted through some sizes.

    What is paid once makes an exponent smaller than that of the work itself, so the last step alone stands beside it.
    """
    costs: Mapping[str, tuple[Callable[[int], float], tuple[int, ...]]] = {
        "s of dwell of one node": (lambda seconds: sweep.dwelt(1, seconds)[0], (450, 900, 1800, 3600)),
        "nodes that dwell for 120 s": (lambda nodes: sweep.dwelt(nodes, 120.0)[0], (4, 8, 16, 32)),
        "loads of a sweep": (lambda loads: _swept("1", np.linspace(1.5, 4.0, loads)), (12, 24, 48, 96)),
        "samples of a sweep": (lambda count: _swept("123456"[:count], np.linspace(1.5, 4.0, 6)), (1, 2, 3, 6)),
        "cells of a study": (_cells, (1000, 2000, 4000, 8000)),
        "runs that palpate.runs() reads": (partial(_listed, earlier=0), (250, 500, 1000, 2000)),
        "runs that palpate.runs() knows by its index": (partial(_listed, earlier=1), (250, 500, 1000, 2000)),
        "clients with as many requests each": (_of_clients, wire.CLIENTS),
    }
    for what, (cost, sizes) in costs.items():
        cost(sizes[0])  # what is done once in a process
        found = [min(cost(size) for _ in range(rounds)) for size in sizes]
        x, y = np.log(sizes), np.log(found)
        fitted, last = np.polyfit(x, y, 1)[0], (y[-1] - y[-2]) / (x[-1] - x[-2])
        yield at_most(
            f"processor time against {sizes[0]} to {sizes[-1]} {what}: exponent",
            fitted,
            1.05,
            "{:.2f}",
            f"{fitted:.2f}, of the last step {last:.2f} ({found[0]:.2g} to {found[-1]:.2g} s)",
        )


def _swept(samples: str, loads: np.ndarray) -> float:
    with TemporaryDirectory() as folder, palpate.open_bench() as bench:
        asked_for = palpate.LoadSweep(tuple(samples), tuple(loads), dwell=0.5)
        return spent(lambda: palpate.run(asked_for, bench, out=Path(folder) / "run")).cpu


def _cells(cells: int) -> float:
    with TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:  # one that counts here
        return spent(lambda: computed(Path(folder), executor, 1, cells)).cpu


def _listed(runs: int, earlier: int) -> float:
    """Of a list of the runs after so many earlier ones, the first of which leaves an index."""
    with TemporaryDirectory() as folder:
        store = filled(Path(folder), runs)
        for _ in range(earlier):
            palpate.runs(store)
        return spent(lambda: palpate.runs(store)).cpu


def _of_clients(clients: int) -> float:
    return clients * wire.REQUESTS * in_turn_while_running(wire.SERVED, partial(wire.cost, clients=clients), 1)[0]
