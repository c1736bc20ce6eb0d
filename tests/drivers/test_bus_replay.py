"""A bus log holds what travelled, byte for byte, and the drivers hear the same when it is on the wire again."""

from __future__ import annotations

import hashlib
import io
import json
import re
import socket
import struct
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import can
import pytest

from palpate.drivers.logs.bus_log import (
    BEGINNING,
    BusLog,
    Link,
    Packet,
    PcapngWriter,
    kind_called,
    log_files,
    packed,
    read_pcapng,
    unpacked,
)
from palpate.drivers.logs.bus_replay import BusReplay, ReplayWire
from palpate.extend import Bench, BenchDescription, Scene
from palpate.instrument.bench.links import LOOPBACK, MULTICAST
from palpate.instrument.errors import ConfigError, DeviceError, LinkTimeout, RecordError
from palpate.procedures.logs import described
from palpate.simulators.bench import BenchAddresses, SimulatedBench
from tests.conftest import hasty
from tests.drivers.benches import altered, open_bench


class Ticking:
    """A clock that is never twice the same, as that of the wall."""

    goes_on = False
    stepper = None

    def __init__(self, sim: SimulatedBench) -> None:
        self._clock = sim.clock
        self._looks = 0

    def now_ns(self) -> int:
        self._looks += 1
        return self._clock.now_ns() + 7 * self._looks

    def wait(self, duration: float) -> None:
        self._clock.wait(duration)


def used(bench: Bench) -> list[Any]:
    """What is heard of all devices, over all links; one of them refuses."""
    with bench:
        node = bench.device("sensor_node_1")
        bench.device("signal_generator").sine(12.5, 0.5)
        bench.device("positioner").move(1e-3)
        recording = node.acquire(0.02)
        voltage = recording.voltage.tobytes()
        with pytest.raises(DeviceError) as refused:
            node.link.upload("it", node.link.add_node(node.id), 0x5000, 0)
        heard = [
            voltage,
            bench.device("signal_generator").read(),
            bench.device("strain_indicator").read(),
            bench.device("positioner").position(),
        ]
        return [*heard, str(refused.value), node.notices(), node.serial, bench.clock.now_ns()]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return tmp_path / "trace.blf"


def logged(
    sim: SimulatedBench, log: Path, use: Callable[[Bench], Any] = used, description: BenchDescription | None = None
) -> Any:
    clock = Ticking(sim)
    bench = Bench(description or sim.description, clock, sim.operator)
    with BusLog(bench, clock, log, datetime(2026, 1, 2, tzinfo=UTC)) as recording:
        recording.describe(json.dumps({"bench": bench.description.to_toml()}))
        return use(bench)


def replayed(sim: SimulatedBench, log: Path, use: Callable[[Bench], Any] = used) -> Any:
    with BusReplay(log, described) as replay:
        bench = Bench(replay.description, replay, sim.operator)
        replay.attach(bench)
        return use(bench)


@pytest.mark.parametrize("addresses", [BenchAddresses(), BenchAddresses(interface=MULTICAST)])
def test_the_drivers_hear_what_they_heard_over_tcp_the_line_and_can_also_where_can_goes_by_multicast(
    addresses: BenchAddresses, nothing_left_behind: None, scene: Scene, log: Path
) -> None:
    with SimulatedBench(scene, addresses) as sim:
        heard = logged(sim, log)
        sim.generator.write({"frequency": 99.0})  # of the bench itself nothing is asked
        assert replayed(sim, log) == heard


@pytest.mark.slow
def test_a_request_that_was_not_answered_is_not_answered(sim: SimulatedBench, log: Path) -> None:
    def use(bench: Bench) -> float:
        with bench:
            bench.device("positioner").unit = 9  # nobody's on that line
            with pytest.raises(LinkTimeout):
                bench.device("positioner").position()
            bench.device("positioner").unit = 2
            bench.device("positioner").move(1e-3)
            return bench.device("positioner").position()

    assert logged(sim, log, use, hasty(sim.description)) == replayed(sim, log, use) == 1e-3


