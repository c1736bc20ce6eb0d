"""Node id and bit rate by LSS: one device by its whole identity, and nothing without agreement."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import can
import canopen.lss
import pytest

from palpate.drivers.links.can import LssAddress
from palpate.instrument.bench.links import CanBus
from palpate.instrument.errors import DeviceError, LinkTimeout, RangeError, UsageError
from palpate.procedures.lab.scan import Change

ADDRESS = LssAddress(0x26C, 0x10, 0x06720000, 1234)
SELECTS = range(0x40, 0x44)


class Slave:
    """An LSS device after CiA 305, in plain python-can; `node` answers an SDO upload as well."""

    def __init__(self, bus: can.BusABC, node: int, refuses: int = 0) -> None:
        self._bus = bus
        self._given: list[int] = []
        self._configuring = False
        self._refuses = refuses
        self.node = node
        self.written: list[tuple[int, ...]] = []

    def on_message(self, message: can.Message) -> None:
        data = bytes(message.data)
        if message.arbitration_id == 0x600 + self.node:
            self._send(0x580 + self.node, b"\x80" + data[1:4] + bytes(4))
        if message.arbitration_id != 0x7E5:
            return
        code = data[0]
        if code == 0x04:
            self._configuring = bool(data[1])
        elif code in SELECTS:
            self._given = [*(self._given if code > 0x40 else []), struct.unpack_from("<I", data, 1)[0]]
            if LssAddress(*(self._given + [0] * 4)[:4]) == ADDRESS:
                self._configuring = True
                self._send(0x7E4, b"\x44" + bytes(7))
        elif self._configuring and code == 0x5E:
            self._send(0x7E4, bytes([code, self.node, *bytes(6)]))
        elif self._configuring:
            self.written.append(tuple(data[:3]))
            self._send(0x7E4, bytes([code, self._refuses, *bytes(6)]))

    def _send(self, identifier: int, data: bytes) -> None:
        self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Iterator[can.BusABC]:
    monkeypatch.setattr(canopen.lss.time, "sleep", lambda _seconds: None)
    with can.Bus(interface="virtual", channel="lss") as bus:
        yield bus


def change(node: int | None = 5, bitrate: int | None = None, timeout: str = "10 s", **more: Any) -> Change:
    link = CanBus(interface="virtual", channel="lss", timeout=timeout)  # type: ignore[arg-type]
    return Change(link, more.get("address", ADDRESS), node, bitrate, more.get("save", False))


def carried_out(bus: can.BusABC, slaves: list[Slave], wanted: Change) -> tuple[int | None, list[str]]:
    asked: list[str] = []
    notifier = can.Notifier(bus, [slave.on_message for slave in slaves], timeout=0.01)
    try:
        return wanted.carry_out(asked.append), asked
    finally:
        notifier.stop()


def test_a_node_id_a_bit_rate_and_the_order_to_keep_them_go_to_the_device_by_its_identity(bus: can.BusABC) -> None:
    slave = Slave(bus, 5)
    before, asked = carried_out(bus, [slave], change(5, 500_000, save=True))
    assert (before, slave.written) == (5, [(0x11, 5, 0), (0x13, 0, 2), (0x17, 0, 0)])
    assert "gets node id 5 and 500000 bit/s, and keeps it when it is switched off (it has node id 5 now)" in asked[0]


def test_nothing_is_written_before_a_person_agrees(bus: can.BusABC) -> None:
    slave = Slave(bus, 5)
    notifier = can.Notifier(bus, [slave.on_message], timeout=0.01)

    def never(_what: str) -> None:
        raise KeyboardInterrupt

    try:
        with pytest.raises(KeyboardInterrupt):
            change(5).carry_out(never)
    finally:
        notifier.stop()
    assert slave.written == []
    assert not slave._configuring


def test_nothing_is_kept_unless_it_is_asked_for(bus: can.BusABC) -> None:
    slave = Slave(bus, 5)
    carried_out(bus, [slave], change(5))
    assert slave.written == [(0x11, 5, 0)]


def test_a_node_id_that_is_taken_is_refused(bus: can.BusABC) -> None:
    slave = Slave(bus, 255)
    with pytest.raises(DeviceError, match="node 7 answers already on virtual:lss; give another --node"):
        carried_out(bus, [slave, Slave(bus, 7)], change(7))
    assert slave.written == []


def test_a_device_that_is_not_there_and_one_that_refuses_are_told(bus: can.BusABC) -> None:
    other = LssAddress(0x26C, 0x10, 0x06720000, 1)
    with pytest.raises(LinkTimeout, match="26Ch 10h 6720000h 1h on virtual:lss does not answer"):
        carried_out(bus, [Slave(bus, 5)], change(address=other, timeout="20 ms"))
    with pytest.raises(DeviceError, match=r"refuses to take node id 5 \(LSS Error: 1\)"):
        carried_out(bus, [Slave(bus, 5, refuses=1)], change(5))


@pytest.mark.parametrize(
    ("wanted", "error", "message"),
    [
        ({"node": None}, UsageError, "nothing to set"),
        ({"node": 128}, RangeError, "--node 128 is outside 1 to 127"),
        ({"node": None, "bitrate": 333_333, "save": True}, RangeError, "LSS knows 1000000, 800000"),
        ({"node": None, "bitrate": 500_000}, UsageError, "give --save, too"),
    ],
)
def test_what_cannot_be_set_is_refused_before_the_bus_is_opened(
    wanted: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        change(**wanted)
