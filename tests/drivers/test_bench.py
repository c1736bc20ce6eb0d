"""The bench opens with what the bench file says or not at all, and notices a device that holds something else later."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest
from pymodbus.pdu import ModbusPDU

from palpate.drivers.incident import Incidents
from palpate.extend import Bench, Identity
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, SafetyError, SettingsLost
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.benches import drive, driving, is_closed, open_bench

# --- opening -------------------------------------------------------------------------------------------


def test_an_opened_bench_has_its_outputs_off_and_its_watchdog_set(sim: SimulatedBench) -> None:
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    with open_bench(sim):
        assert not driving(sim)
        assert sim.amplifier.settings["watchdog"] == sim.description.watchdog == 2.0


@pytest.mark.parametrize("name", ["shaker_amplifier", "positioner"])
def test_another_device_at_an_address_is_refused_and_not_written_to_and_the_rest_closed_again(
    name: str, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated, written = sim.devices[name], list[Any]()
    monkeypatch.setattr(simulated, "write", written.append)
    stranger = replace(simulated.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(simulated, "contract", stranger)
    bench = open_bench(sim)
    with pytest.raises(IdentityError, match=f"{stranger.title} at .*Acme XY-9 1.0"):
        bench.__enter__()
    assert is_closed(bench) and written == []
    monkeypatch.undo()
    with bench:
        assert bench.simulated


def test_a_bench_whose_opening_fails_leaves_the_outputs_off_and_gives_its_amplifier_up(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bench that was left driving must not go on because one device of it cannot be opened."""
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    sim.nodes[0].settings["product"] = 7.0
    bench = open_bench(sim)
    with pytest.raises(IdentityError):
        bench.__enter__()
    assert not driving(sim)
    assert (bench.is_open, sim.amplifier.read("token")) == (False, 0)  # so that no other program waits for the watchdog


def test_an_amplifier_that_tripped_is_refused_with_its_fault(sim: SimulatedBench) -> None:
    sim.amplifier.trip("over_current")
    with pytest.raises(SafetyError, match=r"shaker amplifier .* tripped on over_current"):
        open_bench(sim).__enter__()


# --- simulated or not ----------------------------------------------------------------------------------


def test_devices_that_do_not_call_themselves_simulated_are_taken_for_real(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def real(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and hasattr(pdu, "information"):
            del pdu.information[6]
        return pdu

    assert all(device.simulated for device in bench.devices)
    for device in bench.devices[:4]:
        monkeypatch.setattr(device.link.client.transaction, "trace_pdu", real)
        device.connect()
        assert not device.simulated
    assert bench.simulated
    read = sim.nodes[0].read
    monkeypatch.setattr(sim.nodes[0], "read", lambda f: "1.0" if f.name == "hardware_version" else read(f))
    bench.device("sensor_node_1").connect()
    assert not bench.simulated


def test_mounting_a_sample_needs_the_probe_at_home(bench: Bench) -> None:
    bench.operator.mount(SAMPLES["2"])
    bench.device("positioner").move(5e-3)
    with pytest.raises(BenchError, match="stands at 5 mm: move it home"):
        bench.operator.mount(SAMPLES["3"])


# --- a bench ---------------------------------------------------------------------------------------------


def test_an_opened_bench_holds_what_its_file_says(bench: Bench, sim: SimulatedBench) -> None:
    said = {device.name: device.settings for device in bench.description.devices}
    assert sim.amplifier.settings["gain"] == said["shaker_amplifier"].gain
    assert sim.amplifier.settings["current_limit"] == said["shaker_amplifier"].current_limit
    assert sim.indicator.settings["gage_factor"] == said["strain_indicator"].gage_factor
    assert sim.indicator.settings["full_scale"] == 1e3 * said["strain_indicator"].full_scale
    sim.amplifier.settings["enable"] = 0.0
    sim.generator.settings["amplitude"] = 3.0
    bench.drive()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)
    bench.rest()
    assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)


