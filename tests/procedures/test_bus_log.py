"""`--log`, `palpate bus show`, `replay` and `scan`: what goes over the buses, in files that other tools read."""

from __future__ import annotations

import json
import re
import struct
import tomllib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import canopen.lss
import pytest
import tomli_w

from palpate import BenchError, RangeError, Run, UsageError
from palpate.drivers.links.can import LssAddress
from palpate.drivers.logs.bus_log import RUN, Link, Packet, PcapngWriter, packed, read_pcapng
from palpate.drivers.scan import FoundDevice
from palpate.extend import read_bench
from palpate.instrument.bench.kinds import all_kinds
from palpate.instrument.bench.links import CanBus, SerialLine, TcpLink
from palpate.instrument.contracts.field import Field, Scaling
from palpate.instrument.contracts.maps.map_file import SHIPPED, read_map
from palpate.procedures.lab import open as session
from palpate.procedures.lab.before import begun_bench
from palpate.procedures.lab.scan import Change, ScanPlan
from palpate.procedures.logs import Conversation, read_log
from palpate.simulators.clock import VirtualClock
from palpate.simulators.devices.twin import Twin
from palpate.simulators.faults import inject
from palpate.simulators.wire.device import SimulatedPlace
from palpate.simulators.wire.modbus import Servers
from tests.contracts import modbus_contract
from tests.procedures.conftest import Palpate


def test_a_sweep_is_logged_whole_and_decoded_with_names_values_and_units(palpate: Palpate) -> None:
    sweep = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
    found = palpate(*sweep, "--log", "trace.asc", "--json").object
    whole, frames = (palpate("bus", "show", f"trace.{kind}", "--json").object["messages"] for kind in ("pcapng", "asc"))
    modbus = [m for m in whole if not re.match("node|all nodes", m["who"])]
    said = [(m["who"], m["text"]) for m in modbus]
    assert {who for who, _ in said} == {"signal_generator", "shaker_amplifier", "strain_indicator", "positioner"}
    owned = "token = 2654435761, counter = 2, order = current_limit, order_value = 5000"
    assert ("shaker_amplifier", f"<- write {owned}") in said
    assert ("positioner", "<- write command = home") in said
    assert any(who == "strain_indicator" and re.search(r"reading = \d\S* mV", text) for who, text in said)
    assert [text[:2] for _, text in said] == ["<-", "->"] * (len(said) // 2)  # each request has its answer
    can_texts = [m["text"] for m in frames]
    assert can_texts == [m["text"] for m in whole if m not in modbus]
    counters = [text for text in can_texts if text.startswith("sample_counter = ")]
    assert counters[0] == "sample_counter = 1, saturation = none"
    assert len(counters) == can_texts.count("SYNC") >= 100
    sent = {"NMT start, node 1", "write sync_period = 0.004 s", "write range_1 = 500 mV", "-> vendor = 1346456656"}
    assert sent <= {*can_texts}
    times, synced = (
        [m["time"] for m in whole if m["text"] in texts] for texts in ({m["text"] for m in whole}, {"SYNC"})
    )
    assert (times, times[-1] - times[0]) == (sorted(times), pytest.approx(found["bench_seconds"], abs=1.0))
    assert min(after - before for before, after in pairwise(synced)) == pytest.approx(0.004, abs=1e-6)  # as was set
    lines = palpate("bus", "show", "trace.pcapng").out.splitlines()
    assert (len(lines), lines[0].split()) == (len(whole), ["0.000000", "shaker_amplifier", "<-", "identify"])


# --- the capture file, byte by byte --------------------------------------------------------------------


def blocks(data: bytes) -> list[tuple[int, bytes]]:
    """Type and body of each block; its length stands before and after it."""
    found = []
    while data:
        kind, size = struct.unpack_from("<II", data)
        assert (size % 4, struct.unpack_from("<I", data, size - 4)) == (0, (size,))
        found.append((kind, data[8 : size - 4]))
        data = data[size:]
    return found


def test_a_capture_file_is_pcapng_with_whole_ip_packets_and_no_damage_to_it_passes(tmp_path: Path) -> None:
    path, time_ns = tmp_path / "c.pcapng", 1_700_000_000_123_456_789
    asked, answer = bytes.fromhex("000100000006 01 03 00000002"), bytes.fromhex("000100000007 01 03 04 12345678")
    packets = [
        Packet(time_ns, "signal_generator", Link.TCP, True, asked),
        Packet(time_ns + 5, "signal_generator", Link.TCP, False, answer),
        Packet(time_ns + 9, "positioner", Link.LINE, True, b"\x02\x03\x00\x00\x00\x01\x84\x39"),
        Packet(time_ns + 9, "sensor_node", Link.CAN, False, b"\0\0\x05\x81\2\0\0\0\1\2"),
        Packet(time_ns + 9, "clock", Link.NOTE, True, b"17"),
    ]
    section, ip, serial, frames, notes, *rest = blocks(captured(path, packets))
    assert section[0] == 0x0A0D0D0A
    assert section[1].startswith(bytes.fromhex("4d3c2b1a 0100 0000 ffffffffffffffff"))
    assert [(kind, body[:2]) for kind, body in (ip, serial, frames, notes)] == [
        (1, bytes([link, 0])) for link in (228, 250, 227, 252)
    ]
    first, second, third, fourth, fifth, _ = (body for kind, body in rest if kind == 6)
    assert struct.unpack_from("<III", first) == (0, time_ns >> 32, time_ns & 0xFFFFFFFF)
    header, tcp = first[20:40], first[40:60]
    total = sum(struct.unpack(">10H", header))
    assert (total & 0xFFFF) + (total >> 16) == 0xFFFF  # the check sum is in it
    assert int.from_bytes(header[2:4]) == 40 + len(asked) == struct.unpack_from("<I", first, 12)[0]
    assert struct.unpack(">HHII", tcp[:12]) == (50_000, 502, 1, 1)
    assert struct.unpack(">HHII", second[40:52]) == (502, 50_000, 1, 1 + len(asked))
    assert (first[60 : 60 + len(asked)], struct.unpack_from("<I", third)[0]) == (asked, 1)
    assert third[20 + 12 :].startswith(packets[2].data)
    assert fourth[20:30] == packets[3].data
    assert fifth[20:38] == bytes.fromhex("000c 0004") + b"json" + bytes(4) + b"17" + bytes(2) + bytes.fromhex("0100")
    assert list(read_pcapng(path)) == packets
    whole = path.read_bytes()
    for at in range(0, len(whole), 5):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 4]) + whole[at + 1 :])
        with suppress(ValueError, struct.error):
            assert list(read_pcapng(path)) == packets  # around the hash itself a bit may not count
        path.write_bytes(whole[:at])
        with pytest.raises((ValueError, struct.error)):
            list(read_pcapng(path))


