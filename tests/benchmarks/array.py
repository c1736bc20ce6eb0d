"""Twenty nodes, two films each, 1 kHz, for a minute of bench time."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import CanopenSensorNode, acquire
from palpate.instrument.contracts.own import bus_load
from palpate.instrument.sensor.sample import get_sample
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from tests.benchmarks.row import Row

NODES, RATE, SECONDS = 20, 1000, 60.0


def measure() -> Iterator[Row]:
    scene = dataclasses.replace(read_scene("thesis_single"), nodes=NODES)
    with SimulatedBench(scene) as sim, Bench(sim.description, sim.clock, sim.operator) as bench:
        bench.operator.mount(get_sample("1"))
        bench.device("positioner").move(15e-3)
        bench.drive()
        bench.device("signal_generator").sine(10.0, 1.0)
        start, worked = time.perf_counter(), time.process_time()
        recordings = acquire(bench.all(CanopenSensorNode), SECONDS)  # raises where a counter is not continuous
        wall, worked = time.perf_counter() - start, time.process_time() - worked
    expected = NODES * round(RATE * SECONDS)
    got = sum(r.time.size for r in recordings)
    frames = 2 * expected + round(RATE * SECONDS)
    what = f"{NODES} nodes at {RATE} Hz for {SECONDS:.0f} s"
    yield Row(f"{what}: samples lost", f"{expected - got}", "0", got == expected)
    speed = f"{wall:.1f} s, {frames / wall:.0f} frames/s"
    yield Row(f"{what}: wall time", speed, f"< {SECONDS:.0f} s", wall < SECONDS)
    yield Row(f"{what}: processor time", f"{worked:.1f} s")
    load = 100 * bus_load(NODES, RATE, 1e6)
    yield Row(f"{what}: load of a real 1 Mbit/s bus", f"{load:.0f} % at worst: more than one bus carries")
