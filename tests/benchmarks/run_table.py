"""`palpate.runs()` over a store of many runs, without an index and with the one that it left."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import palpate
from tests.benchmarks.row import Row

RUNS = 5000
SETTLED = 2.2  # s after which the index trusts the times of files
SWEEP = palpate.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.1)


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        store = Path(name)
        with palpate.open_bench(about={"batch": "B7"}) as bench:
            first = palpate.run(SWEEP, bench, out=store / "0").folder
        for number in range(1, RUNS):
            shutil.copytree(first, store / str(number))
        copied = time.monotonic()
        while time.monotonic() < copied + SETTLED:
            pass
        for how, goal in (("without index", 60.0), ("with index", 1.0)):
            start = time.perf_counter()
            count = len(palpate.runs(store, where=["batch = B7"]))
            seconds = time.perf_counter() - start
            yield Row(
                f"palpate.runs() over {count:,} runs, {how}", f"{seconds:.2f} s", f"<= {goal:g} s", seconds <= goal
            )
