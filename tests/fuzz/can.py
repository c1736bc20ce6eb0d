"""Frames of sensor nodes, as the drivers see them: through python-can, canopen and our checks.

An input of `node_frames` is a row of frames: a byte of flags, two of identifier, one of length, data. An input of
`sdo_answers` is two bytes of control (which transfer; 1: the answers repeat for ever, 2: the first is cut short), and
answers of eight bytes. An independent reading of the frames says what they hold.
"""

from __future__ import annotations

import struct
from typing import Any

import can

from palpate.drivers.clock import WallClock
from palpate.drivers.devices.sensor_node import CanopenSensorNode
from palpate.drivers.links.can import LARGEST_OBJECT, CanLink, _Listener
from palpate.instrument.bench import links
from palpate.instrument.contracts.declaration import is_relative
from palpate.instrument.contracts.field import sdo
from palpate.instrument.contracts.own import SENSOR_NODE
from tests.fuzz.target import Target, require, same_number

NODE = 3
SAMPLES, STAMP, EMERGENCY, HEARTBEAT = 0x180 + NODE, 0x280 + NODE, 0x80 + NODE, 0x700 + NODE
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8
ENDLESS, SHORT = 1, 2
OF_TYPE = {"uint8": "<B", "int8": "<b", "uint16": "<H", "int16": "<h", "uint32": "<I", "int32": "<i", "float32": "<f"}
NAME = sdo(0x1008)


class Network:
    """Answers each request with the next of the prepared answers."""

    def __init__(self) -> None:
        self.answers: list[bytes] = []
        self.endless = False
        self.sdo: Any = None

    def send_message(self, _cob_id: int, data: bytes) -> None:
        if self.answers and data[0] != 0x80:
            answer = self.answers.pop(0)
            if self.endless:
                self.answers.append(answer)
            self.sdo.on_response(0x580 + NODE, bytearray(answer), 0.0)


class Transfers:
    """Reads of each object, writes of those that can be written, and the device name."""

    def __init__(self) -> None:
        self.link = CanLink(links.CanBus(interface="virtual", channel="fuzz", timeout="1 ms"))
        self.link.open()
        self.node = CanopenSensorNode(self.link, NODE, WallClock())
        self.node._node = self.link.add_node(NODE)
        self.link.close()
        self.network = Network()
        self.network.sdo = self.node._node.sdo
        self.node._node.sdo.network = self.network
        self.reads = [f for f in SENSOR_NODE.fields if f.access != "wo" and f.type != "text"]
        self.writes = [f for f in SENSOR_NODE.fields if f.access != "ro"]

    def seeds(self) -> list[bytes]:
        first = [
            bytes([0x43 | (4 - f.size) << 2])
            + _multiplexer(f.address)
            + SENSOR_NODE.pack(f.name, float(f.default) + NODE * is_relative(f.index, f.subindex)).ljust(4, b"\0")
            for f in self.reads
        ]
        first += [b"\x60" + _multiplexer(f.address) + bytes(4) for f in self.writes]
        text = b"\x41" + _multiplexer(NAME) + struct.pack("<I", 12) + b"\x00Palpate" + b"\x15 SN-1\0\0"
        return [
            bytes([number, 0]) + answers for number, answers in enumerate([*first, 2 * text])
        ]  # a text is read twice

    def decode(self, data: bytes) -> None:
        number, control, rest = data[0] if data else 0, data[1] if len(data) > 1 else 0, data[2:]
        answers = [rest[at : at + 8] for at in range(0, len(rest), 8)]
        if control & SHORT and answers:
            answers[0] = answers[0][: control >> 4 & 7]
        self.link._answers_due.clear()
        self.network.sdo.responses.queue.clear()
        self.network.answers = list(answers)
        self.network.endless = bool(control & ENDLESS)
        number %= len(self.reads) + len(self.writes) + 1
        if number < len(self.reads):
            field = self.reads[number]
            value = self.node.get(field.name)
            held = held_by(answers, field.address, self.network.endless)
            require(held is not None and len(held) == field.size, "size", value, answers)
            (raw,) = struct.unpack(OF_TYPE[field.type], held or b"")
            require(same_number(raw * field.scale, value), "value", value, answers)
        elif number < len(self.reads) + len(self.writes):
            field = self.writes[number - len(self.reads)]
            self.node.set(field.name, next(iter(field.choices.values()), field.minimum or 0))
            confirmed = len(answers[0]) == 8 and answers[0][0] & 0xE0 == 0x60
            require(confirmed and answers[0][1:4] == _multiplexer(field.address), "confirmed", answers)
        else:
            text = self.node._text(NAME)
            held = held_by(answers, NAME, self.network.endless)
            require(held is not None and held.decode("ascii", "replace") == text, "text", text, answers)
            require(len(text) <= LARGEST_OBJECT, "size", len(text))


