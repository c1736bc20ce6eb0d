"""`--log` and `palpate bus show`: what went over the buses, in files that other tools read."""

from __future__ import annotations

import re
import struct
from contextlib import suppress
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import pytest

from palpate.drivers.bench import Bench
from palpate.drivers.logs.bus_log import BusLog, Link, Packet, PcapngWriter, read_pcapng
from palpate.instrument.errors import RecordError
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import Palpate, Spoken


def shown(palpate: Palpate, file: str) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = palpate("bus", "show", file, "--json").object["messages"]
    return messages


def test_a_sweep_is_logged_whole_and_decoded_with_names_values_and_units(palpate: Palpate) -> None:
    sweep = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")
    found = palpate(*sweep, "--log", "trace.asc", "--json").object
    whole = shown(palpate, "trace.pcapng")
    modbus = [m for m in whole if not re.match("node|all nodes", m["who"])]
    said = [(m["who"], m["text"]) for m in modbus]
    assert {who for who, _ in said} == {"signal_generator", "shaker_amplifier", "strain_indicator", "positioner"}
    owned = "token = 2654435761, counter = 2, order = current_limit, order_value = 5000"
    assert ("shaker_amplifier", f"<- write {owned}") in said
    assert ("positioner", "<- write command = home") in said
    assert any(who == "strain_indicator" and re.search(r"reading = \d\S* mV", text) for who, text in said)
    assert [text[:2] for _, text in said] == ["<-", "->"] * (len(said) // 2)  # each request has its answer
    can_texts = [m["text"] for m in shown(palpate, "trace.asc")]
    assert can_texts == [m["text"] for m in whole if m not in modbus]
    counters = [text for text in can_texts if text.startswith("sample_counter = ")]
    assert counters[0] == "sample_counter = 1, saturation = none"
    assert len(counters) == can_texts.count("SYNC") >= 100
    for text in (
        "NMT start, node 1",
        "write sync_period = 0.004 s",
        "write range_1 = 500 mV",
        "-> vendor = 1346456656",
    ):
        assert text in can_texts
    times = [m["time"] for m in whole]
    assert times == sorted(times)
    synced = [m["time"] for m in whole if m["text"] == "SYNC"]
    periods = [after - before for before, after in pairwise(synced)]
    assert min(periods) == pytest.approx(0.004, abs=1e-6)  # the period that was set
    lines = palpate("bus", "show", "trace.pcapng").out.splitlines()
    assert len(lines) == len(whole)
    assert lines[0].split() == ["0.000000", "shaker_amplifier", "<-", "identify"]
    assert times[-1] - times[0] == pytest.approx(found["bench_seconds"], abs=1.0)


def logged_frames(sim: SimulatedBench, path: Path) -> list[can.Message]:
    """What a bench that is opened, and no more, sends; as a log holds it."""
    bench = Bench(sim.description, sim.clock, sim.operator)
    with BusLog(bench, sim.clock, path, datetime(2026, 1, 2, tzinfo=UTC)), bench:
        pass
    with can.LogReader(path) as reader:
        return list(reader)


def test_both_formats_hold_the_same_frames(sim: SimulatedBench, tmp_path: Path) -> None:
    binary, text = (logged_frames(sim, tmp_path / name) for name in ("a.blf", "b.asc"))
    assert len(binary) > 20
    assert [(f.arbitration_id, bytes(f.data)) for f in binary] == [(f.arbitration_id, bytes(f.data)) for f in text]
    requests = [f for f in binary if f.arbitration_id == 0x601]
    assert len(requests) >= 10
    assert all(len(f.data) == 8 for f in requests)


# --- the capture file, byte by byte --------------------------------------------------------------------


def blocks(data: bytes) -> list[tuple[int, bytes]]:
    """Type and body of each block; its length stands before and after it."""
    found = []
    while data:
        kind, size = struct.unpack_from("<II", data)
        assert size % 4 == 0
        assert struct.unpack_from("<I", data, size - 4) == (size,)
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
    with path.open("wb") as file:
        writer = PcapngWriter(file)
        for packet in packets:
            writer.write(packet)
        writer.end()
    section, ip, serial, frames, notes, *rest = blocks(path.read_bytes())
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
    assert first[60 : 60 + len(asked)] == asked
    assert struct.unpack_from("<I", third)[0] == 1
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


def failed(said: Spoken, status: int, *names: str) -> None:
    assert said.status == status
    for name in names:
        assert name in said.complaint, said.complaint


def test_a_log_of_another_format_or_in_the_place_of_another_starts_nothing(palpate: Palpate) -> None:
    failed(palpate("sweep", "loads", "--log", "trace.pcap"), 2, "--log trace.pcap", ".blf")
    Path("t.pcapng").touch()
    failed(palpate("sweep", "loads", "--log", "t.blf"), 2, "t.pcapng exists")
    assert not Path("runs").exists()


def test_a_log_that_cannot_be_written_starts_nothing(palpate: Palpate) -> None:
    failed(palpate("sweep", "loads", "--log", "no/trace.blf"), 1, "no/trace.blf", "--log")


@pytest.mark.parametrize(
    ("name", "data", "status"),
    [
        ("gone.blf", None, 2), ("gone.asc", None, 2), ("gone.pcapng", None, 2), ("x.txt", b"", 2),
        ("x.blf", b"rubbish", 2), ("x.blf", bytes(200), 2), ("x.pcapng", b"", 2), ("x.pcapng", bytes(40), 2),
        ("x.pcapng", b"\n\r\r\n\x1c\0\0\0M<+\x1a" + bytes(40), 2),
    ],
)  # fmt: skip
def test_what_is_no_log_is_named(palpate: Palpate, name: str, data: bytes | None, status: int) -> None:
    if data is not None:
        Path(name).write_bytes(data)
    failed(palpate("bus", "show", name), status, name)


@pytest.mark.slow  # a whole sweep
def test_a_run_whose_log_ends_before_it_is_complete_and_named(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_writer: PcapngWriter, _packet: Packet) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PcapngWriter, "write", full)
    said = palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--log", "t.blf", "--out", "day")
    failed(said, 1, "t.blf: the bus log is incomplete: ", "the run is kept in day; look at it with palpate runs show")
    assert Run.open(Path("day")).status == "complete"


def test_a_log_that_ends_before_its_run_is_said_at_the_end(
    sim: SimulatedBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Packet] = []

    def full(_writer: PcapngWriter, packet: Packet) -> None:
        written.append(packet)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PcapngWriter, "write", full)
    with pytest.raises(RecordError, match=r"the bus log is incomplete: .*No space left"):
        logged_frames(sim, tmp_path / "a.blf")
    assert len(written) == 1
    assert not [f for f in Path("/dev/fd").iterdir() if f.is_symlink() and str(tmp_path) in str(f.readlink())]
