"""Sensor nodes on the bus: CiA 301 timing on the virtual clock, samples on SYNC, and what acquiring them notices."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from palpate.drivers.bench import Bench
from palpate.instrument.bench.links import MULTICAST, Block, take_blocks
from palpate.instrument.contracts.own import SYNC_COB_ID, SYNC_PRODUCER
from palpate.instrument.errors import BenchError, LinkError
from palpate.procedures.testing.wire import frames, payloads
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.can_segment import CanSegment
from palpate.simulators.devices.sensor_node import SENSOR_NODE, SimulatedSensorNode
from palpate.simulators.rig import Rig
from palpate.simulators.scenes.scene import Scene
from palpate.simulators.wire import can_bus
from palpate.simulators.wire.can_bus import hand_over, open_bus, own_channel

BOOT_UP, OPERATIONAL = b"\x00", b"\x05"
HEARTBEAT = 0x700


@pytest.fixture
def listener(sim: SimulatedBench) -> Iterator[can.BusABC]:
    with can.Bus(interface="virtual", channel=sim.description.links["can"].channel) as bus:
        yield bus


def sync(listener: can.BusABC) -> None:
    listener.send(can.Message(arbitration_id=SYNC_COB_ID, is_extended_id=False))


# --- communication by CiA 301 --------------------------------------------------------------------------


def test_a_node_boots_up_when_it_is_switched_on(scene: Scene) -> None:
    clock = VirtualClock()
    rig = Rig(scene, clock)
    segment = CanSegment(clock, rig, "virtual", "boot-up")
    for node_id in (5, 9):
        segment.add(SimulatedSensorNode(clock, node_id, 1, rig))
    with can.Bus(interface="virtual", channel="boot-up") as listener, segment:
        started = frames(listener)
    assert payloads(started, HEARTBEAT + 5) == payloads(started, HEARTBEAT + 9) == [BOOT_UP]


def test_the_heartbeat_follows_its_period_and_tells_the_state(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.set("heartbeat", 0.1)
    node.arm()
    node.get("probe")
    sim.clock.wait(0.35)
    assert payloads(frames(listener), HEARTBEAT + 1) == [OPERATIONAL] * 3
    node.set("heartbeat", 0.0)
    sim.clock.wait(5.0)
    assert payloads(frames(listener), HEARTBEAT + 1) == []


# --- SYNC ----------------------------------------------------------------------------------------------


def test_the_producer_sends_sync_from_one_period_on_until_it_is_told_to_stop(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.set_sample_rate(100.0)
    sim.clock.wait(0.0034)
    node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    sim.clock.wait(0.0099)
    assert payloads(frames(listener), SYNC_COB_ID) == []
    sim.clock.wait(0.0902)
    assert payloads(frames(listener), SYNC_COB_ID) == [b""] * 10
    node.set("sync_cob_id", SYNC_COB_ID)
    sim.clock.wait(1.0)
    assert payloads(frames(listener), SYNC_COB_ID) == []


def test_a_node_samples_at_the_sync_of_a_master(sim: SimulatedBench, bench: Bench, listener: can.BusABC) -> None:
    node = bench.device("sensor_node_1")
    node.arm()
    for number in (1, 2, 3):
        sim.clock.wait(0.01)
        sync(listener)
        assert node.get("sample_counter") == number
    assert node.collect(3).voltage.shape == (4, 3)


def test_the_sample_counter_goes_on_from_zero_after_its_largest_number(
    sim: SimulatedBench, bench: Bench, listener: can.BusABC
) -> None:
    node = bench.device("sensor_node_1")
    node.arm()
    assert node.get("sample_counter") == 0
    sim.nodes[0].settings["sample_counter"] = 2.0**32 - 3
    node.set("sync_cob_id", SYNC_PRODUCER | SYNC_COB_ID)
    sim.clock.wait(0.005)
    assert node.get("sample_counter") == 2
    stamps = [int.from_bytes(data[:4], "little") for data in payloads(frames(listener), 0x281)]
    assert stamps == [2**32 - 2, 2**32 - 1, 0, 1, 2]
    with pytest.raises(LinkError, match="missing from number 1 on"):
        node.collect(5)


# --- blocks of frames --------------------------------------------------------------------------------

BLOCK = Block(
    np.array([1000, 2000]),
    [(0x80, np.empty((2, 0), np.uint8)), (0x181, np.arange(16, dtype=np.uint8).reshape(2, 8))],
)
FRAMES = [(0x80, b""), (0x181, bytes(range(8))), (0x80, b""), (0x181, bytes(range(8, 16)))]


def heard(*, singly: bool) -> list[tuple[int, bytes]]:
    channel = own_channel("virtual")
    with open_bus("virtual", channel) as sender, can.Bus(channel, "virtual") as receiver:
        if singly:
            sender.send = sender.send  # type: ignore[method-assign]  # as a fault stands in for it
        hand_over(sender, BLOCK)
        messages = [receiver.recv(0) for _ in FRAMES]
        assert receiver.recv(0) is None
        assert sender.recv(0) is None
    assert not any(m is None or m.is_extended_id for m in messages)
    return [(m.arbitration_id, bytes(m.data)) for m in messages if m is not None]


def test_a_block_is_heard_as_frames_sent_one_by_one() -> None:
    assert heard(singly=False) == heard(singly=True) == FRAMES


def test_a_receiver_that_takes_blocks_gets_one_whole_unless_a_fault_looks_at_its_frames() -> None:
    channel = own_channel("virtual")
    with open_bus("virtual", channel) as sender, VirtualBus(channel) as receiver:
        take_blocks(receiver.queue)
        hand_over(sender, BLOCK)
        sender.send = sender.send  # type: ignore[method-assign]  # as a fault stands in for it
        hand_over(sender, BLOCK)
        received: list[Any] = [receiver.recv(0) for _ in range(5)]
        assert receiver.recv(0) is None
    assert received[0] is BLOCK
    assert [(m.arbitration_id, bytes(m.data)) for m in received[1:]] == FRAMES


def test_two_benches_of_this_machine_never_share_a_multicast_group(monkeypatch: pytest.MonkeyPatch) -> None:
    """They do not even where there are two groups only."""
    monkeypatch.setattr(can_bus, "GROUPS", 2)
    group = own_channel(MULTICAST)
    with open_bus(MULTICAST, group):
        assert group not in {own_channel(MULTICAST) for _ in range(4)}
        with pytest.raises(BenchError, match=f"{group} is in use by another served bench; leave the channel out"):
            open_bus(MULTICAST, group)
    with open_bus(MULTICAST, group):
        pass


# --- what a client sends -----------------------------------------------------------------------------

REQUEST, ANSWER, NMT, SYNC = 0x601, 0x581, 0x000, 0x080
START, STOP, PREPARE, RESET_NODE, RESET_COMMUNICATION = 0x01, 0x02, 0x80, 0x81, 0x82
PROBE = "40 00 20 00 00 00 00 00"


class Master:
    """Sends frames and hears all others."""

    def __init__(self, sim: SimulatedBench) -> None:
        self.sim = sim
        bus = sim.description.links["can"]
        self._bus = can.Bus(interface=bus.interface, channel=bus.channel)

    def close(self) -> None:
        self._bus.shutdown()

    def send(self, identifier: int, data: str, **kind: bool) -> None:
        self._bus.send(
            can.Message(arbitration_id=identifier, data=bytes.fromhex(data), **{"is_extended_id": False} | kind)
        )

    def next(self, identifier: int) -> str:
        """The next frame with this identifier."""
        while True:
            frame = self._bus.recv(10)
            assert frame is not None, f"no frame 0x{identifier:03X}"
            if frame.arbitration_id == identifier:
                return bytes(frame.data).hex()

    def ask(self, data: str) -> str:
        self.send(REQUEST, data)
        return self.next(ANSWER)

    def nmt(self, command: int, node: int = 1) -> None:
        """And wait until the node, if it can, has answered what came after."""
        self.send(NMT, f"{command:02x} {node:02x}")
        if command != STOP:
            self.ask(PROBE)

    def heard(self, identifier: int) -> list[str]:
        """Frames with this identifier that have come so far."""
        frames = iter(lambda: self._bus.recv(0.02), None)
        return [bytes(f.data).hex() for f in frames if f is not None and f.arbitration_id == identifier]


@pytest.fixture
def master(sim: SimulatedBench) -> Iterator[Master]:
    one = Master(sim)
    yield one
    one.close()


def written(name: str, raw: int, size: int | None = None) -> str:
    """An expedited write of an object, of its own size or another."""
    field = SENSOR_NODE[name]
    length = field.size if size is None else size
    command = 0x23 | (4 - length) << 2
    return (
        f"{command:02x} {field.index.to_bytes(2, 'little').hex()} {field.subindex:02x}"
        + raw.to_bytes(4, "little").hex()
    )


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("40 00 50 00 00 00 00 00", 0x0602_0000),  # no such object
        ("40 00 21 09 00 00 00 00", 0x0609_0011),  # no such subindex
        ("2f 00 50 00 00 00 00 00", 0x0602_0000),
        ("40 10 21 01 00 00 00 00", 0x0601_0001),  # write only
        (written("device_type", 1), 0x0601_0002),  # read only
        (written("sync_period", 10_000_001), 0x0609_0031),  # too high
        (written("sync_period", 99), 0x0609_0032),  # too low
        (written("heartbeat", 60_001), 0x0609_0031),
        (written("sync_period", 1000, size=2), 0x0607_0010),  # length
        (written("range_1", 0, size=4), 0x0607_0010),
        (written("range_1", 2), 0x0609_0030),  # no choice
        ("2f 00 21 09 00 00 00 00", 0x0609_0011),
        ("c2 00 21 01 00 00 00 00", 0x0504_0001),  # block download
    ],
)
def test_what_is_wrong_with_a_transfer_has_its_abort_code(master: Master, request_: str, code: int) -> None:
    assert master.ask(request_) == "80" + bytes.fromhex(request_)[1:4].hex() + code.to_bytes(4, "little").hex()


def test_a_stopped_node_is_silent_but_for_its_heartbeat(master: Master) -> None:
    master.nmt(START)
    master.send(NMT, f"{STOP:02x} 00")
    master.send(SYNC, "")
    master.send(REQUEST, PROBE)
    assert master.heard(ANSWER) == []
    master.sim.clock.wait(1.0)
    assert master.next(HEARTBEAT + 1) == "04"
    master.nmt(PREPARE)
    master.sim.clock.wait(1.0)
    assert master.next(HEARTBEAT + 1) == "7f"


@pytest.mark.parametrize("command", [RESET_NODE, RESET_COMMUNICATION])
def test_a_reset_boots_a_stopped_node_with_its_defaults(master: Master, command: int) -> None:
    master.ask(written("sync_period", 2000))
    master.nmt(STOP)
    master.nmt(command)
    assert master.sim.can.states == {1: "PRE-OPERATIONAL"}
    assert master.ask("40 06 10 00 00 00 00 00") == "43061000e8030000"


def test_a_command_to_another_node_and_an_unknown_one_change_nothing(master: Master) -> None:
    master.nmt(START, node=2)
    master.nmt(0x33)
    assert master.sim.can.states == {1: "PRE-OPERATIONAL"}


@pytest.mark.parametrize("kind", [{"is_extended_id": True}, {"is_remote_frame": True}, {"is_fd": True}])
def test_frames_of_another_kind_are_none_of_the_nodes(master: Master, kind: dict[str, bool]) -> None:
    data = "" if "is_remote_frame" in kind else "01 01"
    master.send(NMT, data, **kind)
    master.ask(PROBE)
    assert master.sim.can.states == {1: "PRE-OPERATIONAL"}


@pytest.mark.parametrize("data", ["", "01", "40 00 20", "40 00 20 00 00 00 00"])
def test_frames_that_are_too_short_are_none_of_the_nodes(master: Master, data: str) -> None:
    master.send(REQUEST, data)
    master.send(NMT, data[:2])
    assert master.ask(PROBE) == "4300200078563412"
    assert master.heard(ANSWER) == []


# --- transfers at the edge of CiA 301 ------------------------------------------------------------------

TOO_LONG, TOO_SHORT, UNKNOWN_COMMAND, NOT_TOGGLED = "12000706", "13000706", "01000405", "00000305"


def test_an_expedited_download_without_a_size_is_taken(master: Master) -> None:
    """7.2.4.3.3: the server takes as many of the four bytes as the object has."""
    assert master.ask("22 17 10 00 F4 01 00 00") == "6017100000000000"  # 1017h, two bytes: 500 ms
    assert master.ask("40 17 10 00 00 00 00 00") == "4b171000f4010000"
    assert master.ask("22 00 21 01 01 AA BB CC") == "6000210100000000"  # 2100h, one byte
    assert master.ask("40 00 21 01 00 00 00 00") == "4f00210101000000"


@pytest.mark.parametrize(
    ("announced", "code"), [("00 00 00 80", TOO_LONG), ("03 00 00 00", TOO_LONG), ("01 00 00 00", TOO_SHORT)]
)
def test_a_segmented_download_of_another_size_is_refused_at_once(master: Master, announced: str, code: str) -> None:
    assert master.ask(f"21 17 10 00 {announced}") == "80171000" + code
    assert master.ask("00 01 02 03 04 05 06 07")[8:] == UNKNOWN_COMMAND


def test_a_segmented_download_that_goes_on_is_refused_and_one_that_fits_is_taken(master: Master) -> None:
    assert master.ask("20 17 10 00 00 00 00 00") == "6017100000000000"
    assert master.ask("00 01 02 03 04 05 06 07")[8:] == TOO_LONG
    assert master.ask("21 17 10 00 02 00 00 00") == "6017100000000000"
    assert master.ask("0B F4 01 00 00 00 00 00") == "2000000000000000"
    assert master.ask("40 17 10 00 00 00 00 00") == "4b171000f4010000"
    assert master.ask("1B F4 01 00 00 00 00 00")[8:] == UNKNOWN_COMMAND  # it has ended


def test_a_segment_with_the_wrong_toggle_bit_ends_the_transfer(master: Master) -> None:
    assert master.ask("40 08 10 00 00 00 00 00") == "410810000c000000"
    assert master.ask("70 00 00 00 00 00 00 00")[8:] == NOT_TOGGLED
    assert master.ask("60 00 00 00 00 00 00 00")[8:] == UNKNOWN_COMMAND


def test_a_transfer_that_its_client_aborts_has_ended(master: Master) -> None:
    assert master.ask("40 08 10 00 00 00 00 00") == "410810000c000000"
    master.send(REQUEST, "80 08 10 00 00 00 04 05")
    assert master.ask("60 00 00 00 00 00 00 00")[8:] == UNKNOWN_COMMAND


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("A4 08 10 00 7F 00 00 00", "80081000" + UNKNOWN_COMMAND),  # no change of protocol is offered
        ("A4 08 10 00 7F 0B 00 00", "80081000" + UNKNOWN_COMMAND),  # one is up to 11 bytes, the name has 12
        ("A4 08 10 00 7F 0C 00 00", "410810000c000000"),
        ("A4 00 20 00 7F 04 00 00", "4300200078563412"),
        ("A3 00 20 00 7F 04 00 00", "80002000" + UNKNOWN_COMMAND),  # start of a block upload that was not begun
        ("C6 17 10 00 02 00 00 00", "80171000" + UNKNOWN_COMMAND),  # block download
    ],
)
def test_a_block_transfer_is_answered_by_what_its_client_offers_or_refused(
    master: Master, request_: str, answer: str
) -> None:
    assert master.ask(request_) == answer


def test_emergencies_come_with_the_identifier_that_1014h_tells(master: Master) -> None:
    assert master.ask("40 14 10 00 00 00 00 00") == "4314100081000000"
    sim = master.sim
    with sim.clock.lock:
        sim.can.nodes[0].emergency(0x8110)
    assert master.next(0x081) == "1081000000000000"
