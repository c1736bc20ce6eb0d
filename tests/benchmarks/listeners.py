"""What listeners cost a run: two of three are bad, one hangs and one fails."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import palpate
from palpate.testing import InStep
from tests.benchmarks.row import Row, interleaved

SWEEP = palpate.LoadSweep(samples=("1", "2", "3"), loads=tuple(1.5 + 0.05 * n for n in range(50)), dwell=0.2)
ROUNDS = 5


def measure() -> Iterator[Row]:
    heard: list[int] = []
    never = threading.Event()

    def hanging(_event: palpate.Event) -> None:
        never.wait()

    def failing(_event: palpate.Event) -> None:
        raise RuntimeError("it fails")

    def counting(event: palpate.Event) -> None:
        if event.kind == "point":
            heard.append(event.data["id"])

    with tempfile.TemporaryDirectory() as folder:
        number, digests = 0, set()

        def swept(*listeners: Callable[[palpate.Event], None]) -> None:
            nonlocal number
            number += 1
            with palpate.open_bench() as bench:
                digests.add(palpate.run(SWEEP, bench, out=Path(folder) / str(number), listeners=listeners).run.digest())

        alone, among = interleaved(swept, lambda: swept(hanging, failing, counting), ROUNDS)
        never.set()
        points = len(SWEEP.samples) * len(SWEEP.loads)
        yield Row(
            f"a sweep of {points} points with three listeners, one hangs and one fails: slower by",
            f"{100 * (among / alone - 1):.1f} % of {alone:.2f} s", "<= 2 %", among <= 1.02 * alone,
        )  # fmt: skip
        yield Row("  different digests, with and without; points heard", f"{len(digests)}; {len(heard) // ROUNDS}", "1")

        stored: dict[int, float] = {}
        seen: dict[int, float] = {}

        def watching() -> None:
            for event in palpate.watch(Path(folder) / "watched"):
                if event.kind == "point":
                    seen[event.data["id"]] = time.monotonic()

        def stamp(event: palpate.Event) -> None:
            if event.kind == "begun":
                threads.append(threading.Thread(target=watching))
                threads[0].start()
            if event.kind == "point":
                stored[event.data["id"]] = time.monotonic()

        threads: list[threading.Thread] = []
        with palpate.open_bench() as bench:
            palpate.run(SWEEP, bench, out=Path(folder) / "watched", listeners=[InStep(stamp)])
        threads[0].join()
        late = max(seen[point] - stored[point] for point in stored)
        what = "  a point is heard of by `watch` after it is durable, at most"
        yield Row(what, f"{1e3 * late:.0f} ms", "<= 200 ms", late <= 0.2)
