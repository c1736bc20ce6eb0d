"""All traffic of a run in files that other tools read: CAN as BLF or ASC, Modbus as pcapng beside it."""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Self

import can

from drivers.bench import Bench
from drivers.can import CanLink
from drivers.modbus import ModbusLink
from drivers.modbus_device import ModbusDevice
from drivers.pcapng import Packet, PcapngWriter
from instrument.errors import RecordError, UsageError

CAN_FORMATS: dict[str, tuple[Any, str]] = {".blf": (can.BLFReader, "rb"), ".asc": (can.ASCReader, "r")}
MODBUS_FORMAT = ".pcapng"
UNIT_ON_TCP, UNIT_ON_LINE = 6, 0  # where the unit id stands


def check_log(path: Path) -> None:
    """Raises UsageError: CAN traffic has no such format, or a file of that name is there."""
    if path.suffix.lower() not in CAN_FORMATS:
        raise UsageError(f"--log {path}: the name must end in {' or '.join(CAN_FORMATS)}, a format of CAN traffic")
    for file in (path, path.with_suffix(MODBUS_FORMAT)):
        if file.exists():
            raise UsageError(f"--log {path}: {file} exists already; give another name")


class BusLog:
    """A context manager, entered before the bench is; messages are stamped with the bench's clock after `started`."""

    def __init__(self, bench: Bench, path: Path, started: datetime) -> None:
        self.files = (path, path.with_suffix(MODBUS_FORMAT))
        self._bench = bench
        self._begun_ns = round(started.timestamp()) * 1_000_000_000
        self._lock = threading.Lock()
        self._stack = ExitStack()
        self._failure: Exception | None = None
        self._came: dict[ModbusLink, Packet] = {}

    def __enter__(self) -> Self:
        frames, modbus = self.files
        try:
            with ExitStack() as stack:
                self._modbus = PcapngWriter(stack.enter_context(modbus.open("wb")))
                self._frames: Any = can.Logger(frames)
                stack.callback(self._frames.stop)
                self._stack = stack.pop_all()
        except OSError as error:
            raise RecordError(f"{frames}: the bus log cannot be written: {error}; choose another --log") from error
        units = {(id(d.link), d.unit): d.contract.name for d in self._bench.devices if isinstance(d, ModbusDevice)}
        for link in {id(device.link): device.link for device in self._bench.devices}.values():
            if isinstance(link, CanLink):
                link.tap(self._heard_frame)
            else:
                self._listen(link, {unit: name for (number, unit), name in units.items() if number == id(link)})
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Raises RecordError: something could not be written, so that the log ends before the run."""
        for packet in self._came.values():
            self._write(self._modbus.write, packet)
        self._came.clear()
        with self._lock:
            try:
                self._stack.close()
            except (OSError, ValueError) as error:
                self._failure = self._failure or error
        if self._failure is not None and kind is None:
            raise RecordError(f"{self.files[0]}: the bus log is not whole: {self._failure}; free the disk")

    def _listen(self, link: ModbusLink, names: dict[int, str]) -> None:
        place = UNIT_ON_LINE if link.serial else UNIT_ON_TCP

        def heard(sending: bool, data: bytes) -> None:
            unit = data[place] if len(data) > place else 0
            packet = Packet(self._now_ns(), names.get(unit, f"unit {unit}"), link.serial, sending, data)
            if not sending:
                self._came.pop(link, None)  # less of the same reply
            for reply in self._came.values():
                self._write(self._modbus.write, reply)
            self._came.clear()
            if sending:
                self._write(self._modbus.write, packet)
            else:
                self._came[link] = packet  # more of it may come

        link.tap(heard)

    def _heard_frame(self, frame: can.Message) -> None:
        stamped = can.Message(
            timestamp=self._now_ns() / 1e9,
            arbitration_id=frame.arbitration_id,
            is_extended_id=frame.is_extended_id,
            is_remote_frame=frame.is_remote_frame,
            is_error_frame=frame.is_error_frame,
            is_rx=frame.is_rx,
            channel=0,
            dlc=frame.dlc,
            data=frame.data,
        )
        self._write(self._frames, stamped)

    def _now_ns(self) -> int:
        return self._begun_ns + self._bench.clock.now_ns()

    def _write(self, write: Any, what: object) -> None:
        """Of two threads one at a time; what fails ends the log, not the run."""
        with self._lock:
            if self._failure is None:
                try:
                    write(what)
                except (OSError, ValueError) as error:
                    self._failure = error


@dataclass(frozen=True, slots=True)
class Frame:
    """A CAN frame of a log; `time` in s of the epoch."""

    time: float
    identifier: int
    data: bytes


def read_frames(path: Path) -> Iterator[Frame]:
    """The frames of a log, in their order. Raises OSError, ValueError: it cannot be read, or is damaged."""
    reader, mode = CAN_FORMATS[path.suffix.lower()]
    try:
        with path.open(mode) as file:  # which python-can leaves open where its header is damaged
            for frame in reader(file):
                yield Frame(frame.timestamp, frame.arbitration_id, bytes(frame.data))
    except (can.CanError, struct.error, EOFError, zlib.error) as error:
        raise ValueError(str(error)) from error
