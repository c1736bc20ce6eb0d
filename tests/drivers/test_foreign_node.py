"""The node's driver against a CANopen node that shares no code with it: plain python-can."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager

import can
import numpy as np
import pytest

from palpate.drivers.devices.sensor_node import CanopenSensorNode
from palpate.drivers.links.can import CanLink
from palpate.instrument.bench import links
from palpate.instrument.contracts.field import sdo
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock

NODE = 5
TOGGLE, LAST = 0x10, 0x01
SEGMENT, WRITE = 0x60, 0x20
NO_OBJECT = 0x0602_0000


class ForeignNode:
    """A sensor node as its maker might write it: no canopen, its objects in a dict, samples at each SYNC."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._left = b""
        self._toggle = 0
        self._count = 0
        self._operational = False
        self.objects = {f.address: _stored(f.name) for f in SENSOR_NODE.fields}
        self.objects[sdo(0x1009)] = b"rev B"
        self.objects[sdo(0x1014)] = (0x1C0 + NODE).to_bytes(4, "little")  # of its own choice
        self.objects[sdo(0x1018, 4)] = (0xF0F0).to_bytes(4, "little")
        self.objects[sdo(0x1800, 1)] = (0x180 + NODE).to_bytes(4, "little")

    def on_message(self, message: can.Message) -> None:
        match message.arbitration_id:
            case 0x000 if message.data[1] in (0, NODE):
                self._operational, self._count = message.data[0] == 1, 0
            case identifier if identifier == 0x600 + NODE:
                self._send(0x580 + NODE, self._answer(bytes(message.data)))

    def sample(self) -> None:
        """Samples as at a SYNC, which this node produces itself."""
        if self._operational and self.objects[sdo(0x1005)][3] & 0x40:
            self._count += 1
            self._send(0x1C0 + NODE, b"\x10\x81\x11" + bytes(5))
            self.objects[sdo(0x2001)] = self._count.to_bytes(4, "little")
            self._send(0x180 + NODE, struct.pack("<4h", self._count, -self._count, 0, 32767))
            self._send(0x280 + NODE, struct.pack("<IB", self._count, 0b1000))

    def _answer(self, request: bytes) -> bytes:
        command, address = request[0], request[1:4]
        place = sdo(int.from_bytes(address[:2], "little"), address[2])
        if command & 0xE0 == SEGMENT:
            return self._segment()
        if place not in self.objects:
            return b"\x80" + address + NO_OBJECT.to_bytes(4, "little")
        if command & 0xE0 == WRITE:
            self.objects[place] = request[4 : 8 - (command >> 2 & 3)]
            return b"\x60" + address + bytes(4)
        data = self.objects[place]
        if len(data) <= 4:
            return bytes([0x43 | (4 - len(data)) << 2]) + address + data.ljust(4, b"\0")
        self._left, self._toggle = data, 0
        return b"\x41" + address + len(data).to_bytes(4, "little")

    def _segment(self) -> bytes:
        part, self._left = self._left[:7], self._left[7:]
        head = self._toggle | (7 - len(part)) << 1 | (0 if self._left else LAST)
        self._toggle ^= TOGGLE
        return bytes([head]) + part.ljust(7, b"\0")

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


def _stored(name: str) -> bytes:
    field = SENSOR_NODE[name]
    if field.type == "text":
        return str(field.default).encode()
    return SENSOR_NODE.pack(name, float(field.default))


class Sampling(VirtualClock):
    """A clock on which the foreign node samples a thousand times a second."""

    def __init__(self, node: ForeignNode) -> None:
        super().__init__()
        self._node = node

    def wait(self, duration: float) -> None:
        for _ in range(round(duration * 1000)):
            self._node.sample()
        super().wait(duration)


@contextmanager
def foreign_node() -> Iterator[tuple[ForeignNode, CanopenSensorNode]]:
    with can.Bus(interface="virtual", channel="foreign") as bus:
        node = ForeignNode(bus)
        notifier = can.Notifier(bus, [node.on_message], timeout=0.01)
        link = CanLink(links.CanBus(interface="virtual", channel="foreign", timeout="10 s"))  # type: ignore[arg-type]
        link.open()
        try:
            yield node, CanopenSensorNode(link, NODE, Sampling(node))
        finally:
            link.close()
            notifier.stop()


def test_the_nodes_driver_uses_a_node_without_canopen(nothing_left_behind: None) -> None:
    with foreign_node() as (node, driver):
        driver.connect()
        assert (driver.serial, driver.simulated) == ("0000F0F0", False)
        driver.set_range(2, "500 mV")
        assert node.objects[sdo(0x2100, 2)] == b"\x01"
        recorded = driver.acquire(0.02)
        with pytest.raises(DeviceError, match="Object does not exist"):
            driver.link.upload("it", driver._node, 0x5000, 0)
    assert driver.emergencies == [b"\x10\x81\x11" + bytes(5)] * 20
    count = np.arange(1, 21)
    assert recorded.voltage[0] == pytest.approx(count * 5.0 / 32768)
    assert recorded.voltage[1] == pytest.approx(-count * 0.5 / 32768)
    assert recorded.saturated.sum(axis=1).tolist() == [0, 0, 0, 20]
