"""Replies of Modbus devices, as the drivers see them: through pymodbus' framers and our checks.

An input is three bytes of control (which exchange; 1: put the length or check sum right; where the reply is cut in
two pieces) and a reply. An independent reading of the frame says what it holds.
"""

from __future__ import annotations

import re
import struct
from fractions import Fraction
from typing import Any

from palpate.drivers.clock import WallClock
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.drivers.links import modbus as tcp
from palpate.drivers.links.modbus import ModbusLink, RtuClient
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Field
from tests.drivers.fake_links import checked
from tests.fuzz.target import Target, require, same_number

UNIT = 5
OF_TYPE = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}
IDENTITY = (0, 1, 2, 4, 6, 0x80)


class TcpClient(tcp.TcpClient):
    """Ours, with a reply in place of a socket; silence after it is a time-out."""

    pieces: list[bytes]

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        pass

    def send(self, request: bytes, addr: Any = None) -> int:
        return len(request)

    def recv(self, size: int | None) -> bytes:
        return self.pieces.pop(0) if self.pieces else b""


class SerialClient(RtuClient):
    """Ours, with a reply in place of a line."""

    pieces: list[bytes]

    def connect(self) -> bool:
        return True

    def close(self) -> None:
        pass

    def _patience(self) -> float:
        return 0.0

    def _now(self) -> float:
        return self._earliest

    def _ready(self, within: float) -> bool:
        return bool(self.pieces) and self._asked

    def _read(self) -> bytes:
        return self.pieces.pop(0)

    def _write(self, request: bytes) -> int:
        self._asked = True
        return len(request)

    def send(self, request: bytes, addr: Any = None) -> int:
        self._asked = False  # nothing is there yet
        return super().send(request, addr)


def tcp_frame(pdu: bytes, transaction: int = 1, unit: int = UNIT) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def rtu_frame(pdu: bytes, unit: int = UNIT) -> bytes:
    return checked(bytes([unit]) + pdu)


def physical(field: Field, data: bytes) -> float:
    (raw,) = struct.unpack(OF_TYPE[field.type], data)
    return raw * field.scale if field.type == "float32" else float(raw * Fraction(str(field.scale)))


def held_by_tcp(stream: bytes) -> list[bytes]:
    """The PDU of the first whole frame for us, frame after frame from the beginning."""
    at = 0
    while len(stream) - at >= 8:
        transaction, protocol, length, unit = struct.unpack_from(">HHHB", stream, at)
        end = at + 6 + length
        if protocol or end > len(stream):
            return []
        if length >= 2 and (transaction, unit) == (1, UNIT):
            return [stream[at + 7 : end]]
        at = end
    return []


def held_by_rtu(stream: bytes) -> list[bytes]:
    """PDUs of whole frames for us anywhere: noise may stand before them."""
    found = []
    for at in range(len(stream) - 3):
        for end in range(at + 4, len(stream) + 1) if stream[at] == UNIT else ():
            if checked(stream[at : end - 2]) == stream[at:end]:
                found.append(stream[at + 1 : end - 2])
    return found


