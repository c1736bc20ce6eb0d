"""Another client writes to a device of a bench that is measured on: no point keeps what came of it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from pymodbus.client import ModbusTcpClient

from palpate.drivers.bench import Bench
from palpate.drivers.devices.exciter import SignalGenerator
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.contracts.own import SIGNAL_GENERATOR as GENERATOR
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.procedures.steps.films import FilmRecord, Films
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, IDEAL_CALIBRATION, IDEAL_SCENE, scene_of


@pytest.mark.slow
@pytest.mark.parametrize("counted", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_a_point_that_a_second_client_spoils_and_puts_right_between_two_looks_is_taken_again(
    counted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The force is 8 % wrong, less than a flag tells, and all settings read as written: the count alone tells."""
    acquire, spoilt, dwell = Films.acquire, [False], 0.3

    with SimulatedBench(scene_of(IDEAL_SCENE, tmp_path)) as sim, ExitStack() as stack:
        address = sim.description.links["signal_generator"]
        other = ModbusTcpClient(address.host, port=address.port)
        stack.callback(other.close)
        assert other.connect()

        def write(volts: float) -> None:
            registers = divmod(round(1e6 * volts), 1 << 16)
            assert not other.write_registers(GENERATOR["amplitude"].address, list(registers), device_id=1).isError()

        def disturbed(films: Films, duration: float) -> FilmRecord:
            if duration != dwell or spoilt[0]:
                return acquire(films, duration)
            spoilt[0], set_to = True, films.bench.device("signal_generator").read()[1]
            write(1.08 * set_to)
            record = acquire(films, duration)
            write(set_to)
            return record

        monkeypatch.setattr(Films, "acquire", disturbed)
        if not counted:
            monkeypatch.setattr(SignalGenerator, "differences", ModbusDevice.differences)
        with (
            Bench(sim.description, sim.clock, sim.operator) as bench,
            Recorder.create(tmp_path / "r", HEADER) as record,
        ):
            bench.attend(record.event)
            lab = Lab(bench, get_design("single"), IDEAL_CALIBRATION)
            (point,) = conduct(LoadSweep(("1",), (2.0,), dwell), lab, record).points
            record.finish("complete", {})
    assert (point.incidents > 0) is counted
    assert (abs(point.force_total_N / point.load_measured_N - 1) < 0.02) is counted
