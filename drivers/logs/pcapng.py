"""Capture files with all traffic of a bench, in the format that Wireshark reads: pcapng (draft-ietf-opsawg-pcapng).

Modbus TCP, a serial line and CAN each have their own interface, and so do palpate's notes, which are JSON. The last
note is the SHA-256 of everything before it. A file without it was cut off.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import BinaryIO

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
