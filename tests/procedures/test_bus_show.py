"""`palpate bus show` of logs of any program: each kind of frame is called what it is, and a cut log is told."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import can
import pytest

from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter
from tests.procedures.conftest import Palpate

ASC = """date Mon Jan 1 10:00:00.000 am 2024
base hex  timestamps absolute
internal events logged
Begin Triggerblock Mon Jan 1 10:00:00.000 am 2024
   0.000000 Start of measurement
   1.000000 1  ErrorFrame
   1.100000 1  705             Rx   r 1
   1.200000 1  18EBFF01x       Rx   d 8 01 02 03 04 05 06 07 08
   1.300000 1  705             Rx   d 1 05
   1.400000 2  705             Rx   d 1 7F
End TriggerBlock
"""
CANDUMP = """(1.000000) can0 20000004#0000000000000000
(1.100000) can0 705#R1
(1.200000) can0 18EBFF01#0102030405060708
(1.300000) can0 705#05
(1.400000) vcan1 705#7F
(1.500000) can0 123##0112233
"""
TEXTS = [
    ("bus", "error frame"), ("bus", "remote frame for 1 byte of 0x705"),
    ("bus", "29-bit frame 0x18EBFF01: 01 02 03 04 05 06 07 08"), ("node 5", "heartbeat, operational"),
    ("node 5", "heartbeat, pre-operational"),
]  # fmt: skip


def shown(palpate: Palpate, name: str, content: str) -> list[dict[str, Any]]:
    Path(name).write_text(content)
    messages: list[dict[str, Any]] = palpate("bus", "show", name, "--json").object["messages"]
    return messages


def frames() -> list[can.Message]:
    kinds: list[dict[str, Any]] = [
        {"is_error_frame": True}, {"is_remote_frame": True, "arbitration_id": 0x705, "dlc": 1},
        {"arbitration_id": 0x18EBFF01, "is_extended_id": True, "data": bytes(range(1, 9))},
        {"arbitration_id": 0x705, "data": b"\x05"}, {"arbitration_id": 0x705, "data": b"\x7f", "channel": 1},
    ]  # fmt: skip
    return [
        can.Message(**({"timestamp": 1 + 0.1 * number, "is_extended_id": False, "channel": 0} | each))
        for number, each in enumerate(kinds)
    ]


def blf(path: Path) -> bytes:
    with can.BLFWriter(path) as writer:
        for each in frames():
            writer(each)
    return path.read_bytes()


def test_each_kind_of_frame_of_an_asc_file_is_shown_as_what_it_is_with_its_channel(palpate: Palpate) -> None:
    messages = shown(palpate, "a.asc", ASC)
    assert [(m["who"], m["text"]) for m in messages] == TEXTS
    assert [m["channel"] for m in messages] == ["1", "1", "1", "1", "2"]
    lines = palpate("bus", "show", "a.asc").out.splitlines()
    assert [line.split()[:2] for line in (lines[0], lines[-1])] == [["0.000000", "1"], ["0.400000", "2"]]


def test_a_log_of_candump_is_read(palpate: Palpate) -> None:
    messages = shown(palpate, "a.log", CANDUMP)
    assert [(m["who"], m["text"]) for m in messages] == [*TEXTS, ("bus", "CAN FD frame 0x123: 11 22 33")]
    assert [m["channel"] for m in messages] == ["can0", "can0", "can0", "can0", "vcan1", "can0"]


def test_a_blf_file_and_our_own_capture_show_the_same(palpate: Palpate) -> None:
    from palpate.drivers.logs.bus_log import packed

    blf(Path("a.blf"))
    with Path("a.pcapng").open("wb") as file:
        writer = PcapngWriter(file)
        for each in frames():
            writer.write(Packet(round(each.timestamp * 1e9), "sensor_node", Link.CAN, False, packed(each)))
        writer.end()
    for name in ("a.blf", "a.pcapng"):
        messages = palpate("bus", "show", name, "--json").object["messages"]
        assert [(m["who"], m["text"]) for m in messages] == TEXTS


def test_one_channel_takes_no_column(palpate: Palpate) -> None:
    shown(palpate, "a.log", CANDUMP.replace("vcan1", "can0"))
    assert palpate("bus", "show", "a.log").out.splitlines()[3].split() == [
        "0.300000",
        "node",
        "5",
        "heartbeat,",
        "operational",
    ]


def test_a_message_that_follows_a_short_header_is_not_lost(palpate: Palpate) -> None:
    """python-can takes the first line after the header for a part of it, unless a certain line ends the header."""
    text = ASC.replace("internal events logged\n", "").replace(
        "Begin Triggerblock Mon Jan 1 10:00:00.000 am 2024\n", ""
    )
    text = text.replace("   0.000000 Start of measurement\n", "").replace("End TriggerBlock\n", "")
    assert [(m["who"], m["text"]) for m in shown(palpate, "a.asc", text)] == TEXTS


@pytest.mark.parametrize(
    ("name", "content", "kept", "why"),
    [
        ("a.asc", ASC.replace("End TriggerBlock\n", ""), 5, "its end is missing"),
        ("a.asc", ASC[: ASC.index("7F") + 1], 4, "its end is missing"),
        ("a.asc", ASC.replace("d 8 01 02", "d 8"), 2, "a frame 0x18EBFF01 has 6 of 8 bytes"),
        ("a.log", CANDUMP[:-3], 5, "its last line has no end"),
        ("a.log", CANDUMP.replace("705#05", "705-05"), 3, "line 4 cannot be read"),
    ],
)
def test_a_log_that_was_cut_off_or_is_damaged_is_told_after_what_precedes_that(
    name: str, content: str, kept: int, why: str, palpate: Palpate
) -> None:
    Path(name).write_text(content)
    said = palpate("bus", "show", name)
    assert (said.status, len(said.out.splitlines())) == (1, kept)
    assert said.err.startswith(f"palpate: error: {name}: damaged: ")
    assert why in said.err


def test_cut_binary_logs_are_told(palpate: Palpate) -> None:
    whole = blf(Path("a.blf"))
    killed = can.BLFWriter("b.blf", max_container_size=40)  # the end of its recording never comes
    for each in frames():
        killed(each)
    killed.file.flush()
    for cut in (whole[:-1], whole[:-9], whole[:60], whole[:150], Path("b.blf").read_bytes()):
        Path("a.blf").write_bytes(cut)
        said = palpate("bus", "show", "a.blf")
        assert (said.status, "a.blf: damaged: " in said.err) == (1, True), said
    killed.stop()
    with Path("a.pcapng").open("wb") as file:
        writer = PcapngWriter(file)
        writer.write(Packet(1, "clock", Link.NOTE, True, b"1"))
        writer.end()
    ours = Path("a.pcapng").read_bytes()
    for size in (len(ours) - 1, len(ours) // 2, 50):
        Path("a.pcapng").write_bytes(ours[:size])
        assert palpate("bus", "show", "a.pcapng").status == 1


def block(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, 12 + len(body)) + body + struct.pack("<I", 12 + len(body))


SECTION = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
ETHERNET = block(1, struct.pack("<HHI", 1, 0, 0xFFFF))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.pcapng", SECTION + ETHERNET), ("a.pcapng", SECTION + block(1, struct.pack("<HHI", 227, 0, 0))),
        ("a.pcapng", bytes.fromhex("d4c3b2a1 02000400") + bytes(16)), ("a.pcapng", b"#!/bin/sh\n"), ("a.pcapng", b""),
        ("a.log", b"2024-01-01 10:00:00 INFO started\n"), ("a.log", b"  can0  705   [1]  05\n"), ("a.log", bytes(99)),
        ("a.asc", b"ncols 4\nnrows 6\n"), ("a.asc", b""), ("a.blf", b"rubbish"), ("a.blf", b""),
    ],
)  # fmt: skip
def test_what_is_no_log_of_ours_is_called_so_and_not_damaged(name: str, content: bytes, palpate: Palpate) -> None:
    Path(name).write_bytes(content)
    said = palpate("bus", "show", name)
    assert said.status == 2
    assert f"{name}: is no log of palpate's: no " in said.complaint
    assert "damaged" not in said.complaint
