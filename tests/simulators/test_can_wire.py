"""The simulated nodes on the wire, frame by frame, as any CANopen master meets them (CiA 301)."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest

from palpate.simulators.bench import SimulatedBench
from palpate.simulators.devices.sensor_node import SENSOR_NODE

REQUEST, ANSWER, HEARTBEAT, NMT, SYNC = 0x601, 0x581, 0x701, 0x000, 0x080
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


def test_an_unknown_command_is_aborted(master: Master) -> None:
    assert master.ask("e0 00 20 00 00 00 00 00").endswith("01000405")


def test_an_object_above_four_bytes_comes_in_segments(master: Master) -> None:
    name = str(SENSOR_NODE["device_name"].default).encode()
    assert master.ask("40 08 10 00 00 00 00 00") == "41081000" + len(name).to_bytes(4, "little").hex()
    assert master.ask("60 00 00 00 00 00 00 00") == "00" + name[:7].hex()
    rest = name[7:]
    assert master.ask("70 00 00 00 00 00 00 00") == f"{0x11 | (7 - len(rest)) << 1:02x}" + rest.ljust(7, b"\0").hex()


def test_a_segment_with_the_wrong_toggle_bit_is_aborted(master: Master) -> None:
    master.ask("40 08 10 00 00 00 00 00")
    assert master.ask("70 00 00 00 00 00 00 00").endswith("00000305")


def test_a_segment_of_no_transfer_is_aborted(master: Master) -> None:
    assert master.ask("60 00 00 00 00 00 00 00").startswith("80")


def test_an_object_can_be_written_in_segments(master: Master) -> None:
    assert master.ask("21 06 10 00 04 00 00 00") == "6006100000000000"
    assert master.ask("07 d0 07 00 00 00 00 00") == "2000000000000000"
    assert master.ask("40 06 10 00 00 00 00 00") == "43061000d0070000"


def test_the_mapping_of_the_process_data_can_be_read(master: Master) -> None:
    for number, pdo in enumerate(SENSOR_NODE.pdos):
        assert master.ask(f"40 {number:02x} 1a 00 00 00 00 00")[8:10] == f"{len(pdo.fields):02x}"
        for sub, name in enumerate(pdo.fields, 1):
            field = SENSOR_NODE[name]
            mapped = field.index << 16 | field.subindex << 8 | 8 * field.size
            assert master.ask(f"40 {number:02x} 1a {sub:02x} 00 00 00 00")[8:] == mapped.to_bytes(4, "little").hex()


def test_a_stopped_node_is_silent_but_for_its_heartbeat(master: Master) -> None:
    master.nmt(START)
    master.send(NMT, f"{STOP:02x} 00")
    master.send(SYNC, "")
    master.send(REQUEST, PROBE)
    assert master.heard(ANSWER) == []
    master.sim.clock.wait(1.0)
    assert master.next(HEARTBEAT) == "04"
    master.nmt(PREPARE)
    master.sim.clock.wait(1.0)
    assert master.next(HEARTBEAT) == "7f"


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
