"""How cost grows with the amount of work: the exponent of the power of it that is fitted through some sizes.

What is paid once makes an exponent smaller than that of the work itself, so the last step alone stands beside it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import palpate
from tests.benchmarks import dwell, run_table, serve, study
from tests.benchmarks.in_turn import served
from tests.benchmarks.row import Row

GOAL = 1.05
ROUNDS = 3
SAMPLES = tuple("123456")
LOADS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)


def measure() -> Iterator[Row]:
    costs: Mapping[str, tuple[Callable[[int], float], tuple[int, ...]]] = {
        "s of dwell of one node": (lambda seconds: dwell.apart(1, seconds)[0], (450, 900, 1800, 3600)),
        "nodes that dwell for 120 s": (lambda nodes: dwell.apart(nodes, 120.0)[0], (4, 8, 16, 32)),
        "loads of a sweep": (lambda loads: _swept(SAMPLES[:1], tuple(np.linspace(1.5, 4.0, loads))), (12, 24, 48, 96)),
        "samples of a sweep": (lambda samples: _swept(SAMPLES[:samples], LOADS), (1, 2, 3, 6)),
        "cells of a study": (_cells, (1000, 2000, 4000, 8000)),
        "runs that palpate.runs() reads": (partial(_listed, earlier=0), (250, 500, 1000, 2000)),
        "runs that palpate.runs() knows by its index": (partial(_listed, earlier=1), (250, 500, 1000, 2000)),
        "clients with as many requests each": (_asked, serve.CLIENTS),
    }
    for what, (cost, sizes) in costs.items():
        cost(sizes[0])  # what is done once in a process
        least = [min(cost(size) for _ in range(ROUNDS)) for size in sizes]
        yield _row(what, sizes, least)


def _row(what: str, sizes: tuple[int, ...], costs: list[float]) -> Row:
    x, y = np.log(sizes), np.log(costs)
    fitted, last = np.polyfit(x, y, 1)[0], (y[-1] - y[-2]) / (x[-1] - x[-2])
    return Row(
        f"processor time against {sizes[0]} to {sizes[-1]} {what}: exponent",
        f"{fitted:.2f}, of the last step {last:.2f} ({costs[0]:.2g} to {costs[-1]:.2g} s)",
        f"<= {GOAL}",
        bool(fitted <= GOAL),
    )


def _swept(samples: tuple[str, ...], loads: tuple[float, ...]) -> float:
    with TemporaryDirectory() as folder, palpate.open_bench() as bench:
        before = time.process_time()
        palpate.run(palpate.LoadSweep(samples, loads, dwell=0.5), bench, out=Path(folder) / "run")
        return time.process_time() - before


def _cells(cells: int) -> float:
    with TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:  # one that counts here
        before = time.process_time()
        study.computed(Path(folder), executor, 1, cells)
        return time.process_time() - before


def _listed(runs: int, earlier: int) -> float:
    """Of a list of the runs after so many earlier ones, the first of which leaves an index."""
    with TemporaryDirectory() as folder:
        store = run_table.filled(Path(folder), runs)
        for _ in range(earlier):
            palpate.runs(store)
        before = time.process_time()
        assert len(palpate.runs(store)) == runs
        return time.process_time() - before


def _asked(clients: int) -> float:
    return clients * serve.REQUESTS * served(serve.SERVED, partial(serve.cost, clients=clients), 1)[0]
