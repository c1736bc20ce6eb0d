"""A bus log by itself: its files and names, the frames of a bus as bytes, and what becomes of a log that fails."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest

from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.logs.bus_log import (
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
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.errors import RecordError
from palpate.simulators.clock import VirtualClock

STARTED = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
STARTED_NS = 1_767_323_045 * 1_000_000_000


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


# --- a log ---------------------------------------------------------------------------------------------


class Clock(VirtualClock):
    """A bench's clock that can be tapped."""

    def tap(self, heard: Callable[[int], object]) -> None:
        self.heard = heard


NODE = CONTRACTS["sensor_node"]


class Bench(SimpleNamespace):
    """A bench with one link of each kind, and what its log listens with."""

    clock: Clock
    links: dict[str, Any]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    taps: dict[str, Callable[..., None]] = {}

    class Modbus(ModbusLink):
        def __init__(self, name: str, serial: bool) -> None:
            self.name, self._serial = name, serial

        @property
        def serial(self) -> bool:
            return self._serial

        def tap(self, heard: Callable[[bool, bytes], object]) -> None:
            taps[self.name] = heard  # type: ignore[assignment]

    class Can(CanLink):
        def __init__(self) -> None:
            self.name = "can"

        def tap(self, heard: Any) -> None:
            taps[self.name] = heard

        def settle(self) -> None:
            """What is told here is told at once."""

    devices = [
        SimpleNamespace(name=name, kind=SimpleNamespace(name=kind, contract=NODE), link=link, unit=unit)
        for name, kind, link, unit in (
            ("left", "oven", "rack", 7),
            ("stage", "stage", "line", 2),
            ("sensor_node_5", "sensor_node", "can", 5),
            ("fan", "fan", "can", 6),
        )
    ]
    return Bench(
        clock=Clock(),
        links={"rack": Modbus("rack", False), "line": Modbus("line", True), "can": Can()},
        description=SimpleNamespace(devices=devices),
        taps=taps,
    )


def log_of(bench: Any, path: Path) -> BusLog:
    return BusLog(bench, bench.clock, path, STARTED)


def frame(identifier: int, data: bytes = b"") -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)


REQUEST = bytes.fromhex("0001 0000 0006 07 03 0000 0002")  # to unit 7


def test_what_travels_is_logged_with_its_time_its_way_and_the_device_it_belongs_to(bench: Any, tmp_path: Path) -> None:
    begun = bench.clock.now_ns()
    with log_of(bench, tmp_path / "t.pcapng") as log:
        log.describe('{"run": 1}')
        bench.taps["rack"](True, REQUEST)
        bench.taps["rack"](False, b"any answer")
        bench.taps["rack"](True, REQUEST[:6] + b"\x09")
        bench.clock.wait(1e-9)
        bench.taps["line"](True, b"\x02\x03")
        bench.taps["line"](False, b"\x09")
        bench.taps["can"](True, frame(0x605, b"a"))
        bench.taps["can"](False, frame(0x706))
        bench.taps["can"](True, frame(0x80))
        bench.clock.heard(17)
    now = STARTED_NS + begun
    assert list(read_pcapng(tmp_path / "t.pcapng")) == [
        Packet(now, "run", Link.NOTE, True, b'{"run": 1}'),
        Packet(now, "left (oven)", Link.TCP, True, REQUEST),
        Packet(now, "left (oven)", Link.TCP, False, b"any answer"),
        Packet(now, "unit 9", Link.TCP, True, REQUEST[:6] + b"\x09"),
        Packet(now + 1, "stage", Link.LINE, True, b"\x02\x03"),
        Packet(now + 1, "stage", Link.LINE, False, b"\x09"),
        Packet(now + 1, "sensor_node", Link.CAN, True, bytes.fromhex("00000605 01 000000 61")),
        Packet(now + 1, "fan", Link.CAN, False, bytes.fromhex("00000706 00 000000")),
        Packet(now + 1, "sensor_node", Link.CAN, True, bytes.fromhex("00000080 00 000000")),
        Packet(now + 1, "clock", Link.NOTE, True, b"17"),
    ]


def test_a_time_of_start_counts_in_whole_seconds(bench: Any, tmp_path: Path) -> None:
    with BusLog(bench, bench.clock, tmp_path / "t.pcapng", STARTED.replace(microsecond=400_000)) as log:
        log.describe("{}")
    (packet,) = read_pcapng(tmp_path / "t.pcapng")
    assert packet.time_ns == STARTED_NS + bench.clock.now_ns()


@pytest.mark.parametrize("failure", [OSError(28, "No space left on device"), ValueError("write to closed file")])
def test_a_log_that_fails_ends_and_the_run_goes_on_until_its_end(
    failure: Exception, bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Packet] = []

    def full(_writer: PcapngWriter, packet: Packet) -> None:
        written.append(packet)
        raise failure

    monkeypatch.setattr(PcapngWriter, "write", full)
    log = log_of(bench, tmp_path / "t.pcapng")
    log.__enter__()
    bench.taps["rack"](True, REQUEST)
    bench.taps["rack"](False, b"answer")
    bench.taps["can"](True, frame(0x601))
    assert len(written) == 1
    with pytest.raises(RecordError, match=r"t\.pcapng: the bus log is incomplete: .*; make room on the disk, and"):
        log.__exit__(None, None, None)


def test_a_failed_log_does_not_hide_the_failure_of_the_run(
    bench: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_writer: PcapngWriter, _packet: Packet) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(PcapngWriter, "write", full)
    with pytest.raises(KeyError, match="the run"), log_of(bench, tmp_path / "t.pcapng") as log:
        log.describe("{}")
        raise KeyError("the run")
