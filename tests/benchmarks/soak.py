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
from contextlib import contextmanager
from pathlib import Path

from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.loads import LoadSweep, SweepResult
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.checks import preload_for
from palpate.procedures.steps.films import Films
from palpate.procedures.steps.probe import press
from palpate.procedures.steps.servo import LoadServo
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.records import HEADER
from tests.benchmarks.row import Row

DAYS, HOUR = 30, 3600.0
SWEEPS = DAYS * 24
SWEEP = LoadSweep(("1",), (2.0, 3.0), 0.2, 10.0)
WATCHDOG = 60.0  # s: the longest, so that a month has not too many requests
PART = SWEEPS // 10  # that are compared
SLOWER = 0.1


def measure() -> Iterator[Row]:
    with _opened() as (bench, design), tempfile.TemporaryDirectory() as store:
        yield from _sweeps(bench, design, Path(store))
        yield from _drive(bench, design)


@contextmanager
def _opened() -> Iterator[tuple[Bench, Design]]:
    with SimulatedBench(read_scene("thesis_single")) as sim:
        description = sim.description.model_copy(update={"watchdog": WATCHDOG})
        with Bench(description, sim.clock, sim.operator) as bench:
            yield bench, sim.scene.design


def _sweeps(bench: Bench, design: Design, store: Path) -> Iterator[Row]:
    seconds, memory, handles, ratios = [], [], [], []
    for number in range(SWEEPS):
        bench.clock.wait(max(0.0, number * HOUR - 1e-9 * bench.clock.now_ns()))
        taken, result = _swept(bench, design, store / str(number))
        seconds.append(taken)
        ratios.append(result.points[0].force_ratio)
        memory.append(_memory())
        handles.append(float(sum(1 for _ in Path("/proc/self/fd").iterdir())))
    yield Row("sweeps, bench days", f"{SWEEPS}, {1e-9 * bench.clock.now_ns() / 86_400:.1f}", f"{DAYS} days")
    for what, values, unit, allowed in (
        ("processor time a point", [1e3 * s for s in seconds], "ms", None),
        ("memory", memory, "MiB", 1.02),
        ("file handles", handles, "", 1.0),
        ("force ratio", ratios, "", None),
    ):
        first, last = statistics.median(values[PART : 2 * PART]), statistics.median(values[-PART:])
        grown = None if allowed is None else last <= allowed * first
        goal = "" if allowed is None else f"<= {100 * (allowed - 1):.0f} % more"
        yield Row(f"  {what}: second and last tenth", f"{first:.4g}, {last:.4g} {unit}", goal, grown)
    yield Row("  largest memory ever", f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")
    yield from _beside_a_new_one(bench, design, store)


def _beside_a_new_one(bench: Bench, design: Design, store: Path) -> Iterator[Row]:
    """The old bench and one just opened, in turn: a machine is faster in one minute than in another."""
    longer = []
    with _opened() as (new, _):
        for number in range(PART):
            seconds = []
            for which in (bench, new):
                which.clock.wait(HOUR)
                seconds.append(_swept(which, design, store / str(number))[0])
            longer.append(math.log(seconds[0] / seconds[1]))
    mean, u = statistics.mean(longer), statistics.stdev(longer) / math.sqrt(PART)
    yield Row(
        f"  processor time a point then, against a new bench: {PART} pairs in turn",
        f"{100 * math.expm1(mean):+.1f} %, u {100 * u:.1f} %",
        f"<= {100 * SLOWER:.0f} % more",
        math.expm1(mean) <= SLOWER,
    )


def _swept(bench: Bench, design: Design, folder: Path) -> tuple[float, SweepResult]:
    """A small sweep, and the processor's seconds a point."""
    start = time.process_time()
    with Recorder.create(folder, HEADER) as record:
        result = conduct(SWEEP, Lab(bench, design, THESIS_LOAD_CELL), record)
        record.finish("complete", result.summary())
    taken = time.process_time() - start
    shutil.rmtree(folder)
    return taken / len(result.points), result


def _drive(bench: Bench, design: Design) -> Iterator[Row]:
    """The phase of the first film against the bench's clock, at the start and after a month of driving."""
    static = preload_for(SWEEP.loads)
    films = Films(bench, design, SWEEP.frequency, static + max(SWEEP.loads) / 2)
    preloaded = press(bench, THESIS_LOAD_CELL, get_sample("1"), static)
    LoadServo(bench, THESIS_LOAD_CELL, SWEEP.frequency, preloaded).set(2.0)
    films.settle(lambda: None)
    phases, us = [], []
    for wait in (0.0, DAYS * 86_400.0):
        bench.clock.wait(wait)
        cycles = bench.clock.now_ns() * round(SWEEP.frequency) % 1_000_000_000 / 1e9
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
    bench.device("positioner").home()


def _memory() -> float:
    """Resident, MiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 2**20
