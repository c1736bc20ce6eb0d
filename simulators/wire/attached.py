"""A simulated CANopen node on a network: canopen answers for its objects, and its process data go in and out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import canopen
from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.bench.links import leave
from palpate.instrument.contracts.contract import Field, Pdo
from palpate.instrument.contracts.object_dictionary import object_dictionary
from palpate.simulators.wire.can_bus import LockedNetwork, open_bus
from palpate.simulators.wire.canopen_device import VALUE_RANGE, SdoServer, SimulatedNode

SDO_FRAME = 8  # bytes
CONSUMER, HEARTBEAT = 0x1016, 0x700  # object of the heartbeats that a node watches; their identifier less the node id
NODES = range(1, 128)
TOO_SHORT, NOT_ALLOWED = 0x8210, 0x8200  # emergencies: a PDO was not taken (CiA 301)
NO_SUBINDEX = 0x0609_0011
TOO_HIGH, TOO_LOW = 0x0609_0031, 0x0609_0032


def local_node(device: SimulatedNode) -> canopen.LocalNode:
    """canopen's local node for a device, with all objects of the device's contract."""
    local = canopen.LocalNode(device.id, object_dictionary(device.contract))
    local.sdo = SdoServer(local.sdo.rx_cobid, local.sdo.tx_cobid, local)  # type: ignore[no-untyped-call]
    return local


def attach(
    network: LockedNetwork,
    local: Any,
    device: SimulatedNode,
    before: Callable[[], object] = lambda: None,
    changed: Callable[[], object] = lambda: None,
) -> None:
    """Put a device on a network: `local` answers for its objects, and takes and sends its process data.

    Args:
        before: called ahead of each SDO frame.
        changed: called after each write of an object.
    """
    network.add_node(local)
    device.wire = _Attached(network, local, device)
    local.add_read_callback(_reader(device))
    # ahead of canopen's own callback, which would start a heartbeat even with a period that the writer refuses
    local._write_callbacks.insert(0, _writer(device, changed))
    local.sdo._index = local.sdo._subindex = 0  # canopen names them in an abort, even before any transfer has begun

    def handle(cob_id: int, data: bytearray, timestamp: float) -> None:
        if local.nmt.state != "STOPPED" and len(data) == SDO_FRAME:
            before()
            local.sdo.on_request(cob_id, data, timestamp)

    network.unsubscribe(local.sdo.rx_cobid, local.sdo.on_request)
    network.subscribe(local.sdo.rx_cobid, handle)
    for pdo in device.contract.receives:
        network.subscribe(pdo.cob_id(device.id), _receiver(local, device, pdo, changed))
        network.cyclic[pdo.cob_id(device.id)] = _cyclic_receiver(device, pdo)
    if any(f.index == CONSUMER for f in device.contract.fields):
        for node_id in NODES:
            network.subscribe(HEARTBEAT + node_id, _heartbeat_receiver(device, node_id))


@contextmanager
def serve(device: SimulatedNode, interface: str, channel: str) -> Iterator[None]:
    """Serve one device alone on a bus, as a context manager."""
    network = LockedNetwork(open_bus(interface, channel), device.clock)
    network.connect()
    try:
        attach(network, local_node(device), device)
        yield
    finally:
        leave(network)


def _field(device: SimulatedNode, index: int, subindex: int) -> Field | None:
    """The contract's field at an index and subindex; None for an object that canopen itself holds.

    Raises SdoAbortedError: there is no such subindex (canopen's arrays would answer for any).
    """
    siblings = {f.subindex: f for f in device.contract.fields if f.index == index}
    if siblings and subindex not in (0, *siblings):
        raise SdoAbortedError(NO_SUBINDEX)
    return siblings.get(subindex)


def _reader(device: SimulatedNode) -> Any:
    def read(*, index: int, subindex: int, od: object) -> Any:
        if device.process_data.has(index):
            return device.process_data.read(index, subindex)
        field = _field(device, index, subindex)
        return None if field is None else device.read(field)

    return read


def _receiver(local: Any, device: SimulatedNode, declared: Pdo, changed: Callable[[], object]) -> Any:
    """Takes the frames of a PDO; one that is too short or holds a value that is not allowed changes nothing."""

    def receive(_cob_id: int, data: bytearray, _timestamp: float) -> None:
        pdo = device.process_data.as_set(declared)
        if local.nmt.state != "OPERATIONAL" or pdo is None:
            return
        parts = device.contract.parts(pdo, bytes(data))
        if len(parts) < len(pdo.fields):
            device.emergency(TOO_SHORT)
            return
        values = {name: device.contract.decode(name, part) for name, part in parts.items()}
        if not all(device.contract.allows(name, value) for name, value in values.items()):
            device.emergency(NOT_ALLOWED)
            return
        device.receive(pdo, values)
        changed()

    return receive


def _cyclic_receiver(device: SimulatedNode, declared: Pdo) -> Callable[[Sequence[bytes], int], object]:
    """Takes a list of cyclic frames, unless one is too short or holds a value that is not allowed."""
    contract = device.contract

    def receive(frames: Sequence[bytes], period_us: int) -> None:
        pdo = device.process_data.as_set(declared)
        if pdo is None:
            return
        values = []
        for data in frames:
            parts = contract.parts(pdo, data)
            values.append({name: contract.decode(name, part) for name, part in parts.items()})
        if any(len(each) < len(pdo.fields) for each in values):
            device.emergency(TOO_SHORT)
        elif not all(contract.allows(name, value) for each in values for name, value in each.items()):
            device.emergency(NOT_ALLOWED)
        else:
            device.receive_cycle(pdo, values, 1000 * period_us)

    return receive


def _heartbeat_receiver(device: SimulatedNode, node_id: int) -> Any:
    return lambda _cob_id, _data, _timestamp: device.heard(node_id)


class _Attached:
    """Meets `Wire`."""

    def __init__(self, network: LockedNetwork, local: Any, device: SimulatedNode) -> None:
        self._network, self._local, self._device = network, local, device

    @property
    def operational(self) -> bool:
        return bool(self._local.nmt.state == "OPERATIONAL")

    def transmit(self, pdo: Pdo) -> None:
        if self._local.nmt.state == "OPERATIONAL":
            self._network.send_message(pdo.cob_id(self._device.id), self._device.packed(pdo))

    def emergency(self, code: int) -> None:
        self._local.emcy.send(code, int(self._device.settings.get("error_register", 0)))


def _writer(device: SimulatedNode, changed: Callable[[], object]) -> Any:
    contract = device.contract

    def write(*, index: int, subindex: int, od: object, data: bytes) -> None:
        if device.process_data.has(index):
            device.process_data.write(index, subindex, int.from_bytes(data, "little"))
            return
        field = _field(device, index, subindex)
        if field is None:
            return
        if field.type == "text":
            device.write_text(field, bytes(data).decode("ascii", "replace"))
            return
        value = contract.decode(field.name, bytes(data), {name: device.settings[name] for name in field.beside})
        if not contract.allows(field.name, value):
            if field.maximum is not None and value > field.maximum:
                raise SdoAbortedError(TOO_HIGH)
            if field.minimum is not None and value < field.minimum:
                raise SdoAbortedError(TOO_LOW)
            raise SdoAbortedError(VALUE_RANGE)
        device.write(field, value)
        changed()

    return write
