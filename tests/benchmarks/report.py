"""`palpate runs report` of the default sweep of 36 points, as a command."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row

COMMAND = (str(Path(sys.executable).with_name("palpate")),)
SECONDS, BYTES, ROUNDS = 2.0, 2_000_000, 3


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        store = Path(name)
        subprocess.run([*COMMAND, "sweep", "loads", "--quiet", "--out", "run"], cwd=store, check=True)
        times = []
        for number in range(ROUNDS):
            start = time.perf_counter()
            subprocess.run(
                [*COMMAND, "runs", "report", "run", "--out", f"{number}.html", "--quiet"], cwd=store, check=True
            )
            times.append(time.perf_counter() - start)
        size = (store / "0.html").stat().st_size
    seconds = statistics.median(times)
    yield Row("report of 36 points", f"{seconds:.2f} s", f"<= {SECONDS:g} s", seconds <= SECONDS)
    yield Row("its size", f"{size / 1e6:.2f} MB", f"<= {BYTES / 1e6:g} MB", size <= BYTES)
