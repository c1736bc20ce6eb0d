"""What a durable record costs beside the disk's own fsync and write, in turn on the same disk."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from procedures.record import Recorder
from tests.benchmarks.row import Row

HEADER = {"procedure": "records", "simulated": True, "started": "2026-01-02T03:04:05Z"}
POINTS, LONG_POINTS = 400, 12
SAMPLES, LONG_SAMPLES = 250, 2_000_000  # of each of two films
ABOVE_FSYNC = 250e-6  # s
RATE = 100e6  # bytes a second


def measure() -> Iterator[Row]:
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as store:
        folder = Path(store)
        with (folder / "raw").open("ab", buffering=0) as raw, Recorder.create(folder / "run", HEADER) as record:
            yield from _points(record, raw.fileno())
            yield from _waveforms(record, raw.fileno())
            record.finish("complete", {})


def _points(record: Recorder, raw: int) -> Iterator[Row]:
    data = {f"value_{number}": 0.1 * number for number in range(20)}
    films = _films(SAMPLES)
    content = bytes(2 * 4 * SAMPLES)
    point, fsync = _in_turn(lambda: record.point(data, films, 0), lambda: _write(raw, content), POINTS)
    above = statistics.median(point) - statistics.median(fsync)
    quick = min(point) - min(fsync)
    yield Row(
        f"durable point, 20 values and 2 x {SAMPLES} samples: median, the disk's own write and fsync",
        f"{1e6 * statistics.median(point):.0f}, {1e6 * statistics.median(fsync):.0f} µs",
    )
    yield Row("  above that: median", f"{1e6 * above:.0f} µs", f"<= {1e6 * ABOVE_FSYNC:.0f} µs", above <= ABOVE_FSYNC)
    yield Row("  above that: the quickest of each", f"{1e6 * quick:.0f} µs")


def _waveforms(record: Recorder, raw: int) -> Iterator[Row]:
    films = _films(LONG_SAMPLES)
    content = b"".join(samples.tobytes() for _, samples in films.values())
    point, write = _in_turn(lambda: record.point({}, films, 0), lambda: _write(raw, content), LONG_POINTS)
    rate, disk = (len(content) / statistics.median(times) for times in (point, write))
    yield Row(
        "waveforms, durable; the disk's own write and fsync",
        f"{rate / 1e6:.0f}, {disk / 1e6:.0f} MB/s",
        f">= {RATE / 1e6:.0f} MB/s",
        rate >= RATE,
    )


def _films(samples: int) -> dict[str, tuple[float, np.ndarray]]:
    time = np.arange(samples) / 250.0
    return {name: (250.0, np.sin(20 * np.pi * time).astype(np.float32)) for name in ("rigid", "total")}


def _write(raw: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(raw, rest) :]
    os.fsync(raw)


def _in_turn(first: Callable[[], object], second: Callable[[], object], rounds: int) -> tuple[list[float], list[float]]:
    """Seconds of each call, taken in turn so that both see the same disk."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for call, taken in zip((first, second), times, strict=True):
            start = time.perf_counter()
            call()
            taken.append(time.perf_counter() - start)
    return times
