"""Capture files that Wireshark reads: pcapng (IETF draft-ietf-opsawg-pcapng), with Modbus TCP and a serial line."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

SECTION, INTERFACE, PACKET = 0x0A0D0D0A, 1, 6  # block types
BYTE_ORDER = 0x1A2B3C4D
COMMENT, RESOLUTION, NANOSECONDS = 1, 9, 9  # options
IPV4, RTAC_SERIAL = 228, 250  # link types
MODBUS_PORT, CLIENT_PORT = 502, 50_000
IP_HEADER, TCP_HEADER, SERIAL_HEADER = 20, 20, 12  # bytes
SENT, CAME = 1, 2  # events of a serial line


@dataclass(frozen=True, slots=True)
class Packet:
    """One message: `data` as on the wire, without the headers of the network below; `who` said or got it."""

    time_ns: int
    who: str
    serial: bool
    sent: bool
    data: bytes


class PcapngWriter:
    """Writes packets to a file that is open; each who on TCP gets a connection of its own."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._positions: dict[str, list[int]] = {}  # in both streams of a connection
        self._block(SECTION, struct.pack("<IHHq", BYTE_ORDER, 1, 0, -1))
        for link in (IPV4, RTAC_SERIAL):
            self._block(INTERFACE, struct.pack("<HHI", link, 0, 0) + _options({RESOLUTION: bytes([NANOSECONDS])}))

    def write(self, packet: Packet) -> None:
        data = (_serial(packet) if packet.serial else self._tcp(packet)) + packet.data
        head = struct.pack("<IIIII", packet.serial, packet.time_ns >> 32, packet.time_ns & 0xFFFFFFFF, *2 * [len(data)])
        self._block(PACKET, head + _padded(data) + _options({COMMENT: packet.who.encode()}))

    def _block(self, kind: int, body: bytes) -> None:
        size = 12 + len(body)
        self._file.write(struct.pack("<II", kind, size) + body + struct.pack("<I", size))

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


def read_pcapng(path: Path) -> Iterator[Packet]:
    """The packets of a file that `PcapngWriter` wrote. Raises ValueError: it is another, or damaged."""
    data = path.read_bytes()
    if struct.unpack_from("<I4xI", data.ljust(12)) != (SECTION, BYTE_ORDER):
        raise ValueError("no capture file of palpate")
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from("<II", data.ljust(at + 8, b"\0"), at)
        if size < 12 or at + size > len(data):
            raise ValueError(f"cut short at byte {at}")
        if kind == PACKET:
            yield _packet(data[at + 8 : at + size - 4])
        at += size


def _packet(body: bytes) -> Packet:
    serial, high, low, size, _ = struct.unpack_from("<IIIII", body)
    data = body[20 : 20 + size]
    options = body[20 + len(_padded(data)) :]
    code, length = struct.unpack_from("<HH", options)
    who = options[4 : 4 + length].decode() if code == COMMENT else ""
    if serial:
        sent, payload = data[8] == SENT, data[SERIAL_HEADER:]
    else:
        sent = int.from_bytes(data[IP_HEADER + 2 : IP_HEADER + 4], "big") == MODBUS_PORT
        payload = data[IP_HEADER + TCP_HEADER :]
    return Packet(high << 32 | low, who, bool(serial), sent, payload)