# --- bad input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("log", "status", "names"),
    [
        ("trace.pcap", 2, ("--log trace.pcap", ".blf")),
        ("t.blf", 2, ("t.pcapng exists",)),
        ("no/t.blf", 1, ("no/t.blf",)),
    ],
)
def test_a_log_of_another_format_in_the_place_of_another_or_that_cannot_be_written_starts_nothing(
    palpate: Palpate, log: str, status: int, names: tuple[str, ...]
) -> None:
    Path("t.pcapng").touch()
    said = palpate("sweep", "loads", "--log", log)
    assert (said.status, [name for name in names if name not in said.complaint]) == (status, [])
    assert not Path("runs").exists()


def test_a_run_whose_log_ends_before_it_is_complete_and_that_is_said_at_its_end(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Packet] = []

    def full(_writer: PcapngWriter, packet: Packet) -> None:
        written.append(packet)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PcapngWriter, "write", full)
    sweep = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
    said = palpate(*sweep, "--log", "t.blf", "--out", "day")
    assert said.status == 1
    assert "t.blf: the bus log is incomplete: " in said.complaint and "No space left" in said.complaint
    assert "the run is kept in day; look at it with palpate runs show" in said.complaint
    assert (Run.open(Path("day")).status, len(written)) == ("complete", 1)
    assert not [f for f in Path("/dev/fd").iterdir() if f.is_symlink() and str(tmp_path) in str(f.readlink())]


# --- logs of any program: each kind of frame is called what it is, and a cut log is told --------------

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