@pytest.mark.parametrize("fed_by", ["owner", "any request"])
def test_signs_of_life_to_the_watchdog_may_come_at_other_times_than_in_the_log(
    sim: SimulatedBench, log: Path, fed_by: str
) -> None:
    """On a wall clock a thread gives them, at times that differ from run to run."""
    sim.description = altered(sim.description, device={"shaker_amplifier": {"watchdog_fed_by": fed_by}})

    def use(bench: Bench, *beats: int) -> list[Any]:
        heard: list[Any] = []
        with bench:
            bench.drive()
            for gain, count in enumerate(beats):
                for _ in range(count):
                    bench.device("shaker_amplifier").live()
                bench.device("shaker_amplifier").set(gain=gain)
                bench.clock.wait(1.5)
                heard += [bench.device("shaker_amplifier").read(), bench.clock.now_ns()]
        return heard

    heard = logged(sim, log, lambda bench: use(bench, 0, 3, 1))
    assert replayed(sim, log, lambda bench: use(bench, 2, 0, 5)) == heard


def test_what_the_log_does_not_hold_at_that_place_is_an_error_that_names_it(sim: SimulatedBench, log: Path) -> None:
    logged(sim, log)

    def other(bench: Bench) -> None:
        with bench:
            bench.device("signal_generator").sine(12.6, 0.5)

    asked = "the replay sends 'signal_generator <- write frequency = 12.6 Hz, .*log goes on with .*frequency = 12.5 Hz"
    with pytest.raises(ConfigError, match=asked):
        replayed(sim, log, other)


def test_a_log_in_which_no_run_began_and_one_that_is_cut_short_are_refused(log: Path) -> None:
    path = log.with_suffix(".pcapng")
    with path.open("wb") as file:
        PcapngWriter(file).end()
    with pytest.raises(ConfigError, match="no run began in this log; replay a log that --log recorded of a"):
        BusReplay(path, described)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ConfigError, match=r"damaged: cut short at byte \d+; only a whole log can be"):
        BusReplay(path, described)


# --- the devices' ends of a replay ---------------------------------------------------------------------


PATIENCE = 10.0  # s until a test gives up


@pytest.fixture
def wire() -> Iterator[ReplayWire]:
    with ReplayWire() as open_:
        yield open_


def connected(port: int) -> socket.socket:
    return socket.create_connection((LOOPBACK, port), timeout=PATIENCE)


def read(end: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        data += end.recv(size - len(data))
    return data


def test_a_client_that_connects_anew_begins_a_request_anew(wire: ReplayWire) -> None:
    port = wire.listen("rack")
    wire.expect("rack", 4, b"reply")
    with connected(port) as end:
        end.sendall(b"12")
        end.shutdown(socket.SHUT_WR)
        assert end.recv(1) == b""  # it has noticed
    with connected(port) as end:
        end.sendall(b"1234")
        assert read(end, 5) == b"reply"


# --- a log by itself -----------------------------------------------------------------------------------


STARTED = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


# --- files ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("t.pcapng", ["t.pcapng"]),
        ("t.PcapNg", ["t.PcapNg"]),
        ("t.blf", ["t.pcapng", "t.blf"]),
        ("t.ASC", ["t.pcapng", "t.ASC"]),
    ],
)
def test_a_log_has_a_file_for_everything_and_one_for_can_where_its_name_says_so_and_devices_by_name_and_kind(
    name: str, files: list[str]
) -> None:
    assert log_files(Path(name)) == [Path(file) for file in files]
    assert [kind_called(who) for who in ("oven", "left (oven)", "a (b) (oven)")] == ["oven", "oven", "b) (oven"]


# --- CAN frames as bytes -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "data"),
    [
        ({"arbitration_id": 0x581, "data": b"\1\2", "is_extended_id": False}, "00000581 02 000000 0102"),
        ({"arbitration_id": 0x12345678, "data": b"", "is_extended_id": True}, "92345678 00 000000"),
        ({"arbitration_id": 0x701, "is_remote_frame": True, "dlc": 3, "is_extended_id": False}, "40000701 03 000000"),
        ({"arbitration_id": 4, "is_error_frame": True, "dlc": 8, "data": bytes(8), "is_extended_id": False},
         "20000004 08 000000 0000000000000000"),
    ],
)  # fmt: skip
def test_a_frame_is_packed_as_linux_has_it(frame: dict[str, Any], data: str) -> None:
    """struct can_frame; its identifier and flags are big-endian in a capture (SocketCAN of LINKTYPE 227)."""
    message = can.Message(**frame)
    assert packed(message) == bytes.fromhex(data)
    assert unpacked(bytes.fromhex(data)).equals(message, timestamp_delta=None)


