"""The default sweep as a user runs it, all bytes on real sockets and buses."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.row import Row

GOAL = 100


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        done = subprocess.run(
            [str(Path(sys.executable).with_name("palpate")), "sweep", "loads", "--json"],
            cwd=folder, stdout=subprocess.PIPE, check=True,
        )  # fmt: skip
        process = time.perf_counter() - start
    result = json.loads(done.stdout)
    speed = result["bench_seconds"] / result["wall_seconds"]
    yield Row(
        f"default sweep, {len(result['points'])} points: bench time / wall time",
        f"{result['bench_seconds']:.0f} / {result['wall_seconds']:.1f} s = {speed:.0f}",
        f">= {GOAL}",
        speed >= GOAL,
    )
    yield Row("the same, whole process with imports and plot", f"{process:.1f} s")
