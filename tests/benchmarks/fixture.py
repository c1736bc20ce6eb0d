"""What a bench of its own costs a test: the plugin's, as the fixture `bench` opens and closes it."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

from palpate.procedures.testing.benches import simulated_bench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.row import Row
from tests.conftest import open_ends

GOAL = 0.05  # s
ROUNDS = 25
SCENES = ("thesis_single", "noisy_lab")


def measure() -> Iterator[Row]:
    for name in SCENES:
        scene = read_scene(name)
        before = open_ends()
        up, down = [], []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            with simulated_bench(scene) as watch, watch.bench:
                up.append(time.perf_counter() - start)
                start = time.perf_counter()
            down.append(time.perf_counter() - start)
        for what, times in (("set up", up), ("torn down", down)):
            median = statistics.median(times)
            measured = f"{1e3 * median:.0f} ms, slowest {1e3 * max(times):.0f} ms"
            yield Row(f"bench fixture, {name}: {what}", measured, f"< {1e3 * GOAL:.0f} ms", median < GOAL)
        left = len(open_ends() - before)
        yield Row(f"bench fixture, {name}: threads, sockets, ptys left", f"{left}", "0", left == 0)