# --- a log that fails ----------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["write", "end"])
@pytest.mark.parametrize("error", [RecordError, KeyError])
def test_a_log_that_fails_ends_once_and_neither_ends_the_run_nor_hides_its_failure(
    method: str, error: type[Exception], sim: SimulatedBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed = list[object]()

    def full(*given: object) -> None:
        failed.append(given)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PcapngWriter, method, full)
    bench = open_bench(sim)
    told = r"t\.pcapng: the bus log is incomplete: .*No space left.*; make room on the disk, and|the run"
    with pytest.raises(error, match=told), BusLog(bench, sim.clock, tmp_path / "t.pcapng", STARTED), bench:
        bench.device("positioner").move(1e-3)
        if error is KeyError:
            raise KeyError("the run")
    assert (len(failed), sim.rig.position) == (1, 1e-3)


# --- a capture file byte for byte ----------------------------------------------------------------------


PACKETS = [
    Packet(0x0123_4567_89AB_CDEF, "oven", Link.TCP, True, b"abc"),
    Packet(0x0123_4567_89AB_CDEF, "oven", Link.TCP, False, b"defg"),
    Packet(1_700_000_000_123_456_789, "stage", Link.LINE, True, b"\x02\x03"),
    Packet(1_700_000_000_999_999_999, "stage", Link.LINE, False, b"\x02"),
    Packet(5, "node", Link.CAN, False, b"\0\0\x05\x81\x01\0\0\0\x09"),
    Packet(6, "clock", Link.NOTE, True, b"17"),
]
INTERFACES = "".join(
    f"01000000 20000000 {kind} 0000 00000000 0900 0100 09000000 00000000 20000000"  # times in nanoseconds
    for kind in ("e400", "fa00", "e300", "fc00")  # IPv4, RTAC serial, SocketCAN, upper PDU
)
BEGINS = (
    "0a0d0d0a 48000000 4d3c2b1a 0100 0000 ffffffffffffffff 0400 2400"
    + b"palpate, with the SHA-256 at its end".hex()
    + "00000000 48000000"
    + INTERFACES
)
OPTIONS = "0100 {} 0200 0400 {} 00000000"  # the comment, then whether it was sent (2) or came (1)
WRITTEN = [
    # a packet of 43 bytes: IP with its check sum, TCP from 10.0.0.1 to the device, the sequence numbers
    "06000000 60000000 00000000 67452301 efcdab89 2b000000 2b000000"
    "4500 002b 0000 4000 40 06 26cb 0a000001 0a000002"
    "c350 01f6 00000001 00000001 50 18 ffff 0000 0000 616263 00"
    + OPTIONS.format("0400 6f76656e", "02000000")
    + "60000000",
    # the answer: ends and sequence numbers the other way round, its acknowledged number counts the request
    "06000000 60000000 00000000 67452301 efcdab89 2c000000 2c000000"
    "4500 002c 0000 4000 40 06 26ca 0a000002 0a000001"
    "01f6 c350 00000001 00000004 50 18 ffff 0000 0000 64656667"
    + OPTIONS.format("0400 6f76656e", "01000000")
    + "60000000",
    # seconds and microseconds, sent (1), no control signals
    "06000000 48000000 01000000 fe9c9717 15cd853d 0e000000 0e000000"
    "6553f100 0001e240 01 00 0000 0203 0000" + OPTIONS.format("0500 7374616765000000", "02000000") + "48000000",
    "06000000 48000000 01000000 fe9c9717 ffc9c471 0d000000 0d000000"
    "6553f100 000f423f 02 00 0000 02 000000" + OPTIONS.format("0500 7374616765000000", "01000000") + "48000000",
    "06000000 40000000 02000000 00000000 05000000 09000000 09000000"
    "00000581 01000000 09 000000" + OPTIONS.format("0400 6e6f6465", "01000000") + "40000000",
    # the name of the dissector for what follows
    "06000000 48000000 03000000 00000000 06000000 0e000000 0e000000"
    "000c 0004 6a736f6e 0000 0000 3137 0000" + OPTIONS.format("0500 636c6f636b000000", "02000000") + "48000000",
]


