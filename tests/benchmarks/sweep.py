"""Sweeps as a user runs them, all bytes on real sockets and buses: the default one, the three arrangements."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.benchmarks.row import Row

GOAL = 100
ARRANGEMENTS = {
    "thesis_single": "1.5 N:4 N:0.5 N",  # A2.9 to A2.14
    "thesis_common_base": "1.5 N:4.5 N:0.5 N",  # A2.15 to A2.20
    "thesis_different_base": "1.5 N:4.5 N:0.5 N",
}


def measure() -> Iterator[Row]:
    start = time.perf_counter()
    default = _swept("sweep", "loads")
    process = time.perf_counter() - start
    yield _speed(f"default sweep, {len(default['points'])} points", [default])
    yield Row("the same, whole process with imports and plot", f"{process:.1f} s")
    three = [_swept("sweep", "loads", "--scene", scene, "--loads", loads) for scene, loads in ARRANGEMENTS.items()]
    yield _speed(f"three arrangements, {sum(len(result['points']) for result in three)} points", three)
    rejected = sum(point["attempts"] - 1 for result in three for point in result["points"])
    settling = [point["settling_s"] for result in three for point in result["points"]]
    yield Row(
        "settling found at a point, mean and most; repeated",
        f"{_mean(settling):.1f}, {max(settling):.1f} s; {rejected}",
    )


def _swept(*arguments: str) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [str(Path(sys.executable).with_name("palpate")), *arguments, "--json"],
            cwd=folder, stdout=subprocess.PIPE, check=True,
        )  # fmt: skip
    result: dict[str, Any] = json.loads(done.stdout)
    return result


def _speed(figure: str, results: list[dict[str, Any]]) -> Row:
    bench, wall = (sum(result[name] for result in results) for name in ("bench_seconds", "wall_seconds"))
    return Row(
        f"{figure}: bench time / wall time",
        f"{bench:.0f} / {wall:.1f} s = {bench / wall:.0f}",
        f">= {GOAL}",
        bench / wall >= GOAL,
    )


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)
