"""The shaker amplifier drops its output on too much current, too much heat and too long a silence."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.exciter import ShakerAmplifier
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import AmplifierSettings
from palpate.instrument.contracts.own import SHAKER_AMPLIFIER
from palpate.instrument.errors import DeviceError, SafetyError
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.device import SimulatedDevice
from palpate.testing import ModbusConformance
from tests.conftest import latched
from tests.drivers.registers import Registers

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


# --- the driver by itself ------------------------------------------------------------------------------


def alone(**held: Any) -> tuple[ShakerAmplifier, Any]:
    """A driver that owns an amplifier without a wire, whose registers hold these values."""
    link: Any = Registers(SHAKER_AMPLIFIER, ticket=0x0007_0001, **held)
    driver = ShakerAmplifier(link, 1, VirtualClock())
    assert driver.claim()
    link.asked.clear()
    return driver, link


def orders(link: Any) -> list[dict[str, int]]:
    """What was written behind token and counter, and the counter, in order."""
    return [
        {"counter": registers[3], **({"order": registers[4], "value": registers[5]} if registers[4:] else {})}
        for start, registers in link.writes()
        if start == SHAKER_AMPLIFIER["token"].address
    ]


@pytest.mark.parametrize(
    ("held", "limit", "safe"),
    [
        ({"temperature": 85.0}, 5.0, True),
        ({"temperature": 85.1}, 5.0, False),
        ({"output_current": 0.707}, 1.0, True),  # 0.99985 A peak
        ({"output_current": 0.708}, 1.0, False),
        ({"output_current": 1.414}, 2.0, True),
        ({"output_current": 60.0}, None, True),  # nobody has said what it may give
    ],
)
def test_outputs_go_off_before_the_amplifier_trips_on_heat_or_on_its_peak_current(
    held: dict[str, float], limit: float | None, safe: bool
) -> None:
    driver, _ = alone(**held)
    if limit:
        driver.set(current_limit=limit)
    if safe:
        assert driver.check() == driver.read()
        return
    with pytest.raises(
        SafetyError, match=rf"heat sink at .* degC, .* A peak; limits are 85 degC and {limit:g} A\. Out"
    ):
        driver.check()


def test_who_owns_it_already_feeds_it_by_a_claim_and_takes_a_new_ticket_when_he_is_forgotten() -> None:
    driver, link = alone()
    assert driver.claim()
    assert [asked[0] for asked in link.asked] == ["write_registers"]
    link.asked.clear()
    for code in (3, 6):  # it was switched off, or somebody else has claimed it
        link.failures = [refused(code)]
        link.put(ticket=0x0009_0000 + code)
        assert driver.claim()
        assert link.held("token") == 0x0009_0000 + code
    link.failures = [refused(6), None, refused(6)]
    assert not driver.claim()
    link.asked.clear()
    driver.feed()
    assert [asked[0] for asked in link.asked] == ["read_registers"]  # as nobody's


def refused(code: int) -> DeviceError:
    return DeviceError(f"answered exception {code}", code=code)


def test_only_an_amplifier_without_the_register_of_the_owner_counts_as_one_without_owners() -> None:
    link: Any = Registers(SHAKER_AMPLIFIER)
    link.failures = [refused(4)]
    with pytest.raises(DeviceError, match="answered exception 4, to a read of ticket"):
        ShakerAmplifier(link, 1, VirtualClock()).claim()


@pytest.mark.parametrize(
    ("latched", "cleared", "trips"), [(0, False, False), (0b10000, True, False), (0b10001, False, True)]
)
def test_the_trip_that_every_killed_run_leaves_is_cleared_and_no_other(
    latched: int, cleared: bool, trips: bool
) -> None:
    driver, link = alone(faults_latched=latched)

    def clear() -> None:
        if link.words.get(SHAKER_AMPLIFIER["order"].address) == 0x13:
            link.put(faults_latched=0)

    link.written = clear
    settings = AmplifierSettings.model_validate({"gain": 4.0, "current_limit": "3 A"})
    if trips:
        with pytest.raises(SafetyError, match="tripped on over_current, watchdog"):
            driver.set_up(settings, 2.0)
    else:
        driver.set_up(settings, 2.0)
        values = [order["value"] for order in orders(link)]
        assert values == ([1] if cleared else []) + [400, 3000, 2000]