def written(*packets: Packet, end: bool = True) -> bytes:
    file = io.BytesIO()
    writer = PcapngWriter(file)
    for packet in packets:
        writer.write(packet)
    if end:
        writer.end()
    return file.getvalue()


def test_a_file_begins_with_its_section_and_four_interfaces_whose_times_are_nanoseconds() -> None:
    assert (bytes.fromhex(BEGINS), written(end=False)) == (BEGINNING, BEGINNING)


@pytest.mark.parametrize("number", range(len(PACKETS)))
def test_a_packet_is_written_with_the_headers_of_its_interface(number: int) -> None:
    before = len(written(*PACKETS[:number], end=False))
    assert written(*PACKETS[: number + 1], end=False)[before:].hex(" ", 4) == bytes.fromhex(WRITTEN[number]).hex(" ", 4)


def test_the_last_note_is_the_hash_of_all_before_it_at_the_time_of_the_last_packet() -> None:
    content = written(*PACKETS, end=False)
    last = written(*PACKETS)[len(content) :]
    assert struct.unpack_from("<III", last, 8) == (3, 0, 6)
    assert hashlib.sha256(content).hexdigest().encode() in last
    assert b"sha256" in last
    assert struct.unpack_from("<III", written()[len(BEGINNING) :], 8) == (3, 0, 0)  # there was none


def tcp_of(data: bytes, number: int) -> tuple[bytes, bytes]:
    """IP and TCP headers of a packet."""
    at = len(BEGINNING)
    for _ in range(number):
        at += int.from_bytes(data[at + 4 : at + 8], "little")
    return data[at + 28 : at + 48], data[at + 48 : at + 68]


@pytest.mark.parametrize("size", [0, 1, 260, 9_000, 20_000, 40_000])
def test_the_check_sum_of_the_ip_header_is_that_of_rfc_791(size: int) -> None:
    """The one's complement sum of all its 16-bit words is FFFFh."""
    ip, _ = tcp_of(written(Packet(0, "oven", Link.TCP, False, bytes(size))), 0)
    assert (sum(struct.unpack(">10H", ip)) % 0xFFFF, int.from_bytes(ip[2:4], "big")) == (0, 40 + size)


# --- reading -------------------------------------------------------------------------------------------


def read_back(tmp_path: Path, content: bytes) -> list[Packet]:
    path = tmp_path / "c.pcapng"
    path.write_bytes(content)
    return list(read_pcapng(path))


@pytest.mark.parametrize("size", range(9))
def test_packets_come_back_whatever_their_length(size: int, tmp_path: Path) -> None:
    packets = [Packet(2**63 + 1, "n" * size, link, sent, bytes(range(size))) for link in Link for sent in (True, False)]
    assert read_back(tmp_path, written(*packets)) == packets


WHOLE = written(*PACKETS)
CUT_OFF = written(*PACKETS, end=False)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "no capture file of palpate"),
        (b"\n\r\r\n" + WHOLE[4:8] + b"MMMM" + WHOLE[12:], "no capture file of palpate"),
        (b"MMMM" + WHOLE[4:], "no capture file of palpate"),
        (WHOLE[:20] + b"\0" + WHOLE[21:], "its first bytes are damaged"),
        (WHOLE[:-1], f"cut short at byte {len(CUT_OFF)}"),
        (WHOLE + b"\0", "its bytes were changed"),
        (CUT_OFF + b"\6\0\0\0\x0b\0\0\0" + bytes(12), f"cut short at byte {len(CUT_OFF)}"),
        (CUT_OFF + b"\6\0\0\0", f"cut short at byte {len(CUT_OFF)}"),
        (WHOLE.replace(b"abc", b"abd"), "its bytes were changed (the SHA-256 differs)"),
    ],
)
def test_damage_is_told_with_its_kind_and_place(content: bytes, says: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(says)}"):
        read_back(tmp_path, content)