class Exchanges:
    """Reads of each field, writes of those that can be written, and the identification of one device."""

    def __init__(self, contract: Contract, tcp: bool) -> None:
        self.tcp = tcp
        self.client = TcpClient("fuzz") if tcp else SerialClient("fuzz")
        self.link = ModbusLink("fuzz", self.client)
        self.device = type("Device", (ModbusDevice,), {"contract": contract})(self.link, UNIT, WallClock())
        self.reads = [(f,) for f in contract.fields if f.access != "wo"]
        block = [f for f in contract.fields if f.access == "rw" and f.address >= 0x10]
        self.reads.append(
            tuple(block[:1] + [f for f in block[1:2] if f.address == block[0].address + block[0].size // 2])
        )
        self.writes = [f for f in contract.fields if f.access != "ro"]
        self.count = len(self.reads) + len(self.writes) + 1

    def framed(self, pdu: bytes) -> bytes:
        return tcp_frame(pdu) if self.tcp else rtu_frame(pdu)

    def seeds(self) -> list[bytes]:
        contract = self.device.contract
        reads = [b"".join(contract.pack(f.name, f.default) for f in fields) for fields in self.reads]
        pdus = [bytes([3, len(data)]) + data for data in reads]
        pdus += [struct.pack(">BHH", 16, f.address, f.size // 2) for f in self.writes]
        return [
            bytes([number, 0, 0]) + self.framed(pdu) for number, pdu in enumerate([*pdus, identification(contract)])
        ]

    def decode(self, data: bytes) -> None:
        number, repair, cut, stream = data[0] % self.count if data else 0, data[1:2], data[2:3], data[3:]
        if repair and repair[0] & 1 and len(stream) > 7:
            length = (len(stream) - 6).to_bytes(2, "big")
            stream = stream[:4] + length + stream[6:] if self.tcp else checked(stream[:-2])
        at = cut[0] % (len(stream) + 1) if cut else 0
        self.client.pieces = [piece for piece in (stream[:at], stream[at:]) if piece]
        self.client.transaction.next_tid = 0
        self.link._reply_due = False
        self.device._last_count = 0
        self._ask(number, stream)

    def _ask(self, number: int, stream: bytes) -> None:
        read = held_by_tcp if self.tcp else held_by_rtu
        if number < len(self.reads):
            fields = self.reads[number]
            values = self.device.get_many(*(f.name for f in fields))
            require(any(_holds(pdu, fields, values) for pdu in read(stream)), "values", values, stream.hex())
        elif number < self.count - 1:
            field = self.writes[number - len(self.reads)]
            self.device.set(**{field.name: next(iter(field.choices.values()), field.minimum or 0)})
            wanted = struct.pack(">BHH", 16, field.address, field.size // 2)
            require(wanted in read(stream), "confirmation", field.name, stream.hex())
        else:
            identify = bytes([3, 4]) + (0x12345678).to_bytes(4, "big")
            probe = tcp_frame(identify, 2) if self.tcp else rtu_frame(identify)
            self.client.pieces.append(probe)
            self.device.connect()
            require(
                any(_identifies(pdu, self.device) for pdu in read(stream)), "identity", self.device.serial, stream.hex()
            )


def identification(contract: Contract) -> bytes:
    """Response to a request for the extended identification."""
    own = contract.identity
    texts = (own.vendor, own.product, own.revision, contract.title, "simulated", "S-1")
    parts = [bytes([n, len(text)]) + text.encode() for n, text in zip(IDENTITY, texts, strict=True)]
    return bytes([0x2B, 14, 3, 0x83, 0, 0, len(parts)]) + b"".join(parts)


def _holds(pdu: bytes, fields: tuple[Field, ...], values: list[float]) -> bool:
    size = sum(f.size for f in fields)
    if len(pdu) != 2 + size or pdu[:2] != bytes([3, size]):
        return False
    at = 2
    for field, value in zip(fields, values, strict=True):
        if not same_number(physical(field, pdu[at : at + field.size]), value):
            return False
        at += field.size
    return True


def _identifies(pdu: bytes, device: ModbusDevice) -> bool:
    objects: dict[int, str] = {}
    at = 7
    while at + 2 <= len(pdu) and at + 2 + pdu[at + 1] <= len(pdu):
        if pdu[at] in objects:
            return False
        objects[pdu[at]] = _text(pdu[at + 2 : at + 2 + pdu[at + 1]])
        at += 2 + pdu[at + 1]
    own = device.contract.identity
    return (
        pdu[:2] == b"\x2b\x0e"
        and at == len(pdu)
        and len(objects) == pdu[6]
        and (objects.get(0), objects.get(1)) == (own.vendor, own.product)
        and objects.get(0x80, "") == device.serial
        and (objects.get(6) == "simulated") == device.simulated
    )


def _text(data: bytes) -> str:
    """Without what fills a text up, before and behind, and what stood behind it before."""
    text = re.sub(rb"\A[\0 \t\r\n\xff]+|[ \t\r\n\xff]*(\0.*)?\Z", b"", data, flags=re.DOTALL)
    try:
        return text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1")


def _target(name: str, tcp: bool) -> Target:
    exchanges = Exchanges(CONTRACTS[name], tcp)
    framed = exchanges.framed
    wrong = [framed(b"\x83\x02"), framed(b"\x03\x03\x00\x01\x02"), framed(b"\x2b\x0e\x03\x83\x00\x00\xff"), b"\x2b\x0e"]
    return Target(exchanges.seeds(), exchanges.decode, wrong)


def tcp() -> Target:
    return _target("signal_generator", tcp=True)


def rtu() -> Target:
    return _target("strain_indicator", tcp=False)
