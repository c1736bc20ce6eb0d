"""Logs of a run's traffic in formats that other tools read: all of it as pcapng, and CAN also as BLF or ASC."""

from __future__ import annotations

import hashlib
import io
import re
import stat
import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Self

import can
from can.io.blf import BLFParseError

from palpate.drivers.bench import Bench
from palpate.drivers.clock import Clock
from palpate.drivers.links.can import CanLink
from palpate.drivers.links.modbus import ModbusLink
from palpate.instrument.bench.description import Listed
from palpate.instrument.bench.links import time_of
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import RecordError, UsageError, check_path
from palpate.instrument.own_process import Ends

# --- pcapng --------------------------------------------------------------------------------------------

# Modbus TCP, a serial line and CAN each have their own interface, and so do palpate's notes, which are JSON. The last
# note is the SHA-256 of everything before it. A file without it was cut off.


SECTION, INTERFACE, PACKET = 0x0A0D0D0A, 1, 6  # block types
SECTION_TYPE = SECTION.to_bytes(4, "little")
BYTE_ORDER = 0x1A2B3C4D
COMMENT, FLAGS, RESOLUTION, NANOSECONDS = 1, 2, 9, 9  # options
INBOUND, OUTBOUND = 1, 2  # flags
MODBUS_PORT, CLIENT_PORT = 502, 50_000
IP_HEADER, TCP_HEADER = 20, 20  # bytes
SENT, CAME = 1, 2  # events of a serial line
APPLICATION, HASHED = 4, b"palpate, with the SHA-256 at its end"  # option of the section block
SHA256 = "sha256"  # name of the last note
MOST_WRONG = 2  # bytes of a beginning; those of other programs' files differ in more
NOTE_HEADER = struct.pack(">HH4sHH", 12, 4, b"json", 0, 0)  # names Wireshark's dissector for a note


class NotALog(ValueError):
    """A file is no log that can be read; it is nothing damaged."""


class Link(IntEnum):
    """The interface of a packet."""

    TCP = 0
    LINE = 1
    CAN = 2
    NOTE = 3


LINK_TYPES = {Link.TCP: 228, Link.LINE: 250, Link.CAN: 227, Link.NOTE: 252}  # IPv4, RTAC serial, SocketCAN, upper PDU
HEADERS = {Link.TCP: IP_HEADER + TCP_HEADER, Link.LINE: 12, Link.CAN: 0, Link.NOTE: len(NOTE_HEADER)}  # bytes


@dataclass(frozen=True, slots=True)
class Packet:
    """One message.

    Attributes:
        time_ns: time since 1970 (UTC) [ns].
        who: name of the device that received or sent it; of a note, the note's name.
        link: its interface.
        sent: True: the program sent it; False: the program received it.
        data: its bytes without the headers of lower layers; a CAN frame in Linux' format (struct can_frame), a note as
            JSON.
    """

    time_ns: int
    who: str
    link: Link
    sent: bool
    data: bytes


