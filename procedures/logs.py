"""Decodes a bus log for people, with names, values and units of the contracts."""

from __future__ import annotations

import json
import math
import struct
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from palpate.drivers.links.modbus import EXCEPTIONS
from palpate.drivers.logs.bus_log import (
    RUN,
    WHOLE_FORMAT,
    CanFrame,
    Link,
    NotALog,
    Packet,
    frame_of,
    kind_called,
    logged,
    read_frames,
    read_pcapng,
)
from palpate.instrument.bench.kinds import device_kind
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import BITS, READS, WRITES, Field, Table, sdo
from palpate.instrument.contracts.maps.map_file import read_map
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import PalpateError, RecordError, UsageError
from palpate.instrument.quantity import counted

NODE = SENSOR_NODE
NODE_BITS = 0x7F  # bits of an identifier that hold the node id
NMT, SYNC, EMERGENCY, SDO_ANSWER, SDO_REQUEST, HEARTBEAT = 0x000, 0x080, 0x080, 0x580, 0x600, 0x700
COMMANDS = {1: "start", 2: "stop", 0x80: "enter pre-operational", 0x81: "reset node", 0x82: "reset communication"}
STATES = {0: "boot-up", 4: "stopped", 5: "operational", 0x7F: "pre-operational"}
EXPEDITED = 2  # bit of an SDO command


@dataclass(frozen=True, slots=True)
class ShownMessage:
    """One message for people.

    Attributes:
        time: time since 1970 (UTC) [s].
        who: the device that sent or received it.
        text: its decoded content.
        raw: its bytes in hexadecimal digits.
        channel: the CAN bus, as the log numbers or names it; "": the log does not say.
    """

    time: float
    who: str
    text: str
    raw: str
    channel: str = ""


