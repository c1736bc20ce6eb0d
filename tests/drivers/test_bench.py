"""The bench opens with what the bench file says or not at all."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from pymodbus.pdu import ModbusPDU

from palpate.drivers import bench as bench_module
from palpate.drivers import bench as fitted
from palpate.drivers import ownership
from palpate.drivers.bench import Bench, Hands
from palpate.drivers.incident import Incidents
from palpate.drivers.roles import Chamber, ProbeStage, SampleChanger
from palpate.instrument.bench.kinds import KINDS
from palpate.instrument.contracts.declaration import Identity
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkError, SafetyError, SettingsLost
from palpate.instrument.sensor.sample import SAMPLES
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from tests.drivers.benches import altered, drive, driving, is_closed, open_bench

# --- opening -------------------------------------------------------------------------------------------


def test_an_opened_bench_has_its_outputs_off_and_its_watchdog_set(sim: SimulatedBench) -> None:
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    with open_bench(sim):
        assert not driving(sim)
        assert sim.amplifier.settings["watchdog"] == sim.description.watchdog == 2.0


def test_the_devices_are_those_of_the_bench_file(bench: Bench) -> None:
    assert [device.serial for device in bench.devices] == [
        "SIM-SG-0001", "SIM-PA-0001", "SIM-SI-0001", "SIM-MP-0001", "20260101",
    ]  # fmt: skip


@pytest.mark.parametrize("index", range(4))
def test_another_device_at_an_address_is_refused_and_the_rest_closed_again(
    index: int, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = [sim.generator, sim.amplifier, sim.indicator, sim.positioner][index]
    stranger = replace(simulated.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(simulated, "contract", stranger)
    bench = open_bench(sim)
    with pytest.raises(IdentityError, match=f"{stranger.title} at .*Acme XY-9 1.0"):
        bench.__enter__()
    assert is_closed(bench)
    monkeypatch.undo()
    with bench:
        assert bench.simulated


def test_a_port_that_nobody_listens_on_is_named_and_the_rest_closed_again(
    sim: SimulatedBench, closed_port: int
) -> None:
    description = sim.description
    elsewhere = altered(description, link={"shaker_amplifier": {"port": closed_port}})
    bench = open_bench(sim, elsewhere)
    with pytest.raises(
        LinkError,
        match=rf"nothing answers at 127.0.0.1:{closed_port}: .*refuses .*correct port in \[link.shaker_amplifier\]",
    ):
        bench.__enter__()
    assert is_closed(bench)


def test_a_bench_whose_opening_fails_leaves_the_outputs_off(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bench that was left driving must not go on because one device of it cannot be opened."""
    sim.generator.settings.update(amplitude=3.0, output=1.0)
    sim.amplifier.settings.update(enable=1.0)
    sim.nodes[0].settings["product"] = 7.0
    with pytest.raises(IdentityError):
        open_bench(sim).__enter__()
    assert not driving(sim)


def test_a_stranger_is_not_written_to(sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch) -> None:
    stranger = replace(sim.amplifier.contract, identity=Identity("Acme", "XY-9", "1.0"))
    monkeypatch.setattr(sim.amplifier, "contract", stranger)
    written: list[Any] = []
    monkeypatch.setattr(sim.amplifier, "write", written.append)
    with pytest.raises(IdentityError):
        open_bench(sim).__enter__()
    assert written == []


def test_an_amplifier_that_tripped_is_refused_with_its_fault(sim: SimulatedBench) -> None:
    sim.amplifier.trip("over_current")
    with pytest.raises(SafetyError, match=r"shaker amplifier .* tripped on over_current"):
        open_bench(sim).__enter__()


# --- simulated or not ----------------------------------------------------------------------------------


def test_a_simulated_bench_says_so_over_the_wire(bench: Bench) -> None:
    assert bench.simulated
    assert all(device.simulated for device in bench.devices)


def test_devices_that_do_not_call_themselves_simulated_are_taken_for_real(
    bench: Bench, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def real(sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending and hasattr(pdu, "information"):
            del pdu.information[6]
        return pdu

    for device in (
        bench.device("signal_generator"),
        bench.device("shaker_amplifier"),
        bench.device("strain_indicator"),
        bench.device("positioner"),
    ):
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


def test_the_bench_names_no_device() -> None:
    """It is made of what its file lists: no kind, and no module of a kind, stands in its source."""
    for module in (bench_module, fitted, ownership):
        source = inspect.getsource(module)
        assert [name for name in KINDS if name in source] == []
        assert set(re.findall(r"devices\.(\w+) import", source)) <= {"device", "exciter", "exciter_kinds"}


# --- a bench ---------------------------------------------------------------------------------------------


def test_a_bench_whose_devices_have_served_others_opens_without_a_difference(sim: SimulatedBench) -> None:
    """The generator counts its writes for ever: those from before do not count."""
    for _ in range(2):
        with open_bench(sim) as bench:
            bench.check_settings()


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


def test_a_bench_that_cannot_be_opened_gives_its_amplifier_up(
    sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the next program would have to wait for the watchdog."""
    bench = open_bench(sim)
    monkeypatch.setattr(bench.device("positioner"), "connect", _fails)
    with pytest.raises(DeviceError, match="it is stuck"):
        bench.__enter__()
    assert sim.amplifier.read("token") == 0
    assert not bench.is_open


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


def test_what_comes_while_the_record_is_closed_waits_for_the_next() -> None:
    incidents = Incidents(VirtualClock())
    first, second = list[str](), list[str]()
    incidents.tell(lambda _kind, what, _ns: first.append(what))
    incidents.hold()
    incidents.note("late")
    assert first == []
    incidents.tell(lambda _kind, what, _ns: second.append(what))
    assert second == ["late"]
    incidents.tell(lambda _kind, what, _ns: first.append(what))
    assert first == []


# --- what a person does --------------------------------------------------------------------------------


ROLES = {SampleChanger: "changer", Chamber: "chamber", ProbeStage: "stage"}


class Recorder:
    """A device or a person; keeps what it is asked for."""

    def __init__(self, who: str, done: list[tuple[object, ...]]) -> None:
        self.who, self.done = who, done

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *given: self.done.append((self.who, name, *given))


@pytest.mark.parametrize("devices", [(), ("changer",), ("chamber",), ("stage",), ("changer", "chamber", "stage")])
def test_each_device_is_asked_for_what_it_can_do_and_the_person_for_the_rest(devices: tuple[str, ...]) -> None:
    done = list[tuple[object, ...]]()
    has = {name: Recorder(name, done) if name in devices else None for name in ROLES.values()}
    bench: Any = SimpleNamespace(maybe=lambda role: has[ROLES[role]])
    hands = Hands(Recorder("person", done), bench)
    hands.mount(SAMPLES["2"])
    hands.lay_on_support(SAMPLES["3"])
    hands.place_probe(1e-3, 2e-3)
    hands.press_tooth(1)
    hands.place_weight(0.3)
    hands.turn_load_cell(120.0)
    hands.set_temperature(295.0)
    leaves = [("changer", "leave")] if has["changer"] else []
    assert done == [
        ("changer", "mount", "2") if has["changer"] else ("person", "mount", SAMPLES["2"]),
        *leaves,
        ("person", "lay_on_support", SAMPLES["3"]),
        ("stage" if has["stage"] else "person", "place_probe", 1e-3, 2e-3),
        *leaves,
        ("person", "press_tooth", 1),
        ("person", "place_weight", 0.3),
        ("person", "turn_load_cell", 120.0),
        ("chamber", "warm", 295.0) if has["chamber"] else ("person", "set_temperature", 295.0),
    ]
