"""A bus log by itself: its files and names, the frames of a bus as bytes, and what becomes of a log that fails."""

from __future__ import annotations

import hashlib
import io
import re
import struct
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
from palpate.instrument.errors import RecordError
from palpate.simulators.bench import SimulatedBench
from tests.drivers.benches import open_bench

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
def test_a_log_has_one_file_for_everything_and_one_for_can_where_its_name_says_so(name: str, files: list[str]) -> None:
    assert log_files(Path(name)) == [Path(file) for file in files]


@pytest.mark.parametrize(("who", "kind"), [("oven", "oven"), ("left (oven)", "oven"), ("a (b) (oven)", "b) (oven")])
def test_a_device_is_called_by_its_name_and_its_kind(who: str, kind: str) -> None:
    assert kind_called(who) == kind


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
    assert bytes.fromhex(BEGINS) == BEGINNING
    assert written(end=False) == BEGINNING


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
    assert sum(struct.unpack(">10H", ip)) % 0xFFFF == 0
    assert int.from_bytes(ip[2:4], "big") == 40 + size


# --- reading -------------------------------------------------------------------------------------------


def read(tmp_path: Path, content: bytes) -> list[Packet]:
    path = tmp_path / "c.pcapng"
    path.write_bytes(content)
    return list(read_pcapng(path))


@pytest.mark.parametrize("size", range(9))
def test_packets_come_back_whatever_their_length(size: int, tmp_path: Path) -> None:
    packets = [Packet(2**63 + 1, "n" * size, link, sent, bytes(range(size))) for link in Link for sent in (True, False)]
    assert read(tmp_path, written(*packets)) == packets


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
        read(tmp_path, content)