def read_log(path: Path) -> Iterator[ShownMessage]:
    """The messages of a log, in their order.

    Raises:
        UsageError: the file is no log that can be shown, or cannot be read.
        RecordError: the log is damaged or was cut off; the message says where, and the messages before it were given.
    """
    try:
        if logged(path).suffix.lower() == WHOLE_FORMAT:
            yield from _messages(read_pcapng(path))
        else:
            yield from map(_frame, read_frames(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror or error}; check the name") from error
    except NotALog as error:
        raise UsageError(f"{path}: is no log of palpate's: {error}; give one that --log recorded") from error
    except (ValueError, struct.error) as error:
        raise RecordError(f"{path}: damaged: {error}; the messages before the damage are good") from error


def _messages(packets: Iterator[Packet]) -> Iterator[ShownMessage]:
    talks: dict[str, Conversation] = {}  # by device
    maps: dict[str, Contract] = {}
    for packet in packets:
        if packet.link is Link.NOTE:
            maps |= _maps(packet) if packet.who == RUN else {}
            continue
        talk = talks.setdefault(packet.who, Conversation(None))
        if talk.contract is None:  # what precedes the run's header, as who answers, is shown without a laboratory's map
            talk.contract = maps.get(kind_called(packet.who)) or _contract(packet.who)
        yield _line(packet, talk)


def _line(packet: Packet, talk: Conversation) -> ShownMessage:
    if packet.link is Link.CAN:
        return _frame(frame_of(packet), talk.contract or NODE, talk.values)
    return _modbus(packet, talk)


def described(packet: Packet) -> str:
    """Decode one packet for people."""
    if packet.link is Link.NOTE:
        return f"a look at the {packet.who}"
    line = _line(packet, Conversation(_contract(packet.who)))
    return f"{line.who} {line.text}"


# --- Modbus --------------------------------------------------------------------------------------------


def _modbus(packet: Packet, talk: Conversation) -> ShownMessage:
    pdu = packet.data[1:-2] if packet.link is Link.LINE else packet.data[7:]
    arrow = "<-" if packet.sent else "->"
    text = talk.pdu(pdu, sent=packet.sent) if pdu else "empty"
    return ShownMessage(packet.time_ns / 1e9, packet.who, f"{arrow} {text}", packet.data.hex(" "))


def _contract(who: str) -> Contract | None:
    """The contract of a device, from its name in a log; None: the package of its kind is not installed."""
    try:
        return device_kind(kind_called(who)).contract
    except PalpateError:
        return None


def _maps(packet: Packet) -> dict[str, Contract]:
    """Contracts of a laboratory's maps that the run's header names, if the files are still the same."""
    with suppress(ValueError, KeyError, TypeError, AttributeError, PalpateError):
        header = json.loads(packet.data)
        files = [Path(each["map"]) for each in tomllib.loads(header["bench"])["device"].values() if "map" in each]
        found = {path: read_map(path) for path in files if path.is_file()}
        return {each.name: each.contract for each in found.values() if header["maps"].get(each.name) == each.sha256}
    return {}


# --- CANopen -------------------------------------------------------------------------------------------


def _frame(frame: CanFrame, contract: Contract = NODE, values: dict[str, float] | None = None) -> ShownMessage:
    if frame.kind != "data" or frame.extended:
        return ShownMessage(frame.time, "bus", _no_message(frame), frame.data.hex(" "), frame.channel)
    node, kind = frame.identifier & NODE_BITS, frame.identifier & ~NODE_BITS
    who = f"node {node}" if node else "all nodes"
    text = _message(contract, frame.identifier, node, kind, frame.data, {} if values is None else values)
    return ShownMessage(frame.time, who, text, frame.data.hex(" "), frame.channel)


def _no_message(frame: CanFrame) -> str:
    """Text of a frame that is no message of CANopen: those have 11 bits and data."""
    if frame.kind == "error":
        return "error frame"
    bits = "29-bit " if frame.extended else ""
    if frame.kind == "remote":
        return f"{bits}remote frame for {counted(frame.size, 'byte')} of 0x{frame.identifier:X}"
    name = "CAN FD frame" if frame.kind == "fd" else "frame"
    return f"{bits}{name} 0x{frame.identifier:X}" + (f": {frame.data.hex(' ')}" if frame.data else "")


def _message(contract: Contract, identifier: int, node: int, kind: int, data: bytes, values: dict[str, float]) -> str:
    pdo = next((pdo for pdo in (*contract.pdos, *contract.receives) if pdo.node_of(identifier)), None)
    if pdo is not None:
        parts = contract.parts(pdo, data)
        take(contract, parts, values)
        return ", ".join(contract.shown(name, part, values) for name, part in parts.items())
    if identifier == NMT and len(data) >= 2:
        return f"NMT {COMMANDS.get(data[0], f'command {data[0]}')}, node {data[1] or 'all'}"
    if identifier == SYNC:
        return "SYNC"
    if kind == EMERGENCY and len(data) >= 2:
        return f"emergency 0x{int.from_bytes(data[:2], 'little'):04X}"
    if kind == HEARTBEAT and data:
        return f"heartbeat, {STATES.get(data[0] & NODE_BITS, f'state {data[0]}')}"
    if kind in (SDO_REQUEST, SDO_ANSWER) and len(data) == 8:
        return _sdo(contract, data, values, asked=kind == SDO_REQUEST)
    return f"0x{identifier:03X}" + (f": {data.hex(' ')}" if data else "")


def _sdo(contract: Contract, data: bytes, values: dict[str, float], *, asked: bool) -> str:
    command, index, subindex = struct.unpack_from("<BHB", data)
    field = next((f for f in contract.fields if f.address == sdo(index, subindex)), None)
    name = field.name if field else f"0x{index:04X}:{subindex}"
    content = data[4 : 8 - (command >> 2 & 3)] if command & EXPEDITED else b""
    if field and content:
        take(contract, {name: content}, values)
    if field and content:
        shown = contract.shown(field.name, content, values)
    else:
        shown = f"{name} = {content.hex(' ')}" if content else name
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


# --- Modbus requests and replies for people: fields by their names, with the scales and signs that went by before

IDENTIFY, EXCEPTION = 43, 0x80
WRITES_ONE, ON = (5, 6), 0xFF
READ_FROM: dict[int, Table] = {function: table for table, function in READS.items()}
WRITTEN_TO: dict[int, Table] = {function: table for table, functions in WRITES.items() for function in functions}


@dataclass
class Conversation:
    """What has gone by between this program and one device.

    Attributes:
        contract: its contract; None: it is not known.
        values: the numbers that its fields last had; a scale or a sign may be among them.
    """

    contract: Contract | None
    values: dict[str, float] = field(default_factory=dict)
    _asked: tuple[int, int, int] = (0, 0, 0)  # function, address and count of the last request

    def pdu(self, pdu: bytes, *, sent: bool) -> str:
        """Text of a request (`sent`) or a reply, without unit id and check sum."""
        function, body = pdu[0], pdu[1:]
        if function & EXCEPTION:
            code = body[0] if body else 0
            return f"exception {code}, {EXCEPTIONS.get(code, 'unknown')}"
        if function == IDENTIFY:
            return "identify" if sent else "identity " + " ".join(_texts(body[6:]))
        address, count = int.from_bytes(body[:2]), int.from_bytes(body[2:4])
        if sent:
            self._asked = (function, address, count)
        if function in READ_FROM:
            table = READ_FROM[function]
            if sent:
                return f"read {self._names(table, address, count)}"
            return self._values(table, self._asked[1], _bits(body[1:], self._asked[2]) if table in BITS else body[1:])
        if function in WRITTEN_TO:
            return f"write {self._values(*_written(function, address, count, body))}" if sent else "written"
        return f"function {function}"

    def _names(self, table: Table, address: int, count: int) -> str:
        if self.contract is None:
            return f"{count} {'bits' if table in BITS else 'registers'} from 0x{address:04x}"
        return ", ".join(f.name for f in self._among(table, address, count)) or f"{count} from 0x{address:04x}"

    def _among(self, table: Table, address: int, count: int) -> list[Field]:
        assert self.contract is not None
        return [f for f in self.contract.fields if f.table == table and address <= f.address < address + count]

    def _values(self, table: Table, address: int, data: bytes) -> str:
        width = 1 if table in BITS else 2
        among = [] if self.contract is None else self._among(table, address, -(-len(data) // width))
        if self.contract is None or not among:
            return f"0x{address:04x}: {data.hex(' ')}"
        found = {f.name: data[width * (f.address - address) :][: f.size] for f in among}
        take(self.contract, found, self.values)
        return ", ".join(self.contract.shown(name, content, self.values) for name, content in found.items())


def take(contract: Contract, contents: dict[str, bytes], values: dict[str, float]) -> None:
    """Keep the numbers of fields, by which those of others may be scaled."""
    for name, content in contents.items():
        f = contract[name]
        if f.type != "text" and not f.beside and len(content) == f.size:
            with suppress(ValueError):
                value = contract.decode(name, content)
                if math.isfinite(value):
                    values[name] = value


def _bits(data: bytes, count: int) -> bytes:
    """A byte for each bit of a reply."""
    return bytes(data[n // 8] >> n % 8 & 1 for n in range(min(count, 8 * len(data))))


def _written(function: int, address: int, count: int, body: bytes) -> tuple[Table, int, bytes]:
    """Table, address and content of a write, with a byte for each bit."""
    table = WRITTEN_TO[function]
    if function in WRITES_ONE:
        return table, address, bytes([body[2:3] == bytes([ON])]) if table in BITS else body[2:4]
    return table, address, _bits(body[5:], count) if table in BITS else body[5:]


def _texts(data: bytes) -> Iterator[str]:
    while len(data) >= 2:
        size = data[1]
        yield repr(data[2 : 2 + size].decode("ascii", "replace"))
        data = data[2 + size :]
