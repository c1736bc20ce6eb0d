"""Logs of a run's traffic in formats that other tools read: all of it as pcapng, and CAN also as BLF or ASC."""

from __future__ import annotations

import stat
import struct
import threading
from collections.abc import Callable, Iterator
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, Self

import can

from palpate.drivers.bench import Bench
from palpate.drivers.clock import Clock
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.logs.pcapng import Link, Packet, PcapngWriter
from palpate.instrument.bench.can_block import time_of
from palpate.instrument.bench.description import Listed
from palpate.instrument.contracts import sensor_node
from palpate.instrument.errors import RecordError, UsageError, check_path
from palpate.instrument.own_process import Ends

CAN_FORMATS = (".blf", ".asc")
CANDUMP = ".log"  # is read, and not written
WHOLE_FORMAT = ".pcapng"
READ = (WHOLE_FORMAT, *CAN_FORMATS, CANDUMP)
UNIT_ON_TCP, UNIT_ON_LINE = 6, 0  # index of the unit id in a frame
CLOCK, RUN = "clock", "run"  # two notes: a time that the program read from the bench's clock [ns]; the run's header
NODES = sensor_node.CONTRACT.name
NODE_ID = 0x7F  # bits of an identifier that hold the node id (CiA 301)
FRAME = struct.Struct(">IB3x")  # Linux' struct can_frame up to its data
EXTENDED, REMOTE, ERROR = 1 << 31, 1 << 30, 1 << 29


def check_log(path: Path) -> None:
    """Check that a log can be written.

    Raises:
        UsageError: CAN traffic has no such format, or a file of that name exists.
        RecordError: no file can be made there.
    """
    check_path(path)
    if path.suffix.lower() not in (*CAN_FORMATS, WHOLE_FORMAT):
        formats = f"{WHOLE_FORMAT} (everything), {' or '.join(CAN_FORMATS)} (CAN)"
        raise UsageError(f"--log {path}: the name must end in {formats}")
    for file in log_files(path):
        try:
            file.touch(exist_ok=False)
            file.unlink()
        except FileExistsError:
            raise UsageError(f"--log {path}: {file} exists already; give another name") from None
        except OSError as error:
            raise _unwritable(path, error) from None


def logged(path: Path) -> Path:
    """Check the path of a log to read, and return it. Raises UsageError: the suffix is wrong, or it is no file."""
    check_path(path)
    if path.suffix.lower() not in READ:
        raise UsageError(f"{path}: no bus log, whose name would end in {', '.join(READ)}; check the name")
    try:
        kind = path.stat().st_mode
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error
    if not stat.S_ISREG(kind):
        raise UsageError(f"{path}: is no file, so no bus log; check the name")
    return path


def log_files(path: Path) -> list[Path]:
    """The files of a log: the whole log and, if `path` names a CAN format, one for CAN."""
    whole = path.with_suffix(WHOLE_FORMAT)
    return [path] if path.suffix.lower() == WHOLE_FORMAT else [whole, path]


def _unwritable(path: Path, error: OSError) -> RecordError:
    return RecordError(f"{path}: the bus log cannot be written: {error.strerror or error}; choose another --log")


def called(device: Listed) -> str:
    """Name of a device in logs: its own name, followed by its kind if that is different."""
    name, kind = device.name, device.kind.name
    return kind if kind in (name, NODES) else f"{name} ({kind})"


def kind_called(who: str) -> str:
    """The kind of a device, from its name in a log."""
    return who.partition(" (")[2].removesuffix(")") or who


def modbus_links(bench: Bench) -> Iterator[tuple[str, ModbusLink, Link, Callable[[bytes], str]]]:
    """Each Modbus link of a bench: its name, the link, its kind, and a function that names the device of a request."""
    for name, link in bench.links.items():
        if isinstance(link, ModbusLink):
            place = UNIT_ON_LINE if link.serial else UNIT_ON_TCP
            names = {device.unit: called(device) for device in bench.description.devices if device.link == name}

            def whom(data: bytes, names: dict[int, str] = names, place: int = place) -> str:
                return names.get(data[place], f"unit {data[place]}")

            yield name, link, Link.LINE if link.serial else Link.TCP, whom


def can_links(bench: Bench) -> list[tuple[CanLink, Callable[[bytes], str]]]:
    """Each CAN link of a bench, and a function that names the device that a packed frame belongs to."""
    found: list[tuple[CanLink, Callable[[bytes], str]]] = []
    for name, link in bench.links.items():
        if isinstance(link, CanLink):
            devices = [device for device in bench.description.devices if device.link == name]
            names = {device.unit: called(device) for device in devices}
            of_pdo = {
                pdo.cob_id(device.unit): called(device)
                for device in devices
                for pdo in (*device.kind.contract.pdos, *device.kind.contract.receives)
            }

            def whom(data: bytes, names: dict[int, str] = names, of_pdo: dict[int, str] = of_pdo) -> str:
                identifier = FRAME.unpack_from(data)[0]
                return of_pdo.get(identifier) or names.get(identifier & NODE_ID, NODES)

            found.append((link, whom))
    return found


