"""Long dwells at 1 kHz, fitted while they last: an hour of one node, an hour of twenty nodes, a day of one node.

And an hour of one node in a procedure, which stores the samples and fits them as those of any dwell.

Each is measured in a process of its own, because the greatest memory of a process never falls. What the memory grows by
is counted from a first second of the same work on.
"""

from __future__ import annotations

import dataclasses
import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import palpate
from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import CanopenSensorNode, in_pieces
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimate import Sums
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.row import Row

RATE, FREQUENCY = 1000.0, 10.0  # Hz
HOUR, DAY = 3600.0, 86_400.0  # s
MEMORY = 20.0  # MiB
IN_PROCEDURE = 0  # in the place of a number of nodes


def measure() -> Iterator[Row]:
    for nodes, seconds, what, goal in (
        (1, HOUR, "an hour of one node", 2.5),
        (20, HOUR, "an hour of 20 nodes", 30.0),
        (1, DAY, "a day of one node", 60.0),
    ):
        worked, grown = apart(nodes, seconds)
        yield Row(f"{what} at 1 kHz with fit: processor time", f"{worked:.1f} s", f"{goal:g} s", worked <= goal)
        yield Row(f"{what} at 1 kHz with fit: memory", f"+{grown:.1f} MiB", f"+{MEMORY:g} MiB", grown <= MEMORY)
    worked, grown = apart(IN_PROCEDURE, HOUR)
    what = "an hour of one node at 250 Hz in a load sweep"
    yield Row(f"{what}: processor time", f"{worked:.1f} s")
    yield Row(f"{what}: memory", f"+{grown:.1f} MiB", f"+{MEMORY:g} MiB", grown <= MEMORY)


def apart(nodes: int, seconds: float) -> tuple[float, float]:
    """Processor time [s] and growth of memory [MiB] in a process of its own."""
    command = [sys.executable, "-m", __name__, str(nodes), str(seconds)]
    worked, grown = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return worked, grown


def _here(nodes: int, seconds: float) -> tuple[float, float]:
    scene = dataclasses.replace(read_scene("thesis_single"), nodes=nodes)
    with SimulatedBench(scene, stepped=True) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(get_sample("1"))
        bench.device("positioner").move(15e-3)
        bench.drive()
        bench.device("signal_generator").sine(FREQUENCY, 1.0)
        sensors = bench.all(CanopenSensorNode)
        _amplitudes(sensors, 1.0)
        memory, worked = _memory(), time.process_time()
        found = _amplitudes(sensors, seconds)
        assert all(0.0 < each.max() < 1.0 for each in found), "the films feel nothing"
        return time.process_time() - worked, _memory() - memory


def _in_procedure(seconds: float) -> tuple[float, float]:
    with TemporaryDirectory() as store:
        _sweep(1.0, Path(store) / "short")
        memory, worked = _memory(), time.process_time()
        _sweep(seconds, Path(store) / "long")
        return time.process_time() - worked, _memory() - memory


def _sweep(dwell: float, folder: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        palpate.run(palpate.LoadSweep(("1",), (2.0,), dwell), bench, out=folder)


def _amplitudes(sensors: list[CanopenSensorNode], seconds: float) -> list[np.ndarray]:
    first, last = 1 / RATE, seconds
    sums = [Sums(FREQUENCY, (last - first) / 2) for _ in sensors]
    for recordings in in_pieces(sensors, seconds):  # raises where a counter is not continuous
        for each, recording in zip(sums, recordings, strict=True):
            each.add(recording.time - (first + last) / 2, recording.voltage)
    return [np.hypot(*(each.solve() * each.scale[:, np.newaxis])[:2]) for each in sums]


def _memory() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    nodes, seconds = int(sys.argv[1]), float(sys.argv[2])
    sys.stdout.write(json.dumps(_in_procedure(seconds) if nodes == IN_PROCEDURE else _here(nodes, seconds)))
