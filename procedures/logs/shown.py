"""Decodes a bus log for people, with names, values and units of the contracts."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from palpate.drivers.links.modbus import EXCEPTIONS
from palpate.drivers.logs.bus_log import WHOLE_FORMAT, Frame, frame_of, kind_called, logged, read_frames
from palpate.drivers.logs.pcapng import Link, Packet, read_pcapng
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.contracts import sensor_node
from palpate.instrument.contracts.contract import Contract, sdo
from palpate.instrument.errors import ConfigError, PalpateError, UsageError

NODE = sensor_node.CONTRACT
NODE_BITS = 0x7F  # bits of an identifier that hold the node id
NMT, SYNC, EMERGENCY, SDO_ANSWER, SDO_REQUEST, HEARTBEAT = 0x000, 0x080, 0x080, 0x580, 0x600, 0x700
COMMANDS = {1: "start", 2: "stop", 0x80: "enter pre-operational", 0x81: "reset node", 0x82: "reset communication"}
STATES = {0: "boot-up", 4: "stopped", 5: "operational", 0x7F: "pre-operational"}
EXPEDITED = 2  # bit of an SDO command
READ, WRITE_ONE, WRITE_MANY, IDENTIFY, EXCEPTION = 3, 6, 16, 43, 0x80


@dataclass(frozen=True, slots=True)
class Line:
    """One message for people.

    Attributes:
        time: time since 1970 (UTC) [s].
        who: the device that sent or received it.
        text: its decoded content.
        raw: its bytes in hexadecimal digits.
    """

    time: float
    who: str
    text: str
    raw: str


def read_log(path: Path) -> Iterator[Line]:
    """The messages of a log, in their order.

    Raises:
        UsageError: the file is no log, or cannot be read.
        ConfigError: the log is damaged; the message says where.
    """
    try:
        if logged(path).suffix.lower() == WHOLE_FORMAT:
            yield from _messages(read_pcapng(path))
        else:
            yield from map(_frame, read_frames(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error
    except (ValueError, struct.error) as error:
        raise ConfigError(f"{path}: damaged: {error}; the messages before the damage are good") from error


def _messages(packets: Iterator[Packet]) -> Iterator[Line]:
    asked: dict[str, tuple[int, int]] = {}  # function and address of the last request to each device
    for packet in packets:
        if packet.link is Link.CAN:
            yield _frame(frame_of(packet), _contract(packet.who) or NODE)
        elif packet.link is not Link.NOTE:
            yield _modbus(packet, asked)


def described(packet: Packet) -> str:
    """Decode one packet for people."""
    if packet.link is Link.NOTE:
        return f"a look at the {packet.who}"
    line = _frame(frame_of(packet), _contract(packet.who) or NODE) if packet.link is Link.CAN else _modbus(packet, {})
    return f"{line.who} {line.text}"


# --- Modbus --------------------------------------------------------------------------------------------


def _modbus(packet: Packet, asked: dict[str, tuple[int, int]]) -> Line:
    pdu = packet.data[1:-2] if packet.link is Link.LINE else packet.data[7:]
    arrow = "<-" if packet.sent else "->"
    contract = _contract(packet.who)
    text = _pdu(contract, pdu, packet.sent, asked.get(packet.who, (0, 0))) if pdu else "empty"
    if packet.sent and len(pdu) >= 3:
        asked[packet.who] = (pdu[0], int.from_bytes(pdu[1:3], "big"))
    return Line(packet.time_ns / 1e9, packet.who, f"{arrow} {text}", packet.data.hex(" "))


def _contract(who: str) -> Contract | None:
    """The contract of a device, from its name in a log; None: the package of its kind is not installed."""
    try:
        return device_kind(kind_called(who)).contract
    except PalpateError:
        return None


def _pdu(contract: Contract | None, pdu: bytes, sent: bool, asked: tuple[int, int]) -> str:
    function, body = pdu[0], pdu[1:]
    if function & EXCEPTION:
        code = body[0] if body else 0
        return f"exception {code}, {EXCEPTIONS.get(code, 'unknown')}"
    address = int.from_bytes(body[:2], "big")
    if function == IDENTIFY:
        return "identify" if sent else "identity " + " ".join(_texts(body[6:]))
    if function == READ:
        if sent:
            return f"read {_names(contract, address, int.from_bytes(body[2:4], 'big'))}"
        return _registers(contract, asked[1], body[1:])
    if function == WRITE_MANY:
        return f"write {_registers(contract, address, body[5:])}" if sent else "written"
    if function == WRITE_ONE:
        return f"write {_registers(contract, address, body[2:])}" if sent else "written"
    return f"function {function}"


def _texts(data: bytes) -> Iterator[str]:
    while len(data) >= 2:
        size = data[1]
        yield repr(data[2 : 2 + size].decode("ascii", "replace"))
        data = data[2 + size :]


def _names(contract: Contract | None, address: int, count: int) -> str:
    if contract is None:
        return f"{count} registers from 0x{address:04x}"
    return ", ".join(f.name for f in contract.fields if address <= f.address < address + count)


def _registers(contract: Contract | None, address: int, data: bytes) -> str:
    if contract is None:
        return f"0x{address:04x}: {data.hex(' ')}"
    found = [(f, 2 * (f.address - address)) for f in contract.fields]
    return ", ".join(contract.shown(f.name, data[at : at + f.size]) for f, at in found if 0 <= at < len(data))


# --- CANopen -------------------------------------------------------------------------------------------


def _frame(frame: Frame, contract: Contract = NODE) -> Line:
    node, kind = frame.identifier & NODE_BITS, frame.identifier & ~NODE_BITS
    who = f"node {node}" if node else "all nodes"
    return Line(frame.time, who, _message(contract, frame.identifier, node, kind, frame.data), frame.data.hex(" "))


def _message(contract: Contract, identifier: int, node: int, kind: int, data: bytes) -> str:
    pdo = next((pdo for pdo in (*contract.pdos, *contract.receives) if pdo.base == kind), None)
    if pdo is not None and node:
        return ", ".join(contract.shown(name, part) for name, part in contract.parts(pdo, data).items())
    if identifier == NMT and len(data) >= 2:
        return f"NMT {COMMANDS.get(data[0], f'command {data[0]}')}, node {data[1] or 'all'}"
    if identifier == SYNC:
        return "SYNC"
    if kind == EMERGENCY and len(data) >= 2:
        return f"emergency 0x{int.from_bytes(data[:2], 'little'):04X}"
    if kind == HEARTBEAT and data:
        return f"heartbeat, {STATES.get(data[0] & NODE_BITS, f'state {data[0]}')}"
    if kind in (SDO_REQUEST, SDO_ANSWER) and len(data) == 8:
        return _sdo(contract, data, asked=kind == SDO_REQUEST)
    return f"0x{identifier:03X}"


def _sdo(contract: Contract, data: bytes, *, asked: bool) -> str:
    command, index, subindex = struct.unpack_from("<BHB", data)
    field = next((f for f in contract.fields if f.address == sdo(index, subindex)), None)
    name = field.name if field else f"0x{index:04X}:{subindex}"
    content = data[4 : 8 - (command >> 2 & 3)] if command & EXPEDITED else b""
    shown = contract.shown(field.name, content) if field and content else name
    match command >> 5, asked:
        case 4, _:
            return f"abort {name}, 0x{int.from_bytes(data[4:], 'little'):08X}"
        case (2, True):
            return f"read {name}"
        case (2, False):
            return f"-> {shown}"
        case (1, True):
            return f"write {shown}"
        case (3, False):
            return f"written {name}"
    return "segment"
