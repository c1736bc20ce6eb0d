"""The shaker amplifier drops its output on too much current, too much heat and too long a silence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.errors import DeviceError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.wire.device import SimulatedDevice
from palpate.testing import ModbusConformance
from tests.conftest import latched

COIL = 3.5  # ohm


class TestShakerAmplifier(ModbusConformance):
    @staticmethod
    def ends(bench: Bench, sim: SimulatedBench) -> tuple[ModbusDevice, SimulatedDevice]:
        return bench.device("shaker_amplifier"), sim.amplifier


def drive(bench: Bench, amplitude: float) -> None:
    bench.drive()
    bench.device("signal_generator").sine(10.0, amplitude)


def test_the_amplifier_measures_what_it_gives(bench: Bench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0)
    drive(bench, 3.0)
    state = bench.device("shaker_amplifier").read()
    assert state.voltage == pytest.approx(6 / math.sqrt(2), abs=0.005)
    assert state.current == pytest.approx(6 / math.sqrt(2) / COIL, abs=0.0005)
    assert (state.enabled, state.faults, state.faults_latched) == (True, frozenset(), frozenset())
    bench.device("shaker_amplifier").disable()
    state = bench.device("shaker_amplifier").read()
    assert (state.enabled, state.voltage, state.current) == (False, 0.0, 0.0)


def test_the_watchdog_drops_the_output_at_its_time_out_and_latches(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=5.0, watchdog=0.5)
    drive(bench, 1.0)
    bench.device("shaker_amplifier").feed()
    sim.clock.wait(0.499_999_999)
    assert latched(sim) == set()
    assert sim.amplifier.settings["enable"] == 1
    sim.clock.wait(0.000_000_001)
    assert latched(sim) == {"watchdog"}
    assert sim.amplifier.settings["enable"] == 0
    assert sim.rig.coil_voltage().at(np.array([sim.clock.now_ns() + 25_000_000])).tolist() == [0.0]
    assert bench.device("shaker_amplifier").read().faults_latched == {"watchdog"}
    with pytest.raises(DeviceError, match="answered exception 4, device failure, to enable = on"):
        bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").clear_faults()
    bench.device("shaker_amplifier").enable()
    assert bench.device("shaker_amplifier").read().enabled


@pytest.mark.parametrize(("amplitude", "trips"), [(1.7499, False), (1.7501, True)])
def test_over_current_trips_at_the_peak(amplitude: float, trips: bool, bench: Bench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=1.0, watchdog=0)
    drive(bench, amplitude)
    state = bench.device("shaker_amplifier").read()
    assert state.enabled is not trips
    assert state.faults_latched == ({"over_current"} if trips else set())


def test_every_way_to_too_much_current_trips(bench: Bench) -> None:
    def over_current() -> bool:
        tripped = bench.device("shaker_amplifier").read().faults_latched == {"over_current"}
        bench.device("shaker_amplifier").clear_faults()
        return tripped

    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=1.0, watchdog=0)
    drive(bench, 1.0)
    bench.device("signal_generator").set(offset=-1.0)
    assert over_current()
    bench.device("signal_generator").set(offset=0.0)
    bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").set(gain=4.0)
    assert over_current()
    bench.device("shaker_amplifier").set(gain=2.0)
    bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").set(current_limit=0.5)
    assert over_current()
    bench.device("shaker_amplifier").enable()
    assert over_current()
    bench.device("shaker_amplifier").set(current_limit=1.0)
    bench.device("shaker_amplifier").enable()
    assert bench.device("shaker_amplifier").read().enabled


def test_over_temperature_trips_and_cannot_be_cleared_while_hot(bench: Bench, sim: SimulatedBench) -> None:
    bench.device("shaker_amplifier").configure(gain=2.0, current_limit=6.0, watchdog=0)
    drive(bench, 8.0)
    rise = COIL * 2.0 * (16 / math.sqrt(2) / COIL) ** 2
    trip = 300.0 * math.log(rise / (rise - 65.0))
    sim.clock.wait(trip - 1e-3)
    assert latched(sim) == set()
    sim.clock.wait(2e-3)
    assert latched(sim) == {"over_temperature"}
    bench.device("shaker_amplifier").clear_faults()
    state = bench.device("shaker_amplifier").read()
    assert not state.enabled
    assert state.faults == state.faults_latched == {"over_temperature"}
    assert state.temperature == pytest.approx(90.0, abs=0.05)
    sim.clock.wait(300.0 * math.log(65 / 55) + 1.0)  # cooled to 80 degrees
    assert bench.device("shaker_amplifier").read().faults == set()
    with pytest.raises(DeviceError):
        bench.device("shaker_amplifier").enable()
    bench.device("shaker_amplifier").clear_faults()
    bench.device("shaker_amplifier").enable()