def test_a_log_of_candump_is_read_and_one_channel_takes_no_column(palpate: Palpate) -> None:
    messages = shown(palpate, "a.log", CANDUMP)
    assert [(m["who"], m["text"]) for m in messages] == [*TEXTS, ("bus", "CAN FD frame 0x123: 11 22 33")]
    assert [m["channel"] for m in messages] == ["can0", "can0", "can0", "can0", "vcan1", "can0"]
    shown(palpate, "a.log", CANDUMP.replace("vcan1", "can0"))
    assert palpate("bus", "show", "a.log").out.splitlines()[3].split()[:3] == ["0.300000", "node", "5"]


def captured(path: Path, packets: Iterable[Packet]) -> bytes:
    with path.open("wb") as file:
        writer = PcapngWriter(file)
        for packet in packets:
            writer.write(packet)
        writer.end()
    return path.read_bytes()


def test_a_blf_file_and_our_own_capture_show_the_same(palpate: Palpate) -> None:
    blf(Path("a.blf"))
    packets = (Packet(round(each.timestamp * 1e9), "node", Link.CAN, False, packed(each)) for each in frames())
    captured(Path("a.pcapng"), packets)
    for name in ("a.blf", "a.pcapng"):
        messages = palpate("bus", "show", name, "--json").object["messages"]
        assert [(m["who"], m["text"]) for m in messages] == TEXTS


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
    whole, ours = blf(Path("a.blf")), captured(Path("a.pcapng"), [Packet(1, "clock", Link.NOTE, True, b"1")])
    killed = can.BLFWriter("b.blf", max_container_size=40)  # the end of its recording never comes
    for each in frames():
        killed(each)
    killed.file.flush()
    cuts = {"a.blf": (whole[:-1], whole[:-9], whole[:60], whole[:150], Path("b.blf").read_bytes())}
    cuts["a.pcapng"] = (ours[:-1], ours[: len(ours) // 2], ours[:50])
    for name, content in [(each, cut) for each in cuts for cut in cuts[each]]:
        Path(name).write_bytes(content)
        said = palpate("bus", "show", name)
        assert (said.status, f"{name}: damaged: " in said.err) == (1, True), said
    killed.stop()


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


# --- makers' devices: fields by name, with the scales and signs that went by before ---------------------

THING = modbus_contract(
    Field("status", 6, "uint16", "status", bits={"negative": 7, "ready": 3}),
    Field("load", 7, "uint32", "load", "N", sign=("status", "negative"), scaling=Scaling("decimals")),
    Field("decimals", 13, "uint16", "decimals", minimum=0, maximum=4),
    Field("mean", 14, "int16", "mean", "N", missing=(-1,)),
    Field("low", 16, "uint16", "low half", part=(0, 8)),
    Field("high", 16, "uint16", "high half", part=(8, 8)),
    Field("order", 20, "uint16", "order", access="rw", choices={"none": 0, "start": 1}, function=6),
    Field("heat", 9, "int16", "temperature", "degC", scale=0.1, table="input"),
    Field("remote", 402, "bool", "remote control", table="coil", access="rw"),
    Field("output", 403, "bool", "output", table="coil", access="rw"),
    Field("closed", 5, "bool", "contact", table="discrete"),
    known_by="nothing",
)


def said(*frames: str) -> list[str]:
    """The texts of a request, its reply, the next request and so on."""
    talk = Conversation(THING)
    return [talk.pdu(bytes.fromhex(frame), sent=number % 2 == 0) for number, frame in enumerate(frames)]


def test_a_scale_and_a_sign_are_those_that_went_by_before_and_else_are_said_to_be_unknown() -> None:
    texts = said("03 000D 0001", "03 02 0002", "03 0006 0003", "03 06 0080 000004D2")
    assert texts[1:] == ["decimals = 2", "read status, load", "status = negative, load = -12.34 N"]
    assert said("03 0007 0002", "03 04 000004D2")[1] == "load = 00 00 04 d2 (its scale or sign is not known here)"


@pytest.mark.parametrize(
    ("request_", "reply", "texts"),
    [
        ("04 0009 0001", "04 02 00D7", ["read heat", "heat = 21.5 degC"]),
        ("02 0005 0001", "02 01 01", ["read closed", "closed = 1"]),
        ("01 0192 0002", "01 01 02", ["read remote, output", "remote = 0, output = 1"]),
        ("05 0192 FF00", "05 0192 FF00", ["write remote = 1", "written"]),
        ("05 0192 0000", "05 0192 0000", ["write remote = 0", "written"]),
        ("0F 0192 0002 01 02", "0F 0192 0002", ["write remote = 0, output = 1", "written"]),
        ("06 0014 0001", "06 0014 0001", ["write order = start", "written"]),
        ("03 000E 0001", "03 02 FFFF", ["read mean", "mean = no reading"]),
        ("03 0010 0001", "03 02 0102", ["read low, high", "low = 2, high = 1"]),
        ("03 0064 0002", "03 04 0102 0304", ["read 2 from 0x0064", "0x0064: 01 02 03 04"]),
        ("06 0064 0007", "06 0064 0007", ["write 0x0064: 00 07", "written"]),
        ("03 0064 0001", "83 02", ["read 1 from 0x0064", "exception 2, illegal address"]),
    ],
)
def test_every_function_shows_fields_by_name(request_: str, reply: str, texts: list[str]) -> None:
    assert said(request_, reply) == texts


@pytest.mark.parametrize(
    ("identifier", "data", "text"),
    [
        (0x58A, "43 02 64 01 2C 01 00 00", "-> 0x6402:1 = 2c 01 00 00"),
        (0x60A, "2B 02 64 01 2C 01 00 00", "write 0x6402:1 = 2c 01"),
        (0x60A, "40 02 64 01 00 00 00 00", "read 0x6402:1"),
        (0x58A, "60 02 64 01 00 00 00 00", "written 0x6402:1"),
        (0x3CA, "01 FF", "0x3CA: 01 ff"),
        (0x3CA, "", "0x3CA"),
    ],
)
def test_an_object_or_message_that_no_contract_has_is_shown_with_its_value(
    tmp_path: Path, identifier: int, data: str, text: str
) -> None:
    log = tmp_path / "bus.log"
    log.write_text(f"(0.000000) can0 {identifier:03X}#{data.replace(' ', '')}\n")
    (line,) = read_log(log)
    assert line.text == text


def test_a_laboratorys_map_is_found_by_the_runs_header_if_it_is_still_the_same(tmp_path: Path) -> None:
    path = tmp_path / "oven.toml"
    path.write_text(
        '[device]\nname = "my-oven"\ntitle = "Oven"\nbus = "modbus"\nlinks = ["modbus-tcp"]\nvendor = "M"\n'
        'known_by = "nothing"\n[field.heat]\naddress = 1\ntype = "uint16"\nmeaning = "heat"\nunit = "degC"\n'
    )
    asked = Packet(1, "oven (my-oven)", Link.TCP, True, bytes(7) + bytes.fromhex("03 0001 0001"))
    for digest, text in ((read_map(path).sha256, "<- read heat"), ("0" * 64, "<- read 1 registers from 0x0001")):
        header = {"bench": f'[device.oven]\nmap = "{path}"\n', "maps": {"my-oven": digest}}
        captured(log := tmp_path / "bus.pcapng", [Packet(0, RUN, Link.NOTE, True, json.dumps(header).encode()), asked])
        assert [line.text for line in read_log(log)] == [text]


# --- a recorded run done again on the traffic of its log ----------------------------------------------

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
LOG = Path("trace.pcapng")


def same_again(palpate: Palpate, monkeypatch: pytest.MonkeyPatch, *command: str) -> tuple[Run, Run]:
    """A run that is logged, and its replay, which needs no bench and has the same points to the byte."""
    said = palpate(*command, "--log", "trace.blf", "--out", "first", "--quiet")
    assert said.status == 0, said.err
    monkeypatch.setattr(session, "simulated_bench", lambda *_: pytest.fail("a replay needs no bench"))
    said = palpate("bus", "replay", "trace.blf", "--out", "second", "--quiet")
    assert (said.status, said.out) == (0, ""), said.err
    first, second = Run.open(Path("first")), Run.open(Path("second"))
    assert first.digest() == second.digest()
    return first, second


def test_a_run_without_an_optional_device_is_replayed_without_it(
    palpate: Palpate, lab: str, closed_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tables = tomllib.loads(Path(lab).read_text(encoding="utf-8"))
    tables["link"]["far"] = {"kind": "modbus-tcp", "host": "127.0.0.1", "port": closed_port}
    tables["device"]["ring"] = {"kind": "sample_changer", "link": "far", "unit": 1, "optional": True}
    Path(lab).write_text(tomli_w.dumps(tables), encoding="utf-8")
    _, second = same_again(palpate, monkeypatch, *SWEEP, "--bench", lab, "--assume-mounted")
    assert [event["kind"] for event in second.events()] == ["caution"]


@pytest.mark.slow
def test_a_replay_of_a_noisy_bench_that_failed_once_has_the_same_points_and_incidents(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Transfers over TCP, the line and CAN take their time here, and once the generator does not answer."""
    monkeypatch.setattr(inject, "TIMEOUT", "2 s")  # as outside of tests: what a busy machine delays is no second fault
    scene = Path(session.__file__).parents[2] / "simulators" / "scenes" / "noisy_lab.toml"
    fault = '\n[[fault]]\nkind = "no_reply"\non = "signal_generator"\ntransaction = 12\n'
    Path("faulty.toml").write_text(scene.read_text() + fault)
    first, second = same_again(palpate, monkeypatch, *SWEEP, "--scene", "faulty.toml", "--seed", "3")
    assert (
        [(e["bench_ns"], e["kind"]) for e in first.events()]
        == [(e["bench_ns"], e["kind"]) for e in second.events()]
        != []
    )
    assert (first.summary, first.simulated) == (second.summary, second.simulated)
    assert second.header["replayed"] == "trace.pcapng"
    same = ("procedure", "started", "settings", "scene", "seed", "bench", "calibration")
    assert [first.header[key] for key in same] == [second.header[key] for key in same]


@pytest.mark.slow
def test_a_replayed_calibration_replaces_none(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    weights = ("calibrate", "load-cell", "--loads", "1 N, 2 N, 3 N", "--runs", "2")
    same_again(palpate, monkeypatch, *weights)
    assert Path("second/calibration.toml").exists()
    (kept,) = Path("runs/calibrations").iterdir()
    assert kept.read_bytes() == Path("first/calibration.toml").read_bytes()


# --- what cannot be replayed ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (None, ""), (b"", ""), (bytes(40), ""), ("{}", "bench"), ('{"bench": "", "procedure": 1}', "name"),
        ("[]", "run"), ("{", "run"),
    ],
)  # fmt: skip
def test_what_is_no_log_or_one_of_another_palpate_is_named(
    palpate: Palpate, content: bytes | str | None, name: str
) -> None:
    if isinstance(content, str):
        captured(LOG, [Packet(0, RUN, Link.NOTE, True, content.encode())])
    elif content is not None:
        LOG.write_bytes(content)
    said = palpate("bus", "replay", "trace.pcapng")
    assert (said.status, "trace.pcapng" in said.complaint, name in said.complaint) == (2, True, True)


# --- `palpate bus scan` and `bus lss`: what a scan tells, the bench file that it begins, and no --------


OVEN = """
[device]
name = "my-oven"
title = "My oven"
bus = "modbus"
links = ["modbus-tcp", "modbus-rtu"]
vendor = "Maker"
known_by = "marks"
serial = "number"

[[mark]]
field = "model"
value = 77

[field.model]
address = 0
type = "uint16"
meaning = "number of the model"

[field.number]
address = 1
type = "uint16"
meaning = "serial number"
"""


@pytest.fixture
def oven(tmp_path: Path) -> Iterator[tuple[Path, int]]:
    """The map of an oven, and the port at which its twin answers, whatever the unit id."""
    path = tmp_path / "oven.toml"
    path.write_text(OVEN)
    kind: Any = SimpleNamespace(contract=read_map(path).contract)
    rig: Any = None
    twin = Twin.at(SimulatedPlace(VirtualClock(), rig, 1, "SIM-OV-0042", None, kind, lambda _role: None))
    with Servers() as servers:
        yield path, servers.serve_tcp(1, twin)


@pytest.mark.parametrize(("units", "found"), [("1-2", 1), ("255", 255), ("0", 0), ("3-4", 0)])
def test_a_device_is_found_with_its_map_or_at_its_address_itself_and_the_bench_file_can_be_used(
    palpate: Palpate, oven: tuple[Path, int], units: str, found: int
) -> None:
    path, port = oven
    scan = ("bus", "scan", f"--tcp=127.0.0.1:{port}", f"--units={units}", f"--map={path}", "--out=begun.toml")
    (device,) = palpate(*scan, "--json").object["devices"]
    assert (device["unit"], device["fits"], device["serial"]) == (found, ["my-oven"], "42")
    (listed,) = read_bench(Path("begun.toml")).devices
    assert (listed.kind.name, listed.unit) == ("my-oven", found)


def test_what_is_impossible_is_refused_before_anything_is_sent(palpate: Palpate) -> None:
    for arguments, message in (
        (["--units=0-3", "--line=/dev/null"], "0 is asked by itself where no other answers"),
        (["--units=4-2", "--tcp=localhost"], "is not within 0 to 247 and 255"),
        (["--units=255", "--line=/dev/null"], "is not within 1 to 247"),
        (["--nodes=128", "--can=virtual:x"], "is not within 1 to 127"),
        ([], "nothing to search"),
        (["--tcp=a b:c:d"], "is no address"),
        (["--tcp=host:70000"], "70000"),
        (["--line=/dev/null", "--line=/dev/null"], "is given twice"),
        (["--line=/dev/null", "--baudrates=fast"], "'fast' is no rate"),
        (["--line=/dev/null", "--baudrates=299"], "299"),
        (["--line=/dev/null", "--parities=X"], "'X' is no parity"),
        (["--tcp=localhost", "--timeout=0 s"], "--timeout 0 s is outside"),
        (["--can=gs_usb:0"], "cannot be told only to listen"),
        (["--can=gs_usb:0", "--talk"], "speaks at one bit rate"),
    ):
        spoken = palpate("bus", "scan", *arguments)
        assert (spoken.status, message in spoken.err) == (2, True), arguments


def test_of_kinds_that_a_device_could_be_a_map_of_ones_own_is_told_first_and_named_by_its_file(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    text = (SHIPPED / "seneca-z-sg2.toml").read_text(encoding="utf-8")
    file.write_text(text.replace('"seneca-z-sg2"', '"mine"').replace('"Z-SG2"', '"Mine"'), encoding="utf-8")
    kinds = ScanPlan.asked(
        tcp=["localhost"], lines=[], can=None, units="1", nodes="1", baudrates=None, parities=None, every=False,
        bitrates=None, listen=1.0, talk=False, timeout=0.2, within=60.0, maps=[file],
    ).kinds  # fmt: skip
    could_be = tuple(kind.name for kind in kinds if kind.name in ("laumas-tlb4", "mine"))
    assert could_be == ("mine", "laumas-tlb4")
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    assert f'# map = "{file}"\n' in begun_bench([FoundDevice("modbus-rtu", line, 4, candidates=could_be)], kinds)


def test_a_bench_file_lists_what_is_known_and_comments_on_the_rest() -> None:
    line = SerialLine(port="/dev/ttyS9", baudrate=9600)
    tcp = TcpLink(host="rig.lab")
    text = begun_bench(
        [
            FoundDevice("modbus-tcp", tcp, 1, "Palpate SG-1", "1", ("signal_generator",)),
            FoundDevice("modbus-rtu", line, 4, "", "", (), ("flintec-dad-141",)),
            FoundDevice("modbus-rtu", line, 5, "Acme 9000"),
        ],
        all_kinds(),
    )
    assert 'kind = "signal_generator"\nlink = "tcp"\nunit = 1\n' in text
    assert "# unit 4 on line answers, and is not known: it tells nothing\n# could be: flintec-dad-141\n" in text
    assert "# unit 5 on line answers, and is not known: Acme 9000\n# could be: no kind that has a map\n" in text
    assert '# port = "/dev/ttyS9"' in text
    assert begun_bench([], []).startswith("# no device is known yet")


# --- node id and bit rate by LSS: one device by its whole identity, and nothing without agreement -----

ADDRESS = LssAddress(0x26C, 0x10, 0x06720000, 1234)
SELECTS = range(0x40, 0x44)


class Slave:
    """An LSS device after CiA 305, in plain python-can; `node` answers an SDO upload as well."""

    def __init__(self, bus: can.BusABC, node: int, refuses: int = 0) -> None:
        self._bus = bus
        self._given: list[int] = []
        self.configuring = False
        self._refuses = refuses
        self.node = node
        self.written: list[tuple[int, ...]] = []

    def on_message(self, message: can.Message) -> None:
        data = bytes(message.data)
        if message.arbitration_id == 0x600 + self.node:
            self._send(0x580 + self.node, b"\x80" + data[1:4] + bytes(4))
        if message.arbitration_id != 0x7E5:
            return
        code = data[0]
        if code == 0x04:
            self.configuring = bool(data[1])
        elif code in SELECTS:
            self._given = [*(self._given if code > 0x40 else []), struct.unpack_from("<I", data, 1)[0]]
            if LssAddress(*(self._given + [0] * 4)[:4]) == ADDRESS:
                self.configuring = True
                self._send(0x7E4, b"\x44" + bytes(7))
        elif self.configuring and code == 0x5E:
            self._send(0x7E4, bytes([code, self.node, *bytes(6)]))
        elif self.configuring:
            self.written.append(tuple(data[:3]))
            self._send(0x7E4, bytes([code, self._refuses, *bytes(6)]))

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[can.BusABC]:
    monkeypatch.setattr(canopen.lss.time, "sleep", lambda _seconds: None)
    with can.Bus(interface="virtual", channel="lss") as bus:
        yield bus


def change(node: int | None = 5, bitrate: int | None = None, timeout: str = "10 s", **more: Any) -> Change:
    link = CanBus(interface="virtual", channel="lss", timeout=timeout)  # type: ignore[arg-type]
    return Change(link, more.get("address", ADDRESS), node, bitrate, more.get("save", False))


def carried_out(
    bus: can.BusABC, slaves: list[Slave], wanted: Change, agrees: Callable[[str], None] | None = None
) -> tuple[int | None, list[str]]:
    asked: list[str] = []
    notifier = can.Notifier(bus, [slave.on_message for slave in slaves], timeout=0.01)
    try:
        return wanted.carry_out(agrees or asked.append), asked
    finally:
        notifier.stop()


def test_a_node_id_a_bit_rate_and_the_order_to_keep_them_go_to_the_device_by_its_identity(bus: can.BusABC) -> None:
    slave = Slave(bus, 5)
    before, asked = carried_out(bus, [slave], change(5, 500_000, save=True))
    assert (before, slave.written) == (5, [(0x11, 5, 0), (0x13, 0, 2), (0x17, 0, 0)])
    assert "gets node id 5 and 500000 bit/s, and keeps it when it is switched off (it has node id 5 now)" in asked[0]


def test_nothing_is_written_before_a_person_agrees_and_nothing_kept_unless_it_is_asked_for(bus: can.BusABC) -> None:
    def never(_what: str) -> None:
        raise KeyboardInterrupt

    slave = Slave(bus, 5)
    with pytest.raises(KeyboardInterrupt):
        carried_out(bus, [slave], change(5), never)
    assert (slave.written, slave.configuring) == ([], False)
    carried_out(bus, [slave], change(5))
    assert slave.written == [(0x11, 5, 0)]


def test_a_device_that_is_not_there_one_that_refuses_and_a_node_id_that_is_taken_are_told(bus: can.BusABC) -> None:
    other, slave = LssAddress(0x26C, 0x10, 0x06720000, 1), Slave(bus, 255)
    for slaves, wanted, message in (
        (
            [Slave(bus, 5)],
            change(address=other, timeout="20 ms"),
            "26Ch 10h 6720000h 1h on virtual:lss does not answer",
        ),
        ([Slave(bus, 5, refuses=1)], change(5), r"refuses to take node id 5 \(LSS Error: 1\)"),
        ([slave, Slave(bus, 7)], change(7), "node 7 answers already on virtual:lss; give another --node"),
    ):
        with pytest.raises(BenchError, match=message):
            carried_out(bus, slaves, wanted)
    assert slave.written == []


@pytest.mark.parametrize(
    ("wanted", "error", "message"),
    [
        ({"node": None}, UsageError, "nothing to set"),
        ({"node": 128}, RangeError, "--node 128 is outside 1 to 127"),
        ({"node": None, "bitrate": 333_333, "save": True}, RangeError, "LSS knows 1000000, 800000"),
        ({"node": None, "bitrate": 500_000}, UsageError, "give --save, too"),
    ],
)
def test_what_cannot_be_set_is_refused_before_the_bus_is_opened(
    wanted: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        change(**wanted)
