"""A sample that somebody exchanges ends the run, whoever wrote the procedure, and whoever the changer's driver."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.devices.sample_changer import ModbusSampleChanger
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import SampleError
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.scene import Scene
from palpate.testing import steps
from tests.examples.relaxation import Relaxation
from tests.procedures.conftest import HEADER


@pytest.fixture
def sim(nothing_left_behind: None, scene: Scene) -> Iterator[SimulatedBench]:
    with SimulatedBench(scene, samples=[SAMPLES[name] for name in "12"]) as simulated:
        yield simulated


@pytest.mark.parametrize(
    "procedure", [Relaxation(sample="2"), LoadSweep(("2",), (2.0, 3.0, 4.0), dwell=0.2)], ids=lambda each: each.name
)
def test_a_sample_that_is_exchanged_between_two_points_ends_the_run_before_the_next_is_stored(
    procedure: Relaxation | LoadSweep,
    bench: Bench,
    sim: SimulatedBench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A driver of another package need not look at the sample whenever settings are looked at, as ours does."""
    monkeypatch.setattr(ModbusSampleChanger, "differences", ModbusDevice.differences)

    def exchange(done: int, _total: int, what: str) -> None:
        if done == 1:
            sim.rig.mount(SAMPLES["1"])
            sim.rig.mount(SAMPLES["2"])  # the right one lies there again, but it was away

    lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
    recorder = Recorder.create(tmp_path / "run", HEADER, steps(exchange))
    with recorder as record, pytest.raises(SampleError, match=r"exchanged . times"):
        conduct(procedure, lab, record)
    assert len(Run.open(tmp_path / "run").points()) == 1