class PcapngWriter:
    """Writes packets to an open file. Each device on TCP gets its own connection in the capture."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._positions: dict[str, list[int]] = {}  # sequence numbers of both directions of each connection
        self._hash = hashlib.sha256()
        self._last_ns = 0
        self._put(BEGINNING)

    def end(self) -> None:
        """Write the last note, after which nothing may follow."""
        self.write(Packet(self._last_ns, SHA256, Link.NOTE, True, self._hash.hexdigest().encode()))

    def write(self, packet: Packet) -> None:
        self._last_ns = packet.time_ns
        data = self._header(packet) + packet.data
        head = struct.pack("<IIIII", packet.link, packet.time_ns >> 32, packet.time_ns & 0xFFFFFFFF, *2 * [len(data)])
        flags = struct.pack("<I", OUTBOUND if packet.sent else INBOUND)
        self._put(_block(PACKET, head + _padded(data) + _options({COMMENT: packet.who.encode(), FLAGS: flags})))

    def _header(self, packet: Packet) -> bytes:
        match packet.link:
            case Link.TCP:
                return self._tcp(packet)
            case Link.LINE:
                return _serial(packet)
            case Link.CAN:
                return b""
            case Link.NOTE:
                return NOTE_HEADER

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._hash.update(data)

    def _tcp(self, packet: Packet) -> bytes:
        positions = self._positions.setdefault(packet.who, [1, 1])
        number = list(self._positions).index(packet.who)
        device, client = (10, 0, 0, 2 + number), (10, 0, 0, 1)
        ends = ((client, CLIENT_PORT + number), (device, MODBUS_PORT))
        (source, source_port), (target, target_port) = ends if packet.sent else ends[::-1]
        own = 0 if packet.sent else 1
        tcp = struct.pack(
            ">HHIIBBHHH", source_port, target_port, positions[own], positions[1 - own], 0x50, 0x18, 0xFFFF, 0, 0
        )
        positions[own] += len(packet.data)
        size = IP_HEADER + TCP_HEADER + len(packet.data)
        ip = struct.pack(">BBHHHBBH4B4B", 0x45, 0, size, 0, 0x4000, 64, 6, 0, *source, *target)
        return ip[:10] + _checksum(ip).to_bytes(2, "big") + ip[12:] + tcp


def _serial(packet: Packet) -> bytes:
    seconds, rest = divmod(packet.time_ns, 1_000_000_000)
    return struct.pack(">IIBBH", seconds & 0xFFFFFFFF, rest // 1000, SENT if packet.sent else CAME, 0, 0)


def _checksum(header: bytes) -> int:
    total: int = sum(struct.unpack(f">{len(header) // 2}H", header))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _options(values: dict[int, bytes]) -> bytes:
    given = (struct.pack("<HH", code, len(value)) + _padded(value) for code, value in values.items())
    return b"".join(given) + bytes(4)


def _block(kind: int, body: bytes) -> bytes:
    size = 12 + len(body)
    return struct.pack("<II", kind, size) + body + struct.pack("<I", size)


def _beginning() -> bytes:
    """The section and interface blocks, which are the same in every file."""
    section = _block(SECTION, struct.pack("<IHHq", BYTE_ORDER, 1, 0, -1) + _options({APPLICATION: HASHED}))
    nanoseconds = _options({RESOLUTION: bytes([NANOSECONDS])})
    return section + b"".join(
        _block(INTERFACE, struct.pack("<HHI", kind, 0, 0) + nanoseconds) for kind in LINK_TYPES.values()
    )


BEGINNING = _beginning()


def read_pcapng(path: Path) -> Iterator[Packet]:
    """Packets of a file that `PcapngWriter` wrote.

    Raises:
        NotALog: the file is no capture of palpate.
        ValueError: it is damaged or cut off. Damage that the packets themselves do not show is found after the last
            one, by the hash.
    """
    data = path.read_bytes()
    if not data.startswith(BEGINNING):
        if not _resembles(data):
            raise NotALog("no capture file of palpate, but another program's")
        raise ValueError("its first bytes are damaged or missing")
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from("<II", data.ljust(at + 8, b"\0"), at)
        if size < 12 or at + size > len(data):
            raise ValueError(f"cut short at byte {at}")
        if kind == PACKET:
            packet = _packet(data[at + 8 : at + size - 4])
            if packet.link is Link.NOTE and packet.who == SHA256:
                if packet.data.decode() != hashlib.sha256(data[:at]).hexdigest() or at + size != len(data):
                    raise ValueError("its bytes were changed (the SHA-256 differs)")
                return
            yield packet
        at += size
    raise ValueError("it was cut off: its end is missing")


def _resembles(data: bytes) -> bool:
    """Whether a file that does not begin as ours do began so once: it is cut off there, or has some wrong bytes."""
    first = data[: len(BEGINNING)]
    wrong = sum(here != there for here, there in zip(first, BEGINNING, strict=False))
    return len(first) >= len(SECTION_TYPE) and wrong <= MOST_WRONG


def _packet(body: bytes) -> Packet:
    number, high, low, size, _ = struct.unpack_from("<IIIII", body)
    link = Link(number)
    data = body[20 : 20 + size]
    options = dict(_read_options(body[20 + len(_padded(data)) :]))
    sent = options.get(FLAGS, b"")[:1] == bytes([OUTBOUND])
    return Packet(high << 32 | low, options.get(COMMENT, b"").decode(), link, sent, data[HEADERS[link] :])


def _read_options(data: bytes) -> Iterator[tuple[int, bytes]]:
    while data:
        code, length = struct.unpack_from("<HH", data)
        yield code, data[4 : 4 + length]
        data = data[4 + len(_padded(data[4 : 4 + length])) :] if code else b""


# --- CAN logs ------------------------------------------------------------------------------------------


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
    is_candump = not "".join(lines).strip() and not cut  # an empty log is one
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            (message,) = can.CanutilsLogReader(io.StringIO(line))
            _, channel, content, *_ = line.split()
            # python-can takes only some of the kinds of error frames for such
            message.is_error_frame = bool(int(content.partition("#")[0], 16) & ERROR)
        except ValueError:
            if not is_candump:
                raise NotALog(NO_CANDUMP) from None
            raise ValueError(f"line {number} cannot be read") from None
        is_candump = True
        message.channel = channel
        yield CanFrame.of(message)
    if not is_candump:
        raise NotALog(NO_CANDUMP)
    if cut:
        raise ValueError("it was cut off: its last line has no end")


# --- logs ----------------------------------------------------------------------------------------------


CAN_FORMATS = (".blf", ".asc")
CANDUMP = ".log"  # is read, and not written
WHOLE_FORMAT = ".pcapng"
READ = (WHOLE_FORMAT, *CAN_FORMATS, CANDUMP)
UNIT_ON_TCP, UNIT_ON_LINE = 6, 0  # index of the unit id in a frame
CLOCK, RUN = "clock", "run"  # two notes: a time that the program read from the bench's clock [ns]; the run's header
NODES = SENSOR_NODE.name
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