def packed(frame: can.Message) -> bytes:
    """A CAN frame as bytes in Linux' format (struct can_frame)."""
    flags = (EXTENDED, frame.is_extended_id), (REMOTE, frame.is_remote_frame), (ERROR, frame.is_error_frame)
    return FRAME.pack(frame.arbitration_id | sum(bit for bit, is_set in flags if is_set), frame.dlc) + frame.data


def unpacked(data: bytes) -> can.Message:
    """The CAN frame from bytes in Linux' format (struct can_frame)."""
    identifier, size = FRAME.unpack_from(data)
    return can.Message(
        arbitration_id=identifier & ~(EXTENDED | REMOTE | ERROR),
        is_extended_id=bool(identifier & EXTENDED),
        is_remote_frame=bool(identifier & REMOTE),
        is_error_frame=bool(identifier & ERROR),
        dlc=size,
        data=data[FRAME.size :],
    )


class BusLog:
    """A context manager that logs the traffic of a bench; enter it before the bench.

    The log holds the program's actions in their order: what it sends, each reply, and each reading of the clock. A CAN
    frame comes before the actions that follow from it. What nodes of a simulated bench send has its own time.

    Args:
        bench: the bench, not open yet.
        clock: the bench's clock; a message has the time `started` plus the clock's time.
        path: the file; its suffix chooses the format.
        started: when the run began.
    """

    def __init__(self, bench: Bench, clock: Clock, path: Path, started: datetime) -> None:
        self._path = path
        self._bench = bench
        self._clock = clock
        self._begun_ns = round(started.timestamp()) * 1_000_000_000
        self._lock = threading.RLock()  # held from the time stamp to the write: both files are in the order of time
        self._stack = Ends()
        self._failure: Exception | None = None

    def __enter__(self) -> Self:
        whole, *frames = log_files(self._path)
        try:
            with Ends() as stack:
                file = stack.enter_context(whole.open("wb"))
                stack.close_in_child(file.fileno())
                self._whole = PcapngWriter(file)
                self._frames: list[Any] = [can.Logger(file) for file in frames]
                for log in self._frames:
                    stack.close_in_child(log.file.fileno())
                    stack.callback(log.stop)
                self._stack = stack.pop_all()
        except OSError as error:
            raise _unwritable(self._path, error) from error
        for _, modbus, kind, whom in modbus_links(self._bench):
            self._listen(modbus, kind, whom)
        for channel, (link, of) in enumerate(can_links(self._bench)):
            link.tap(partial(self._heard_frame, of, channel))
        self._bench.clock.tap(self._told_time)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the log. Raises RecordError: it could not be written completely, so it ends before the run does."""
        if self._stack.elsewhere:
            return
        with self._lock:
            try:
                with self._stack:
                    if self._failure is None:
                        self._whole.end()
            except (OSError, ValueError) as error:
                self._failure = self._failure or error
        if self._failure is not None and kind is None:
            raise RecordError(
                f"{self._path}: the bus log is incomplete: {self._failure}; make room on the disk, and run again"
            )

    def describe(self, header: str) -> None:
        """Write the header of the run's record, which is JSON."""
        self._note(RUN, header)

    def _listen(self, link: ModbusLink, kind: Link, whom: Callable[[bytes], str]) -> None:
        asked = ""

        def heard(sending: bool, data: bytes) -> None:
            nonlocal asked
            if sending:
                self._settle()
                asked = whom(data)
            with self._lock:
                self._write(self._whole.write, Packet(self._now_ns(), asked, kind, sending, data))

        link.tap(heard)

    def _heard_frame(self, whom: Callable[[bytes], str], channel: int, sending: bool, frame: can.Message) -> None:
        if sending:
            self._settle()
        data = packed(frame)
        stamped = unpacked(data)
        with self._lock:
            now = self._begun_ns + (self._clock.now_ns() if (own := time_of(frame)) is None else own)
            self._write(self._whole.write, Packet(now, whom(data), Link.CAN, sending, data))
            stamped.timestamp, stamped.is_rx, stamped.channel = now / 1e9, not sending, channel
            for log in self._frames:
                self._write(log, stamped)

    def _settle(self) -> None:
        """Let frames that came before what the program does now be written before it."""
        for link, _ in can_links(self._bench):
            link.settle()

    def _told_time(self, now_ns: int) -> None:
        self._settle()
        self._note(CLOCK, str(now_ns))

    def _note(self, what: str, text: str) -> None:
        with self._lock:
            self._write(self._whole.write, Packet(self._now_ns(), what, Link.NOTE, True, text.encode()))

    def _now_ns(self) -> int:
        return self._begun_ns + self._clock.now_ns()

    def _write(self, write: Any, what: object) -> None:
        """Write a message; a failure ends the log, but not the run."""
        with self._lock:
            if self._failure is None:
                try:
                    write(what)
                except (OSError, ValueError) as error:
                    self._failure = error
