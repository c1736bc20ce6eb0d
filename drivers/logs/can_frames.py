"""Reads the frames of a CAN log: of this program, of Vector's tools (BLF, ASC), or of Linux' candump."""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import can
from can.io.blf import BLFParseError

from palpate.drivers.logs.bus_log import CANDUMP, ERROR, unpacked
from palpate.drivers.logs.pcapng import NotALog, Packet

LONGEST = 8  # bytes of a classic frame
BEGIN_OF_BLF = b"LOGG"
NO_CANDUMP = "no log of candump, which has lines such as (0.1) can0 705#05 (candump -L)"
ASC_LINE = re.compile(r"\s*[0-9]+\.[0-9]+\s")  # begins with a time
ASC_HEAD = re.compile(r"(?im)^\s*(date|base)\s")
ASC_BEGIN, ASC_END = re.compile(r"(?im)^\s*begin trigger ?block"), re.compile(r"(?im)^\s*end trigger ?block")


@dataclass(frozen=True, slots=True)
class CanFrame:
    """A CAN frame of a log.

    Attributes:
        time: time since 1970 (UTC), or since the log began [s].
        identifier: its identifier; of an error frame 0.
        data: its bytes.
        kind: "data"; "remote", which asks for data; "error", which says that a frame was destroyed; "fd", a data frame
            of CAN FD.
        extended: whether its identifier has 29 bits.
        size: number of bytes that a remote frame asks for.
        channel: its bus, as the log numbers or names it; "": the log has but one.
    """

    time: float
    identifier: int
    data: bytes
    kind: str = "data"
    extended: bool = False
    size: int = 0
    channel: str = ""

    @classmethod
    def of(cls, message: can.Message) -> Self:
        """A frame that python-can has read, which counts channels from 0 where logs count them from 1."""
        number = message.channel
        kinds = {"error": message.is_error_frame, "remote": message.is_remote_frame, "fd": message.is_fd}
        kind = next((name for name, it_is in kinds.items() if it_is), "data")
        size = message.dlc if kind == "fd" else min(message.dlc, LONGEST)  # a classic frame may say up to 15
        if kind in ("data", "fd") and len(message.data) != size:
            raise ValueError(f"a frame 0x{message.arbitration_id:X} has {len(message.data)} of {size} bytes")
        return cls(
            message.timestamp,
            0 if kind == "error" else message.arbitration_id,
            bytes(message.data),
            kind,
            message.is_extended_id and kind != "error",
            message.dlc if kind == "remote" else 0,
            "" if number is None else str(number + 1 if isinstance(number, int) else number),
        )


def frame_of(packet: Packet) -> CanFrame:
    """The CAN frame of a packet."""
    frame = unpacked(packet.data)
    frame.timestamp = packet.time_ns / 1e9
    return CanFrame.of(frame)


def read_frames(path: Path) -> Iterator[CanFrame]:
    """The frames of a log, in their order.

    Raises:
        OSError: it cannot be read.
        NotALog: it is no such log.
        ValueError: it is damaged, or was cut off; the frames before that have been given.
    """
    read = {CANDUMP: _candump, ".asc": _asc}.get(path.suffix.lower(), _blf)
    try:
        yield from read(path)
    except (can.CanError, BLFParseError, struct.error, EOFError, zlib.error) as error:
        raise ValueError(str(error) or "it cannot be read further") from error


def _lines(path: Path) -> tuple[list[str], bool]:
    """The whole lines of a text, and whether the last one is cut off."""
    text = path.read_bytes().decode("utf-8", "replace")
    lines = text.splitlines(keepends=True)
    cut = bool(lines) and not lines[-1].endswith(("\n", "\r")) and not ASC_END.match(lines[-1])
    return (lines[:-1] if cut else lines), cut


def _blf(path: Path) -> Iterator[CanFrame]:
    size = path.stat().st_size
    with path.open("rb") as file:  # python-can would leave a file with a damaged header open
        if file.read(len(BEGIN_OF_BLF)) != BEGIN_OF_BLF:
            raise NotALog("no BLF file, which begins with LOGG")
        file.seek(0)
        reader = can.BLFReader(file)
        for message in reader:
            yield CanFrame.of(message)
        if size < reader.file_size:
            raise ValueError(f"it was cut off: it has {size} of {reader.file_size} bytes")
        if size > reader.file_size and not reader.object_count:
            raise ValueError("it was cut off: its recording was never ended")


def _asc(path: Path) -> Iterator[CanFrame]:
    lines, cut = _lines(path)
    text = "".join(lines)
    first = next((number for number, line in enumerate(lines) if ASC_LINE.match(line)), len(lines))
    if first == len(lines) and not ASC_HEAD.search(text):
        raise NotALog("no ASC file, which begins with its date and base")
    lines.insert(first, "\n")  # without a certain line python-can takes what follows the header for a part of it
    for message in can.ASCReader(io.StringIO("".join(lines))):
        yield CanFrame.of(message)
    if cut or (ASC_BEGIN.search(text) and not ASC_END.search(text)):
        raise ValueError("it was cut off: its end is missing")


def _candump(path: Path) -> Iterator[CanFrame]:
    lines, cut = _lines(path)
    known = not "".join(lines).strip() and not cut  # an empty log is one
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            (message,) = can.CanutilsLogReader(io.StringIO(line))
            _, channel, content, *_ = line.split()
            # python-can takes only some of the kinds of error frames for such
            message.is_error_frame = bool(int(content.partition("#")[0], 16) & ERROR)
        except ValueError:
            if not known:
                raise NotALog(NO_CANDUMP) from None
            raise ValueError(f"line {number} cannot be read") from None
        known = True
        message.channel = channel
        yield CanFrame.of(message)
    if not known:
        raise NotALog(NO_CANDUMP)
    if cut:
        raise ValueError("it was cut off: its last line has no end")
