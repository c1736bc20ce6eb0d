"""How long the command line and the tests keep people waiting."""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row
from tests.benchmarks.run_table import filled

HELP_GOAL, TESTS_GOAL = 0.3, 180.0
RUNS = 1000  # in a store that is listed
QUICK = {  # command: greatest processor time [s]
    "scene list": 0.12,
    "sweep loads --dry-run": 0.5,
    "scene explain thesis_single": 0.6,
    "accuracy": 2.0,
}
LIST, LIST_GOAL = "runs list --json", 0.25
ROUNDS = 7
FEWER = 3
COMMANDS = (
    "model ratio --sensed-modulus 15kPa",
    "sweep loads --help",
    "calibrate load-cell --json",
    "sweep loads --scene ideal --json",
    "sweep loads --json",
)


def measure() -> Iterator[Row]:
    palpate = str(Path(sys.executable).with_name("palpate"))
    helped = statistics.median(_seconds([palpate, "--help"]) for _ in range(ROUNDS))
    yield Row("palpate --help", f"{helped:.3f} s", f"< {HELP_GOAL} s", helped < HELP_GOAL)
    for command, goal in QUICK.items():
        least = min(_processor_seconds([palpate, *command.split()]) for _ in range(FEWER))
        yield Row(f"palpate {command}: processor time", f"{least:.2f} s", f"<= {goal} s", least <= goal)
    yield from _listed(palpate)
    for command in COMMANDS:
        least = min(_processor_seconds([palpate, *command.split()]) for _ in range(FEWER))
        yield Row(f"palpate {command}: processor time of the whole process", f"{least:.2f} s")
    start = time.perf_counter()
    done = subprocess.run([sys.executable, "-m", "pytest", "-q"], stdout=subprocess.PIPE, text=True, check=False)
    tested = time.perf_counter() - start
    verdict = done.stdout.splitlines()[-1].strip("= ")
    yield Row("pytest, all tests", f"{tested:.0f} s: {verdict}", f"< {TESTS_GOAL:.0f} s", tested < TESTS_GOAL)


def _listed(palpate: str) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        store = filled(Path(folder), RUNS)
        for how in ("read", "by the index"):
            command = [palpate, *LIST.split(), "--out", str(store)]
            least = min(_processor_seconds(command) for _ in range(1 if how == "read" else FEWER))
            goal = (f"<= {LIST_GOAL} s", least <= LIST_GOAL) if how == "by the index" else ("", None)
            yield Row(f"palpate {LIST}, {RUNS} runs, {how}: processor time", f"{least:.2f} s", *goal)


def _seconds(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    return time.perf_counter() - start


def _processor_seconds(command: list[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
