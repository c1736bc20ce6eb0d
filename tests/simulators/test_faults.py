"""Faults: what a scene may say of them, what they do on each wire, and that without them there is nothing of them."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.devices.sensor_node import Recording
from palpate.instrument.errors import BenchError, ConfigError, DeviceError, LinkError, LinkTimeout
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from palpate.simulators.faults import FAULTS, fault_class, inject
from palpate.simulators.faults.fault import Fault, Trigger, parse_faults, places
from palpate.simulators.faults.fault import struck as struck_places
from palpate.simulators.planning.settle import read_scene, with_faults
from palpate.simulators.scenes.scene import Scene
from tests.benchmarks.faults import operations, without_code_of_faults

HEAD = 'name = "x"\npurpose = "y"\ndesign = "single"\n'
FIRST = 'kind = "no_reply"\non = "signal_generator"\n'


def read(folder: Path, *tables: str) -> tuple[Fault, ...]:
    path = folder / "scene.toml"
    path.write_text(HEAD + "".join(f"[[fault]]\n{table}\n" for table in tables))
    return read_scene(str(path)).faults


def test_every_fault_has_a_place_where_it_strikes_and_says_what_it_is() -> None:
    for kind in FAULTS:
        found = fault_class(kind)
        table = {"kind": kind, "on": next(iter(struck_places(found.targets, places(1)))), "transaction": 1}
        if kind == "front_panel":
            table |= {"setting": "amplitude", "value": 1.0}
        (fault,) = parse_faults([table], places(1), "here")
        assert type(fault) is found


def test_a_scene_keeps_its_faults_when_it_is_written_and_read_again(tmp_path: Path) -> None:
    faults = read(tmp_path, FIRST + "transaction = 5", 'kind = "bit_error"\non = "line"\nat = "2 s"\nlasts = "500 ms"')
    assert [(f.kind, f.on, f.at, f.transaction, f.lasts) for f in faults] == [
        ("no_reply", "signal_generator", None, 5, 0.0),
        ("bit_error", "line", 2.0, None, 0.5),
    ]
    again = tmp_path / "again.toml"
    again.write_text(read_scene(str(tmp_path / "scene.toml")).to_toml())
    assert read_scene(str(again)).faults == faults


MAKERS = places(1, read_scene("real_bench").devices)


@pytest.mark.parametrize("kind", ["bridge_open", "overload", "not_a_number", "zero_drift"])
def test_a_makers_load_indicator_has_the_faults_that_its_map_tells(kind: str) -> None:
    (fault,) = parse_faults([{"kind": kind, "on": "load_cell", "at": "1 s"}], MAKERS, "here")
    assert fault.on == "load_cell"


def test_an_indicator_that_reads_integers_never_reads_that_it_is_no_number() -> None:
    table = {"load_cell": {"kind": "laumas-tlb4", "role": "load_indicator", "span": 10.306}}
    standing = places(1, read_scene("ideal").with_devices(table).devices)
    with pytest.raises(ConfigError, match="unknown place of a not_a_number 'load_cell'"):
        parse_faults([{"kind": "not_a_number", "on": "load_cell", "at": "1 s"}], standing, "here")
    assert parse_faults([{"kind": "overload", "on": "load_cell", "at": "1 s"}], standing, "here")


@pytest.mark.parametrize(
    ("kind", "channel", "message"),
    [
        ("saturated_film", 5, "channel: 5 is too large; films has 4"),
        ("counter_skips", None, "unknown place of a counter_skips 'films'"),  # its frames hold no number
    ],
)
def test_a_makers_node_is_refused_what_it_does_not_have(kind: str, channel: int | None, message: str) -> None:
    table = {"kind": kind, "on": "films", "at": "1 s", **({} if channel is None else {"channel": channel})}
    with pytest.raises(ConfigError, match=message):
        parse_faults([table], MAKERS, "here")


WRONG = {
    "no kind": ('on = "line"\nat = "1 s"', ["fault 1: kind", "missing"]),
    "an unknown kind": ('kind = "no_replay"\non = "line"\nat = "1 s"', ["unknown fault 'no_replay'", "'no_reply'?"]),
    "an unknown place": (
        'kind = "no_reply"\non = "signal_genrator"\nat = "1 s"',
        ["place of a no_reply 'signal_genrator' (did you mean 'signal_generator'?)"],
    ),
    "a place that cannot have it": ('kind = "no_reply"\non = "line"\nat = "1 s"', ["unknown place", "'line'"]),
    "a node that is not there": (
        'kind = "node_reboot"\non = "sensor_node_2"\nat = "1 s"',
        ["'sensor_node_2'", "valid: sensor_node_1"],
    ),
    "an unknown key": (FIRST + 'when = "1 s"', ["when", "unknown key", "transaction"]),
    "no time": (FIRST, ["none given of at, transaction, probability"]),
    "two times": (FIRST + 'at = "1 s"\ntransaction = 3', ["at and transaction given of"]),
    "a time without unit": (FIRST + "at = 3", ["at", "needs a unit"]),
    "a negative time": (FIRST + 'at = "-1 s"', ["at", "at least 0"]),
    "transaction nought": (FIRST + "transaction = 0", ["transaction", "at least 1"]),
    "a probability above one": (FIRST + "probability = 1.5", ["probability", "at most 1"]),
    "an unknown setting": (
        'kind = "front_panel"\non = "shaker_amplifier"\nat = "1 s"\nsetting = "gian"\nvalue = 1',
        ["setting of the shaker amplifier 'gian' (did you mean 'gain'?)"],
    ),
    "a setting that the device would refuse": (
        'kind = "front_panel"\non = "shaker_amplifier"\nat = "1 s"\nsetting = "gain"\nvalue = 21',
        ["value: 21 is not allowed", "0 to 20"],
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_fault_is_refused_with_file_number_and_key(wrong: str, tmp_path: Path) -> None:
    text, parts = WRONG[wrong]
    with pytest.raises(ConfigError) as raised:
        read(tmp_path, text)
    message = str(raised.value)
    assert message.startswith(f"{tmp_path / 'scene.toml'}: fault 1: ")
    for part in parts:
        assert part in message


def test_more_faults_than_a_hundred_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="101 faults are more than 100"):
        read(tmp_path, *[FIRST + "transaction = 1"] * 101)


# --- when ----------------------------------------------------------------------------------------------


def struck(fault: dict[str, object], times_ns: list[int], seed: int = 1) -> list[int]:
    (parsed,) = parse_faults([{"kind": "no_reply", "on": "signal_generator", **fault}], places(1), "here")
    trigger = Trigger(parsed, 0, seed)
    return [number for number, now in enumerate(times_ns, 1) if trigger.strikes(now)]


def test_a_fault_strikes_the_nth_transaction_and_goes_on_while_it_lasts() -> None:
    steady = [k * 10**9 for k in range(10)]
    assert struck({"transaction": 4}, steady) == [4]
    assert struck({"transaction": 4, "lasts": "2.5 s"}, steady) == [4, 5, 6]


def test_a_fault_strikes_the_first_transaction_after_its_time_once() -> None:
    steady = [k * 10**9 for k in range(10)]
    assert struck({"at": "3.5 s"}, steady) == [5]
    assert struck({"at": "0 s", "lasts": "2 s"}, steady) == [1, 2]


def test_a_fault_of_a_probability_strikes_by_seed_and_number_alone() -> None:
    first = struck({"probability": 0.2}, [0] * 1000)
    assert first == struck({"probability": 0.2}, list(range(1000)))
    assert first != struck({"probability": 0.2}, [0] * 1000, seed=2)
    assert 160 < len(first) < 240
    assert struck({"probability": 1.0}, [0] * 5) == [1, 2, 3, 4, 5]


FAR = {"on": "signal_generator", "kind": "no_reply", "transaction": 1_000_000}


def test_a_scene_without_faults_does_the_same_operations_where_there_is_no_code_for_any() -> None:
    scene = read_scene("thesis_single")
    operations(scene)  # fills what is kept between benches
    with_code = operations(scene)
    faulty = with_faults(scene, [FAR])
    assert operations(faulty) != with_code
    with without_code_of_faults():
        assert operations(scene) == with_code
        with pytest.raises(ImportError):
            operations(faulty)


# --- what strikes on the wire ------------------------------------------------------------------------


@contextmanager
def faulty(scene: Scene, *tables: dict[str, Any]) -> Iterator[tuple[SimulatedBench, Bench]]:
    with (
        SimulatedBench(replace(scene, faults=parse_faults(tables, places(scene.nodes), "here"))) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        yield sim, bench


@pytest.fixture(autouse=True)
def _ends(nothing_left_behind: None) -> None:
    pass


# What a read that is struck gives: None is the right value.
TCP: dict[str, type[BenchError] | None] = {
    "no_reply": LinkTimeout, "late_reply": LinkTimeout, "split_reply": None, "merged_replies": None,
    "truncated_reply": LinkTimeout, "wrong_transaction": LinkTimeout, "wrong_unit": LinkTimeout,
    "wrong_function": DeviceError, "wrong_count": DeviceError, "device_busy": None,
    "device_failure": DeviceError, "illegal_value": None, "connection_reset": LinkError,
    "connection_refused": LinkError,
}  # fmt: skip
RTU: dict[str, type[BenchError] | None] = {
    "bit_error": LinkTimeout, "lost_bytes": LinkTimeout, "leading_glitch": None, "late_answer": LinkTimeout,
    "two_replies": None, "silence": LinkTimeout,
}  # fmt: skip


def test_every_fault_of_a_modbus_wire_is_met_here() -> None:
    wire = [kind for kind, where in FAULTS.items() if where.split(":")[0].endswith(".modbus")]
    assert sorted(wire) == sorted(TCP | RTU)


@pytest.mark.parametrize("kind", TCP | RTU)
def test_a_fault_of_a_wire_is_an_error_or_does_no_harm_and_the_next_read_is_right(scene: Scene, kind: str) -> None:
    on, next_read, right = ("signal_generator", "frequency", 7.0) if kind in TCP else ("positioner", "command", 0.0)

    def ask() -> object:
        device = bench.device(on)
        return device.read() if kind in TCP else device.get("speed")

    with faulty(scene, {"kind": kind, "on": on, "at": "1 s"}) as (sim, bench):
        bench.device("signal_generator").sine(7.0, 0.25)
        sim.clock.wait(1.0)
        bench.device("strain_indicator").read()  # of another unit on the line: not struck
        whole = (7.0, 0.25, 0.0) if kind in TCP else 1e-3
        if expected := (TCP | RTU)[kind]:
            with pytest.raises(expected):
                ask()
        else:
            assert ask() == whole
        sim.clock.wait(0.1)  # a connection is refused until time goes on
        assert bench.device(on).get(next_read) == right  # on the line, of as many registers as a late reply
        assert ask() == whole


def two_free_ports(host: str) -> int:
    """The first of them, below those that the system gives."""
    for port in range(20_000 + 2 * os.getpid() % 10_000, 32_000, 2):
        with suppress(OSError), socket.create_server((host, port)), socket.create_server((host, port + 1)):
            return port
    raise AssertionError("no two ports are free")


def test_faults_of_a_connection_withstand_what_any_client_sends(scene: Scene, caplog: pytest.LogCaptureFixture) -> None:
    # bytes that begin no request, a write of zero to a single register, a request that is cut off
    requests = b"\0\1\7\7\0\6\1\3\0\0\0\1", b"\0\2\0\0\0\6\1\6\0\x17\0\0", b"\0\3\0\0\0\2\1\x2b"
    for kind in TCP:
        faults = parse_faults([{"kind": kind, "on": "signal_generator", "probability": 1.0}], places(1), "here")
        with SimulatedBench(replace(scene, faults=faults)) as sim, ExitStack() as stack:
            generator = sim.description.links["signal_generator"]
            assert generator is not None
            address = generator.host, generator.port
            clients = [stack.enter_context(socket.create_connection(address, 5.0)) for _ in requests]
            sim.servers.catch_up()
            for client, request in zip(clients, requests, strict=True):
                client.sendall(request)
                sim.servers.catch_up()
    assert [record.getMessage() for record in caplog.records if record.name == "asyncio"] == []


def test_devices_with_faults_are_served_at_the_address_that_is_asked_for(scene: Scene) -> None:
    tables = [
        {"kind": "connection_refused", "on": "signal_generator", "at": "1 s"},
        {"kind": "connection_refused", "on": "shaker_amplifier", "at": "1 h"},
    ]
    port = two_free_ports("127.0.0.2")
    struck = replace(scene, faults=parse_faults(tables, places(scene.nodes), "here"))
    with (
        SimulatedBench(struck, BenchAddresses("127.0.0.2", port)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
    ):
        links = (sim.description.links["signal_generator"], sim.description.links["shaker_amplifier"])
        assert [(link.host, link.port) for link in links] == [("127.0.0.2", port), ("127.0.0.2", port + 1)]
        sim.clock.wait(1.0)
        with pytest.raises(LinkError):
            bench.device("signal_generator").read()
        sim.clock.wait(0.1)
        assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)
        with pytest.raises(BenchError, match=f"cannot listen on 127.0.0.2:{port}"):
            SimulatedBench(struck, BenchAddresses("127.0.0.2", port)).__enter__()


def test_a_refused_connection_comes_back_while_another_request_waits_for_the_clock(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inject, "TIMEOUT", "10 s")  # nothing here waits in vain, unless the machine is busy
    with faulty(scene, {"kind": "connection_refused", "on": "signal_generator", "at": "1 s"}) as (sim, bench):
        sim.clock.wait(1.0)
        with pytest.raises(LinkError):
            bench.device("signal_generator").read()
        amplifier = sim.description.links["shaker_amplifier"]
        with socket.create_connection((amplifier.host, amplifier.port)) as client:
            with sim.clock.lock:
                client.sendall(bytes.fromhex("0001 0000 0006 01 03 0000 0001"))
                threading.Event().wait(0.05)  # until the servers' thread has it, and waits for the lock
                sim.clock.wait(0.1)
            assert client.recv(5) == bytes.fromhex("0001 0000 00")
        assert bench.device("signal_generator").read() == (10.0, 0.0, 0.0)


def recorded(scene: Scene, kind: str, on: str = "sensor_node_1", **more: Any) -> tuple[Recording, SimulatedBench]:
    with faulty(scene, {"kind": kind, "on": on, "at": "1 s", **more}) as (sim, bench):
        sim.clock.wait(1.0)
        bench.device("sensor_node_1").set_sample_rate(250.0)
        return bench.device("sensor_node_1").acquire(0.2), sim


LOST = ("lost_frame", "duplicated_frame", "delayed_frame", "reordered_frames", "counter_repeats", "counter_skips")


@pytest.mark.parametrize("kind", [*LOST, "babbling_node", "bus_overload"])
def test_samples_that_are_lost_doubled_or_out_of_order_are_refused(scene: Scene, kind: str) -> None:
    on = "can" if kind == "bus_overload" else "sensor_node_1"
    # the 30th frame of those that it strikes: in the middle of the recording
    with pytest.raises(LinkError, match=r"samples are missing|no valid answer"):
        recorded(scene, kind, on, at=None, transaction=30, lasts="2 ms")


@pytest.mark.parametrize("kind", ["error_frame", "no_heartbeat", "emergency"])
def test_what_the_bus_repairs_and_what_a_node_only_tells_leaves_the_samples_right(scene: Scene, kind: str) -> None:
    on = "can" if kind == "error_frame" else "sensor_node_1"
    plain, _ = recorded(scene, "no_heartbeat", at="1000 s")
    found, _ = recorded(scene, kind, on, lasts="1 s")
    assert np.array_equal(found.voltage, plain.voltage)


def test_a_node_off_the_bus_does_not_answer_until_it_recovers(scene: Scene) -> None:
    with faulty(scene, {"kind": "bus_off", "on": "can", "at": "1 s", "lasts": "2 s"}) as (sim, bench):
        sim.clock.wait(1.5)
        with pytest.raises(LinkTimeout):
            bench.device("sensor_node_1").get("serial")
        sim.clock.wait(2.0)
        assert bench.device("sensor_node_1").get("serial") == float(int(bench.device("sensor_node_1").serial, 16))


def test_a_node_that_reboots_in_a_recording_is_told_from_one_that_goes_on(scene: Scene) -> None:
    with pytest.raises(BenchError, match=r"were not taken|samples are missing"):
        recorded(scene, "node_reboot", at="1.1 s")


def test_a_saturated_film_is_flagged_and_a_drifting_one_is_off_by_its_drift(scene: Scene) -> None:
    assert recorded(scene, "saturated_film")[0].saturated[0].all()
    plain, _ = recorded(scene, "saturated_film", at="1000 s")
    found, _ = recorded(scene, "film_drift", rate=0.5)
    assert found.voltage[0] - plain.voltage[0] == pytest.approx(0.5 * plain.time, abs=2e-4)
    assert np.array_equal(found.voltage[1], plain.voltage[1])


# --- devices -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("on", ["signal_generator", "shaker_amplifier", "strain_indicator", "positioner"])
def test_a_power_cycle_loses_the_settings_and_switches_off(scene: Scene, on: str) -> None:
    with faulty(scene, {"kind": "power_cycle", "on": on, "at": "1 s"}) as (sim, bench):
        bench.drive()
        bench.device("signal_generator").sine(20.0, 0.1)
        bench.device("strain_indicator").peak_to_peak(0.7)
        bench.device("positioner").set_limits(0.0, 0.01)
        sim.clock.wait(1.5)
        assert (sim.generator.settings["output"], sim.generator.settings["frequency"]) == (
            (0.0, 10.0) if on == "signal_generator" else (1.0, 20.0)
        )
        assert (sim.amplifier.settings["enable"], sim.amplifier.settings["watchdog"]) == (
            (0.0, 0.0) if on == "shaker_amplifier" else (1.0, 2.0)
        )
        assert sim.indicator.settings["filter"] == (0.1 if on == "strain_indicator" else 0.7)
        assert sim.positioner.settings["limit_high"] == (0.025 if on == "positioner" else 0.01)


@pytest.mark.parametrize("kind", ["over_current", "over_temperature", "latched_fault"])
def test_a_trip_latches_and_switches_off(scene: Scene, kind: str) -> None:
    with faulty(scene, {"kind": kind, "on": "shaker_amplifier", "at": "1 s"}) as (sim, bench):
        bench.drive()
        bench.clock.watching = False
        sim.clock.wait(1.0)
        state = bench.device("shaker_amplifier").read()
        assert state.faults_latched == {"supply" if kind == "latched_fault" else kind}
        assert not state.enabled


def test_a_front_panel_changes_one_setting(scene: Scene) -> None:
    table = {"kind": "front_panel", "on": "shaker_amplifier", "at": "1 s", "setting": "gain", "value": 5.0}
    with faulty(scene, table) as (sim, _bench):
        before = dict(sim.amplifier.settings)
        sim.clock.wait(1.0)
        assert sim.amplifier.settings == before | {"gain": 5.0}


def test_an_open_bridge_an_overload_and_no_number_are_seen_and_are_over_when_they_are(scene: Scene) -> None:
    for kind in ("bridge_open", "overload", "not_a_number"):
        with faulty(scene, {"kind": kind, "on": "strain_indicator", "at": "1 s", "lasts": "1 s"}) as (sim, bench):
            sim.clock.wait(1.5)
            if kind == "not_a_number":
                with pytest.raises(DeviceError, match="nan mV as a float"):
                    bench.device("strain_indicator").read()
            else:
                assert not bench.device("strain_indicator").read().valid
            sim.clock.wait(1.0)
            assert bench.device("strain_indicator").read().valid


def test_a_stuck_reading_stays_and_a_drifting_zero_runs_away(scene: Scene) -> None:
    readings = {}
    for kind in ("stuck_reading", "zero_drift"):
        with faulty(scene, {"kind": kind, "on": "strain_indicator", "at": "1 s"}) as (sim, bench):
            bench.operator.place_weight(0.1)
            sim.clock.wait(20.0)
            readings[kind] = bench.device("strain_indicator").read().reading_mV
    assert abs(readings["stuck_reading"] - 1.81) < 1.5  # as before the weight
    # 12 mV of weight and zero, and 0.5 mV/s over 29 s
    assert readings["zero_drift"] == pytest.approx(12 + 14.5, abs=2)


# --- replay --------------------------------------------------------------------------------------------
