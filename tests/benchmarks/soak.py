"""Thirty bench days on one open bench: a small sweep every hour, then a drive that stays on for as long.

Memory, file handles and processor time a point must not grow; the phase of the films must stay where the generator's
frequency puts it.
"""

from __future__ import annotations

import math
import resource
import shutil
import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from drivers.bench import Bench
from instrument.calibration import THESIS_LOAD_CELL
from instrument.design import Design
from instrument.sample import get_sample
from procedures import load_sweep
from procedures.films import Films
from procedures.load_plan import SweepSettings, preload_for
from procedures.record import Recorder
from procedures.servo import LoadServo, press
from simulators.bench import SimulatedBench
from simulators.scene import read_scene
from tests.benchmarks.records import HEADER
from tests.benchmarks.row import Row

DAYS, HOUR = 30, 3600.0
SWEEPS = DAYS * 24
SETTINGS = SweepSettings(("1",), (2.0, 3.0), 0.2, 10.0)
WATCHDOG = 60.0  # s: the longest, so that a month has not too many requests
PART = 10  # of the sweeps that are compared, the first and the last of so many parts


def measure() -> Iterator[Row]:
    with SimulatedBench(read_scene("thesis_single")) as sim, tempfile.TemporaryDirectory() as store:
        description = sim.description.model_copy(update={"watchdog": WATCHDOG})
        with Bench(description, sim.clock, sim.operator) as bench:
            yield from _sweeps(bench, sim.scene.design, Path(store))
            yield from _drive(bench, sim.scene.design)


def _sweeps(bench: Bench, design: Design, store: Path) -> Iterator[Row]:
    seconds, memory, handles, ratios = [], [], [], []
    for number in range(SWEEPS):
        bench.clock.wait(max(0.0, number * HOUR - 1e-9 * bench.clock.now_ns()))
        start = time.process_time()
        folder = store / str(number)
        with Recorder.create(folder, HEADER) as record:
            result = load_sweep.run(bench, design, THESIS_LOAD_CELL, SETTINGS, record, lambda *_: None)
            record.finish("complete", result.summary())
        seconds.append((time.process_time() - start) / len(result.points))
        ratios.append(result.points[0].force_ratio)
        memory.append(_memory())
        handles.append(sum(1 for _ in Path("/proc/self/fd").iterdir()))
        shutil.rmtree(folder)
    part = max(1, SWEEPS // PART)
    yield Row("sweeps, bench days", f"{SWEEPS}, {1e-9 * bench.clock.now_ns() / 86_400:.1f}", f"{DAYS} days")
    for what, values, unit, allowed in (
        ("processor time a point", [1e3 * s for s in seconds], "ms", 1.1),
        ("memory", memory, "MiB", 1.02),
        ("file handles", [float(n) for n in handles], "", 1.0),
        ("force ratio", ratios, "", None),
    ):
        first, last = statistics.median(values[part : 2 * part] or values), statistics.median(values[-part:])
        grown = None if allowed is None else last <= allowed * first
        goal = "" if allowed is None else f"<= {100 * (allowed - 1):.0f} % more"
        yield Row(f"  {what}: second and last tenth", f"{first:.4g}, {last:.4g} {unit}", goal, grown)
    yield Row("  largest memory ever", f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


def _drive(bench: Bench, design: Design) -> Iterator[Row]:
    """The phase of the first film against the bench's clock, at the start and after a month of driving."""
    static = preload_for(SETTINGS.loads)
    films = Films(bench, design, SETTINGS.frequency, static + max(SETTINGS.loads) / 2)
    preloaded = press(bench, THESIS_LOAD_CELL, get_sample("1"), static)
    LoadServo(bench, THESIS_LOAD_CELL, SETTINGS.frequency, preloaded).set(2.0)
    films.settle(lambda: None)
    phases, us = [], []
    for wait in (0.0, DAYS * 86_400.0):
        bench.clock.wait(wait)
        cycles = bench.clock.now_ns() * round(SETTINGS.frequency) % 1_000_000_000 / 1e9
        fit = films.fit(films.acquire(10.0))
        phases.append(float(fit.phase[0]) - 2 * math.pi * cycles)
        us.append(float(fit.amplitude_u[0] / fit.amplitude[0]))
    drift, u = abs(math.remainder(phases[1] - phases[0], 2 * math.pi)), math.hypot(*us)
    yield Row(
        f"phase of a film after {DAYS} days of driving, against the start",
        f"{drift:.1e} rad, u {u:.1e}",
        "<= 3 u",
        drift <= 3 * u,
    )
    bench.rest()
    bench.positioner.home()


def _memory() -> float:
    """Resident, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20
