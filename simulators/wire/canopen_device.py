"""What all simulated CANopen nodes share: the objects of their contract, and the refusal of what a node must refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar, Self

import canopen
from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.object_dictionary import object_dictionary
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.can_bus import LockedNetwork, open_bus
from palpate.simulators.wire.device import Place
from palpate.simulators.wire.sdo_server import SdoServer

SDO_FRAME = 8  # bytes
NO_SUBINDEX = 0x0609_0011
VALUE_RANGE, TOO_HIGH, TOO_LOW = 0x0609_0030, 0x0609_0031, 0x0609_0032


class CanopenDevice:
    """The state of one node. Methods are called under the clock's lock."""

    contract: ClassVar[Contract]
    speed = 1.0  # speed of this clock relative to the clients' clock

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the node for its place on a bench; a node whose constructor takes more arguments overrides this."""
        return cls(place.clock, place.unit, place.serial)

    def __init__(self, clock: VirtualClock, node_id: int, serial: int) -> None:
        self.id = node_id
        self.clock = clock
        self._serial = serial
        self.reset()

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.settings = {f.name: float(f.default) for f in self.contract.fields if f.type != "text"}
        self.settings["serial"] = float(self._serial)

    def start(self) -> None:
        """Called when the node enters the NMT state operational."""

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        if field.name == "hardware_version":
            return "simulated"
        if field.type == "text":
            return field.default
        return round(self.settings[field.name] / field.scale)

    def write(self, field: Field, value: float) -> None:
        """Store a new physical value of a setting, which has been checked against the contract."""
        self.settings[field.name] = value


def local_node(device: CanopenDevice) -> canopen.LocalNode:
    """canopen's local node for a device, with all objects of the device's contract."""
    local = canopen.LocalNode(device.id, object_dictionary(device.contract))
    local.sdo = SdoServer(local.sdo.rx_cobid, local.sdo.tx_cobid, local)  # type: ignore[no-untyped-call]
    return local


def attach(
    network: LockedNetwork, local: Any, device: CanopenDevice, before: Callable[[], object] = lambda: None
) -> None:
    """Put a device on a network: `local` answers for its objects, and calls `before` ahead of each SDO frame."""
    network.add_node(local)
    local.add_read_callback(_reader(device))
    # ahead of canopen's own callback, which would start a heartbeat even with a period that the writer refuses
    local._write_callbacks.insert(0, _writer(device))
    local.sdo._index = local.sdo._subindex = 0  # canopen names them in an abort, even before any transfer has begun

    def handle(cob_id: int, data: bytearray, timestamp: float) -> None:
        if local.nmt.state != "STOPPED" and len(data) == SDO_FRAME:
            before()
            local.sdo.on_request(cob_id, data, timestamp)

    network.unsubscribe(local.sdo.rx_cobid, local.sdo.on_request)
    network.subscribe(local.sdo.rx_cobid, handle)


@contextmanager
def serve(device: CanopenDevice, interface: str, channel: str) -> Iterator[None]:
    """Serve one device alone on a bus, as a context manager."""
    network = LockedNetwork(open_bus(interface, channel), device.clock)
    network.connect()
    try:
        attach(network, local_node(device), device)
        yield
    finally:
        network.disconnect()


def _field(device: CanopenDevice, index: int, subindex: int) -> Field | None:
    """The contract's field at an index and subindex; None for an object that canopen itself holds.

    Raises SdoAbortedError: there is no such subindex (canopen's arrays would answer for any).
    """
    siblings = {f.subindex: f for f in device.contract.fields if f.index == index}
    if siblings and subindex not in (0, *siblings):
        raise SdoAbortedError(NO_SUBINDEX)
    return siblings.get(subindex)


def _reader(device: CanopenDevice) -> Any:
    def read(*, index: int, subindex: int, od: object) -> Any:
        field = _field(device, index, subindex)
        return None if field is None else device.read(field)

    return read


def _writer(device: CanopenDevice) -> Any:
    contract = device.contract

    def write(*, index: int, subindex: int, od: object, data: bytes) -> None:
        field = _field(device, index, subindex)
        if field is None:
            return
        value = contract.decode(field.name, bytes(data))
        if not contract.allows(field.name, value):
            if field.maximum is not None and value > field.maximum:
                raise SdoAbortedError(TOO_HIGH)
            if field.minimum is not None and value < field.minimum:
                raise SdoAbortedError(TOO_LOW)
            raise SdoAbortedError(VALUE_RANGE)
        device.write(field, value)

    return write
