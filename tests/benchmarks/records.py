"""What a durable record costs beside the disk's own fsync and write, in turn on the same disk."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from palpate.procedures.records.record import Recorder
from palpate.procedures.records.record_file import as_json
from tests.benchmarks.row import Row

HEADER = {"procedure": "records", "simulated": True, "started": "2026-01-02T03:04:05Z"}
POINTS, LONG_POINTS = 400, 12
SAMPLES, LONG_SAMPLES = 250, 2_000_000  # of each of two films
ABOVE_FSYNC = 250e-6  # s
RATE = 100e6  # bytes a second
Times = tuple[list[float], list[float]]


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as store, (Path(store) / "raw").open("ab", buffering=0) as raw:
        yield from _points(Path(store) / "short", raw.fileno())
        yield from _waveforms(Path(store) / "long", raw.fileno())


def _points(folder: Path, raw: int) -> Iterator[Row]:
    data = {f"value_{number}": 0.1 * number for number in range(20)}
    films = _films(SAMPLES)
    content = as_json(data).encode() + _bytes(films)
    with Recorder.create(folder, HEADER) as record:
        wall, processor = _in_turn(lambda: record.point(data, films, 0), lambda: _write(raw, content), POINTS)
    point, fsync = map(statistics.median, wall)
    yield Row(
        f"durable point, 20 values and 2 x {SAMPLES} samples: median; the disk's own write and fsync of its bytes",
        f"{1e6 * point:.0f}; {1e6 * fsync:.0f} µs",
    )
    above = point - fsync
    yield Row("  above that: median", f"{1e6 * above:.0f} µs", f"<= {1e6 * ABOVE_FSYNC:.0f} µs", above <= ABOVE_FSYNC)
    yield Row("  above that: the quickest of each", f"{1e6 * (min(wall[0]) - min(wall[1])):.0f} µs")
    above = statistics.median(processor[0]) - statistics.median(processor[1])
    yield Row("  above that: processor time, median", f"{1e6 * above:.0f} µs")


def _waveforms(folder: Path, raw: int) -> Iterator[Row]:
    films = _films(LONG_SAMPLES)
    content = _bytes(films)
    with Recorder.create(folder, HEADER) as record:
        wall, processor = _in_turn(lambda: record.point({}, films, 0), lambda: _write(raw, content), LONG_POINTS)
        start = time.perf_counter()
        record.finish("complete", {})
        merged = sum(wall[0]) + time.perf_counter() - start
    size = LONG_POINTS * len(content)
    rate, disk = (size / sum(times) for times in wall)
    yield Row(
        "waveforms, durable; the disk's own write and fsync; ratio",
        f"{rate / 1e6:.0f}; {disk / 1e6:.0f} MB/s; {rate / disk:.2f}",
        f">= {RATE / 1e6:.0f} MB/s" + ("" if disk >= RATE else ", which the disk itself does not write"),
        rate >= RATE,
    )
    yield Row("  with the merge at the end, which writes all again", f"{size / merged / 1e6:.0f} MB/s")
    yield Row("  by processor time alone", f"{size / sum(processor[0]) / 1e6:.0f} MB/s")


def _bytes(films: dict[str, tuple[float, np.ndarray]]) -> bytes:
    return b"".join(samples.tobytes() for _, samples in films.values())


def _films(samples: int) -> dict[str, tuple[float, np.ndarray]]:
    time = np.arange(samples) / 250.0
    return {name: (250.0, np.sin(20 * np.pi * time).astype(np.float32)) for name in ("rigid", "total")}


def _write(raw: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(raw, rest) :]
    os.fsync(raw)


def _in_turn(first: Callable[[], object], second: Callable[[], object], rounds: int) -> tuple[Times, Times]:
    """Seconds of each call, of the wall and of the processor, taken in turn so that both see the same disk."""
    wall: Times = ([], [])
    processor: Times = ([], [])
    for _ in range(rounds):
        for call, walls, processors in zip((first, second), wall, processor, strict=True):
            start, busy = time.perf_counter(), time.process_time()
            call()
            processors.append(time.process_time() - busy)
            walls.append(time.perf_counter() - start)
    return wall, processor
