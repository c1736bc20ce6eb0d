"""`palpate runs report` as a command: of the default sweep of 36 points, and of 100,000 points like these."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import palpate
from tests.benchmarks.row import Row
from tests.runs import made

COMMAND = (str(Path(sys.executable).with_name("palpate")),)
SECONDS, BYTES, ROUNDS = 2.0, 2_000_000, 3
MANY, MANY_SECONDS = 100_000, 30.0


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        store = Path(name)
        subprocess.run([*COMMAND, "sweep", "loads", "--quiet", "--out", "run"], cwd=store, check=True)
        yield from _reported(store, "run", ROUNDS, "report of 36 points", SECONDS)
        run = palpate.read(store / "run")
        points = [{key: value for key, value in each.items() if key not in ("id", "bench_ns")} for each in run.points()]
        made(store / "many", run.header, ((points[number % len(points)], {}) for number in range(MANY)), run.summary)
        yield from _reported(store, "many", 1, f"report of {MANY:,} points", MANY_SECONDS)


def _reported(store: Path, run: str, rounds: int, what: str, goal: float) -> Iterator[Row]:
    times = []
    for number in range(rounds):
        page = store / f"{run}-{number}.html"
        start = time.perf_counter()
        subprocess.run([*COMMAND, "runs", "report", run, "--out", page, "--quiet"], cwd=store, check=True)
        times.append(time.perf_counter() - start)
    seconds, size = statistics.median(times), page.stat().st_size
    yield Row(what, f"{seconds:.2f} s", f"<= {goal:g} s", seconds <= goal)
    yield Row("its size", f"{size / 1e6:.2f} MB", f"<= {BYTES / 1e6:g} MB", size <= BYTES)