def _multiplexer(address: int) -> bytes:
    return struct.pack("<HB", address >> 8, address & 0xFF)


def held_by(answers: list[bytes], address: int, endless: bool) -> bytes | None:
    """The object that an upload gives, CiA 301; None: none."""
    if not answers or any(len(answer) != 8 for answer in answers[:1]):
        return None
    first = answers[0]
    if first[0] & 0xE0 != 0x40 or first[1:4] != _multiplexer(address):
        return None
    if first[0] & 2:
        return first[4 : 8 - (first[0] >> 2 & 3 if first[0] & 1 else 0)]
    data, toggle, at = b"", 0, 1
    while at < len(answers) or endless:
        answer = answers[at % len(answers)]
        if len(answer) != 8 or answer[0] & 0xE0 or answer[0] & 0x10 != toggle or len(data) > 2 * LARGEST_OBJECT:
            return None
        data += answer[1 : 8 - (answer[0] >> 1 & 7)]
        if answer[0] & 1:
            return data if not first[0] & 1 or len(data) == struct.unpack("<I", first[4:])[0] else None
        toggle ^= 0x10
        at += 1
    return None


class Frames:
    """A recording node, and a bus on which anything may come."""

    def __init__(self) -> None:
        transfers = Transfers()
        self.node = transfers.node
        transfers.link.open()
        network = transfers.link.network
        network.nodes.clear()
        for cob_id in (SAMPLES, STAMP):
            network.subscribe(cob_id, self.node._on_frame)
        network.subscribe(EMERGENCY, self.node._on_emergency)
        network.subscribe(HEARTBEAT, self.node._on_heartbeat)
        self.listener = _Listener(network.subscribers)
        transfers.link.close()

    def decode(self, data: bytes) -> None:
        self.node.emergencies.clear()
        self.node._data, self.node._sizes = bytearray(), bytearray()
        self.node._collected, self.node._most = 0, 1000
        ours: list[bytes] = []
        emergencies = 0
        at = 0
        while at + 4 <= len(data):
            flags, number, size = data[at], int.from_bytes(data[at + 1 : at + 3], "big") & 0x7FF, data[at + 3] % 65
            payload = data[at + 4 : at + 4 + size]
            at += 4 + size
            message = can.Message(
                arbitration_id=number,
                is_extended_id=bool(flags & EXTENDED),
                is_remote_frame=bool(flags & REMOTE),
                is_error_frame=bool(flags & ERROR),
                is_fd=bool(flags & FD),
                data=payload,
            )
            self.listener.on_message_received(message)
            if not flags & 0xF and number in (SAMPLES, STAMP):
                ours.append(payload)
            emergencies += not flags & 0xF and number == EMERGENCY
        require(len(self.node.emergencies) == emergencies, "emergencies", emergencies, data.hex())
        count = max(len(ours) // 2, 1)
        recording = self.node.collect(count)
        for sample in range(count):
            volts = [
                raw * scale for raw, scale in zip(_samples(ours[2 * sample]), self.node._volts_per_count, strict=True)
            ]
            counter, flags = struct.unpack("<IB", ours[2 * sample + 1])
            require(recording.voltage[:, sample].tolist() == volts, "volts", volts, data.hex())
            require(counter == sample + 1, "counter", counter, data.hex())
            require(
                recording.saturated[:, sample].tolist() == [bool(flags >> n & 1) for n in range(4)], "saturation", flags
            )


def _samples(payload: bytes) -> tuple[int, ...]:
    require(len(payload) == 8, "samples", payload.hex())
    return struct.unpack("<4h", payload)


def frame(number: int, payload: bytes, flags: int = 0) -> bytes:
    return bytes([flags]) + number.to_bytes(2, "big") + bytes([len(payload)]) + payload


def node_frames() -> Target:
    frames = Frames()
    pairs = [
        frame(SAMPLES, struct.pack("<4h", n, -n, 32767, -32768)) + frame(STAMP, struct.pack("<IB", n, n & 15))
        for n in range(1, 6)
    ]
    others = [
        frame(EMERGENCY, bytes(8)),
        frame(HEARTBEAT, b"\x05"),
        frame(HEARTBEAT, b""),
        frame(SAMPLES, bytes(8), EXTENDED),
    ]
    seeds = [b"".join(pairs[:n]) for n in range(1, 6)] + [pairs[0] + other + pairs[1] for other in others]
    return Target(seeds, frames.decode, [*pairs, *others])


def sdo_answers() -> Target:
    transfers = Transfers()
    return Target(transfers.seeds(), transfers.decode, [b"\x80\x03\x10\0\0\0\x02\x06", b"\x10Palpate", b"\0Palpate"])
