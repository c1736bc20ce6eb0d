"""A CANopen device of a lab's own: process data in both directions, emergencies and heartbeats, from its contract."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import can
import pytest

from palpate.extend import Bench, BenchDescription, Contract, Pdo, read_scene
from palpate.instrument.config import check
from palpate.instrument.contracts.export import node_eds, registers
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.contracts.own import SIGNAL_GENERATOR as GENERATOR
from palpate.instrument.errors import ConfigError, DeviceError, RangeError, UnknownName, UsageError
from palpate.procedures.testing.wire import frames
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import installed

EMERGENCY, COMMAND = 0x80, 0x200


@pytest.fixture(scope="module")
def sim() -> Iterator[SimulatedBench]:
    with installed("drive"):
        scene = read_scene("thesis_single").with_devices({"shaker": {"kind": "acme-drive"}})
        with SimulatedBench(scene) as simulated:
            yield simulated


@pytest.fixture(scope="module")
def bench(sim: SimulatedBench) -> Iterator[Bench]:
    with Bench(sim.description, sim.clock, sim.operator) as opened:
        yield opened


@pytest.fixture
def drive(bench: Bench) -> Iterator[Any]:
    yield bench.device("shaker")
    bench.device("shaker").rest()
    bench.device("shaker").stop()
    bench.device("shaker").restore()
    bench.check_settings()


def heard(listener: can.BusABC) -> list[tuple[int, bytes]]:
    return [(message.arbitration_id, bytes(message.data)) for message in frames(listener)]


# --- on the wire ---------------------------------------------------------------------------------------


def test_process_data_go_to_it_and_come_from_it_at_sync(drive: Any, bench: Bench, sim: SimulatedBench) -> None:
    with pytest.raises(DeviceError, match=r"torque drive 2 at .*: has sent no process data 'state' yet; start"):
        drive.received("state")
    drive.start()
    drive.send("command", controlword="on", amplitude=1.0)
    assert drive.get("amplitude") == sim.devices["shaker"].settings["amplitude"] == 1.0
    bench.device("sensor_node_1").acquire(0.01)
    torque = drive.received("state")["torque"]
    assert torque == drive.get("torque") == pytest.approx(40.0 / sim.rig.scene.rig.coil_resistance, abs=0.1)


def test_process_data_that_the_node_does_not_have_are_named(drive: Any, sim: SimulatedBench) -> None:
    sends = r"unknown PDO that the torque drive sends 'stat' \(did you mean 'state'\?\); valid: state"
    with pytest.raises(UnknownName, match=sends):
        drive.received("stat")
    with pytest.raises(UnknownName, match=sends):
        sim.devices["shaker"].transmit("stat")
    with pytest.raises(UnknownName, match=r"unknown PDO that the torque drive takes 'state'.*; valid: command"):
        drive.send("state", controlword="on", amplitude=1.0)


def test_what_is_no_device_of_the_bench_is_named(bench: Bench) -> None:
    with pytest.raises(UsageError, match=r"^'shaker' is no device of this bench; give one of its `devices`"):
        bench.named("shaker")


def test_what_was_sent_as_process_data_is_a_setting_that_must_stay(drive: Any, sim: SimulatedBench) -> None:
    drive.start()
    drive.send("command", controlword="on", amplitude=0.5)
    drive.get("probe")  # answered after the node has taken that
    sim.devices["shaker"].settings["amplitude"] = 0.75
    assert drive.differences() == [f"{drive.name}: amplitude is 0.75, was set to 0.5"]
    drive.restore()
    assert drive.differences() == []


def test_a_value_beyond_its_limits_or_a_missing_one_is_refused_before_anything_is_sent(
    drive: Any, sim: SimulatedBench
) -> None:
    with can.Bus(interface="virtual", channel=sim.channel) as listener:
        with pytest.raises(RangeError, match="torque drive: amplitude = 11 V is outside 0 to 10 V"):
            drive.send("command", controlword="on", amplitude=11.0)
        with pytest.raises(RangeError, match="PDO command holds controlword, amplitude, not amplitude; give all"):
            drive.send("command", amplitude=1.0)
        assert heard(listener) == []


def test_the_node_takes_no_process_data_that_is_short_or_not_allowed_and_none_before_it_is_started(
    drive: Any, sim: SimulatedBench
) -> None:
    node, before = sim.devices["shaker"], dict(sim.devices["shaker"].settings)
    good = (15).to_bytes(2, "little") + (1000).to_bytes(2, "little")
    drive.link.send(COMMAND + drive.id, good)
    drive.get("probe")
    assert node.settings == before
    drive.start()
    for data, code in ((good[:3], 0x8210), (good[:2] + (10_001).to_bytes(2, "little"), 0x8200)):
        drive.link.send(COMMAND + drive.id, data)
        assert (drive.notices(), node.settings) == ([f"{drive.name}: emergency 0x{code:04X}"], before)


def test_a_restart_is_noticed_and_made_good(drive: Any, bench: Bench, sim: SimulatedBench) -> None:
    drive.start()
    drive.send("command", controlword="off", amplitude=0.25)
    drive.get("probe")
    with sim.clock.lock:
        sim.can.reboot(sim.devices["shaker"])
    assert f"{drive.name}: has started anew" in drive.differences()
    drive.restore()
    assert drive.differences() == []
    bench.device("sensor_node_1").acquire(0.01)
    assert drive.received("state")["torque"] == 0.0  # it has been started, too


def test_frames_of_another_length_are_not_used(drive: Any, sim: SimulatedBench) -> None:
    with can.Bus(interface="virtual", channel=sim.channel) as stranger:
        stranger.send(can.Message(arbitration_id=0x180 + drive.id, data=b"\0\0\0", is_extended_id=False))
        drive.get("probe")
        with pytest.raises(DeviceError, match=r"'state' came with 3 bytes instead of \d and are not used"):
            drive.received("state")


# --- in the contract and the bench file ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("contract", "way", "pdo", "message"),
    [
        (
            SENSOR_NODE,
            "pdos",
            Pdo("bad", 0x180, ("hardware_version",)),
            "hardware_version: it must be a number field .*",
        ),
        (SENSOR_NODE, "pdos", Pdo("bad", 0x180, ("reset_1",)), r"cannot hold reset_1: .* that can be read"),
        (SENSOR_NODE, "pdos", Pdo("bad", 0x180, ("nothing",)), "PDO bad cannot hold nothing"),
        (SENSOR_NODE, "pdos", Pdo("bad", 0x180, ("vendor", "product", "serial")), "PDO bad has 12 bytes; give 1 to 8"),
        (SENSOR_NODE, "receives", Pdo("bad", 0x200, ("vendor",)), r"PDO bad cannot hold vendor: .* can be written"),
        (SENSOR_NODE, "receives", Pdo("stamp", 0x200, ("heartbeat",)), "several PDOs have the name stamp"),
        (GENERATOR, "pdos", Pdo("bad", 0x180, ("frequency",)), "has PDOs, which are for CANopen only"),
    ],
)
def test_a_pdo_that_cannot_be_is_refused(contract: Contract, way: str, pdo: Pdo, message: str) -> None:
    with pytest.raises(ConfigError, match=f"^{contract.title}: .*{message}"):
        replace(contract, **{way: (pdo,)})  # type: ignore[arg-type]


def test_the_digest_of_a_contract_counts_what_it_receives_and_its_data_sheet_and_table_say_it(
    sim: SimulatedBench,
) -> None:
    contract: Contract = sim.devices["shaker"].contract
    assert replace(contract, receives=()).digest() != contract.digest()
    sheet = node_eds(contract)
    assert "NrOfRXPDO=1" in sheet.replace(" ", "").replace("\r", "")
    assert "[1600sub1]" in sheet and "$NODEID+0x200" in sheet
    assert "RPDO 1 (command), COB-ID 0x200 + node id: controlword, amplitude." in registers([contract])


def listed(sim: SimulatedBench, **changes: Any) -> BenchDescription:
    tables: dict[str, Any] = tomllib.loads(sim.description.to_toml())
    tables["device"]["shaker"] |= changes
    return check(tables, BenchDescription, "bench.toml")


def test_two_nodes_of_one_id_are_refused(sim: SimulatedBench) -> None:
    with pytest.raises(ConfigError, match="sensor_node_1 and shaker both have the address 1 on can; correct one"):
        listed(sim, node=1)


CLASHES = {
    0x17F: "PDO samples of sensor_node_1 and PDO state of shaker have the same identifier 0x181 on can; give one",
    0x57F: "SDO answers of sensor_node_1 and PDO state of shaker have the same identifier 0x581",
    0x7F0: "PDO state of shaker has the identifier 0x7F2 on can, which is kept for other messages",
    0x7E: "PDO state of shaker has the identifier 0x80 on can, which is kept for other messages",
    0x800: "PDO state of shaker has the identifier 0x802 on can, which is kept for other messages",
}


@pytest.mark.parametrize("base", CLASHES)
def test_two_messages_of_one_identifier_are_refused_before_anything_is_opened(
    base: int, sim: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    import acme_drive  # type: ignore[import-not-found]

    contract = replace(acme_drive.CONTRACT, pdos=(Pdo("state", base, ("statusword",)),))
    monkeypatch.setattr(acme_drive, "KIND", replace(acme_drive.KIND, contract=contract))
    with pytest.raises(ConfigError, match=CLASHES[base]):
        listed(sim)