def test_a_bench_whose_load_cell_reads_nothing_does_not_go_on(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = {"status": 4.0, "reading_float": math.nan, "reading": 0.0}
    read = sim.indicator.read
    monkeypatch.setattr(sim.indicator, "read", lambda name: opened[name] if name in opened else read(name))
    with pytest.raises(DeviceError, match="bridge open; check the bridge and its wires") as caught:
        bench.recover()
    assert caught.value.device == bench.device("strain_indicator").name


def test_what_was_lost_and_written_again_is_told_to_the_record(bench: Bench, sim: SimulatedBench) -> None:
    told = list[str]()
    bench.attend(lambda _kind, what, _ns: told.append(what))
    sim.amplifier.settings["gain"] = 7.0
    with pytest.raises(
        SettingsLost, match=f"{re.escape(bench.device('shaker_amplifier').name)}: gain is 7, was set to .*; look at"
    ):
        bench.check_settings()
    bench.recover()
    assert [what for what in told if what.startswith(f"{bench.device('shaker_amplifier').name}: gain is 7")] != []
    assert all(what.endswith("; written again") for what in told if "was set to" in what)
    bench.check_settings()


@pytest.mark.parametrize(("errors", "told"), [(0, []), (3, ["3 error frames"])])
def test_error_frames_of_the_bus_are_told(
    errors: int, told: list[str], bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted = list[str]()
    bench.attend(lambda _kind, what, _ns: noted.append(what))
    link = bench.device("sensor_node_1").link
    monkeypatch.setattr(link, "error_frames", lambda: errors)
    bench.check_settings()
    assert noted == [f"{link.name}: {each}" for each in told]


def test_what_comes_after_a_bench_is_closed_is_not_told_to_its_record(sim: SimulatedBench) -> None:
    told = list[str]()
    with open_bench(sim) as bench:
        bench.attend(lambda _kind, what, _ns: told.append(what))
    bench.incidents.note("too late")
    assert told == []


@pytest.mark.parametrize("safe", [True, False])
def test_an_amplifier_is_given_up_only_when_all_outputs_are_off(
    safe: bool, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If an output cannot be switched off, the watchdog must do it, for which the owner must fall silent."""
    bench = open_bench(sim)
    bench.__enter__()
    drive(bench)
    released = list[bool]()
    release = bench.device("shaker_amplifier").release
    monkeypatch.setattr(bench.device("shaker_amplifier"), "release", lambda: released.append(True) or release())
    if safe:
        bench.__exit__(None, None, None)
    else:
        monkeypatch.setattr(bench.device("signal_generator"), "output", lambda _on: _fails())
        with pytest.raises(BenchError, match="could not all be switched off: it is stuck"):
            bench.__exit__(None, None, None)
    assert released == ([True] if safe else [])


def _fails() -> None:
    raise DeviceError("it is stuck")


# --- incidents -----------------------------------------------------------------------------------------


def test_incidents_are_stored_with_their_time_also_those_from_before_the_record() -> None:
    clock, stored = VirtualClock(), list[tuple[str, str, int]]()
    incidents, begun = Incidents(clock), clock.now_ns()
    incidents.note("first")
    clock.wait(1.0)
    incidents.note("second")
    incidents.tell(lambda *event: stored.append(event))
    clock.wait(1.0)
    incidents.note("third")
    assert stored == [
        ("incident", "first", begun),
        ("incident", "second", begun + 1_000_000_000),
        ("incident", "third", begun + 2_000_000_000),
    ]


# --- what a device gives -------------------------------------------------------------------------------


MODBUS = [
    ("strain_indicator", "mode", 9.0, r"mode = 9 is no choice; valid: track \(0\), peak_to_peak \(1\)"),
    ("strain_indicator", "decimals", 400.0, "decimals = 400 is outside 0 to 9"),
    ("strain_indicator", "command_result", 77.0, r"command_result = 77 is no choice; valid: none \(0\)"),
    ("shaker_amplifier", "temperature", 3200.0, "temperature = 3200 degC is outside -40 to 150 degC"),
    ("positioner", "limit_high", -1.0, "limit_high = -1 m is outside 0 to 0.025 m"),
    ("signal_generator", "frequency", 30_000.0, "frequency = 30000 Hz is outside 0 to 20000 Hz"),
]
CANOPEN = [
    ("range_1", 9.0, r"range_1 = 9 is no choice; valid: 5 V \(0\), 500 mV \(1\)"),
    ("heartbeat", 65.0, "heartbeat = 65 s is outside 0 to 60 s"),
    ("sync_period", 11.0, "sync_period = 11 s is outside 0.0001 to 10 s"),
    ("emergency_cob_id", 1.0, "emergency_cob_id = 2 is outside 129 to "),
]


def test_a_modbus_value_outside_its_contract_is_refused_with_device_field_value_limit_and_remedy(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for device, field, value, message in MODBUS:
        driver, simulated = bench.device(device), sim.devices[device]
        with monkeypatch.context() as patch:
            read = simulated.read
            patch.setattr(simulated, "read", lambda name, f=field, v=value, r=read: v if name == f else r(name))
            with pytest.raises(
                DeviceError, match=f"^{driver.name}: reads {message}.*; not used. Set it within"
            ) as seen:
                driver.get(field)
        assert seen.value.device == driver.name


def test_an_object_outside_its_contract_is_refused_where_the_node_is_opened(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    for field, value, message in CANOPEN:
        with monkeypatch.context() as patch:
            patch.setitem(sim.can.nodes[0].settings, field, value)
            with pytest.raises(DeviceError, match=f"^sensor node 1 at .*: reads {message}"):
                bench.device("sensor_node_1").connect()


def test_a_fault_bit_that_the_contract_does_not_name_is_a_fault(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    amplifier: Any = sim.amplifier
    read = amplifier.read
    monkeypatch.setattr(amplifier, "read", lambda name: 512.0 if name == "faults_latched" else read(name))
    assert bench.device("shaker_amplifier").read().faults_latched == {"bit 9"}
