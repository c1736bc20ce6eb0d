"""The bench of twins of devices that can be bought: what it measures beside ours, and how soon a map is in use."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from palpate.drivers.bench import Bench
from palpate.instrument.bench.kinds import kind_of
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.loads import LoadPoint, LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.benchmarks.row import Row

GOAL = 5.0  # s
SAMPLES, LOADS, DWELL, FREQUENCY = ("1", "2", "3", "4", "5", "6"), (2.0, 3.0), 1.0, 10.0
COUNT = 0.5 / 32768  # V, of either node
QUIET = ("charge_amplifier", "adc")  # effects of the thesis' scene that neither scatter nor are noise
COVERAGE = 2.0
SETTINGS = {  # of the kinds that have them
    "full_scale": 0.5, "metres_per_step": 1e-6, "span": 10.306, "travel": "25 mm", "volts_per_unit": COUNT,
}  # fmt: skip


def measure() -> Iterator[Row]:
    """Rows about ratios without noise and with noise, and about the maps."""
    usual, devices = read_scene("thesis_single"), read_scene("real_bench").devices
    quiet = replace(usual, effects={name: usual.effects[name] for name in QUIET})
    pairs = list(zip(swept(quiet), swept(replace(quiet, devices=devices)), strict=True))
    apart = max(abs(a.force_ratio / b.force_ratio - 1) * a.voltage_rigid_V / COUNT for a, b in pairs)
    yield Row(
        f"real_bench: {len(pairs)} force ratios without scatter and noise, apart from ours at most, counts of a node",
        f"{apart:.2f}",
        "<= 1",
        apart <= 1,
    )
    pairs = list(zip(swept(usual), swept(replace(usual, devices=devices)), strict=True))
    within = sum(
        abs(a.force_ratio - b.force_ratio) <= COVERAGE * math.hypot(a.force_ratio_u, b.force_ratio_u) for a, b in pairs
    )
    yield Row(
        f"real_bench: force ratios with noise, within {COVERAGE:g} uncertainties of ours",
        f"{within} of {len(pairs)}",
        "all",
        within == len(pairs),
    )
    taken = {file.stem: used(file) for file in sorted(SHIPPED.glob("*.toml"))}
    slowest = max(taken, key=lambda name: taken[name])
    yield Row(
        f"{len(taken)} shipped maps: read, proved and a twin of it made, slowest ({slowest}), processor time",
        f"{taken[slowest]:.2f} s",
        f"< {GOAL:g} s",
        taken[slowest] < GOAL,
    )


def swept(scene: Scene) -> list[LoadPoint]:
    """The points of a sweep."""
    header = {"procedure": "sweep loads", "simulated": True, "started": "2025-03-14T15:09:26Z"}
    with (
        tempfile.TemporaryDirectory() as folder,
        SimulatedBench(scene) as sim,
        Recorder.create(Path(folder) / "run", header) as record,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
        return list(conduct(LoadSweep(SAMPLES, LOADS, DWELL, FREQUENCY), lab, record).points)


def used(file: Path) -> float:
    """Processor time until a map is read and proved, and a bench on which its twin stands is served and closed [s]."""
    start = time.process_time()
    found = read_map(file)
    assert not prove(found.contract, found.frames).problems
    kind = kind_of(found)
    settings = {key: value for key, value in SETTINGS.items() if key in kind.settings.model_fields}
    section = {"kind": kind.name, "role": kind.roles[0], **settings}
    with SimulatedBench(read_scene("ideal").with_devices({"twin": section})):
        return time.process_time() - start
