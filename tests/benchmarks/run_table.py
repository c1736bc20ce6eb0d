"""`palpate.runs()` over a store of many runs, without an index and with the one that it left."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import palpate
from tests.benchmarks.row import Row

RUNS = 5000
SWEEP = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.1)


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        store = filled(Path(name), RUNS)
        for how, goal in (("without index", 60.0), ("with index", 1.0)):
            start = time.perf_counter()
            count = len(palpate.runs(store, where=["batch = B7"]))
            seconds = time.perf_counter() - start
            yield Row(
                f"palpate.runs() over {count:,} runs, {how}", f"{seconds:.2f} s", f"<= {goal:g} s", seconds <= goal
            )


def filled(store: Path, runs: int) -> Path:
    """A store with copies of one short run, which it takes for settled: a run written a moment ago is read again."""
    with palpate.open_bench(about={"batch": "B7"}) as bench:
        first = palpate.run(SWEEP, bench, out=store / "0").folder
    for number in range(1, runs):
        shutil.copytree(first, store / str(number))
    for path in store.glob("*/run.*"):
        os.utime(path, (time.time() - 3600,) * 2)
    return store
