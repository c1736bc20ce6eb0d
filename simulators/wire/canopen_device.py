"""What all simulated CANopen nodes share: the objects of their contract, and the refusal of what a node must refuse."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, Self

import canopen
import numpy as np
import numpy.typing as npt
from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.contracts.contract import Contract, Field, Pdo
from palpate.instrument.contracts.object_dictionary import object_dictionary
from palpate.instrument.contracts.pdo import is_relative
from palpate.instrument.contracts.wire_types import codec
from palpate.simulators.clock import VirtualClock
from palpate.simulators.linear.lti import Floats
from palpate.simulators.wire.can_bus import LockedNetwork, open_bus
from palpate.simulators.wire.device import Place
from palpate.simulators.wire.pdo_objects import PdoObjects
from palpate.simulators.wire.sdo_server import SdoServer

Times = npt.NDArray[np.int64]

SDO_FRAME = 8  # bytes
CONSUMER, HEARTBEAT = 0x1016, 0x700  # object of the heartbeats that a node watches; their identifier less the node id
NODES = range(1, 128)
TOO_SHORT, NOT_ALLOWED = 0x8210, 0x8200  # emergencies: a PDO was not taken (CiA 301)
NO_SUBINDEX = 0x0609_0011
VALUE_RANGE, TOO_HIGH, TOO_LOW = 0x0609_0030, 0x0609_0031, 0x0609_0032


class Wire(Protocol):
    """What a node can do on the bus by itself."""

    @property
    def operational(self) -> bool:
        """Whether the node is in the NMT state in which it exchanges process data."""

    def transmit(self, pdo: Pdo) -> None:
        """Send process data now; a node that is not operational sends none."""

    def emergency(self, code: int) -> None:
        """Send an emergency message."""


class CanopenDevice:
    """The state of one node. Methods are called under the clock's lock."""

    contract: Contract
    wire: Wire | None = None  # None until the node is attached to a network
    speed = 1.0  # speed of this clock relative to the clients' clock
    rig: Any  # that of its place, once it stands on a bench

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the node for its place on a bench; a node whose constructor takes more arguments overrides this."""
        made = cls(place.clock, place.unit, place.serial)
        made.rig = place.rig
        return made

    def __init__(self, clock: VirtualClock, node_id: int, serial: int) -> None:
        self.id = node_id
        self.clock = clock
        self._serial = serial
        self.process_data = PdoObjects(self.contract, node_id)
        self.reset()

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.settings = {f.name: float(f.default) for f in self.contract.fields if f.type != "text"}
        self.settings["serial"] = float(self._serial)
        self.process_data.reset()

    def start(self) -> None:
        """Called when the node enters the NMT state operational."""

    def stop(self) -> None:
        """Called when a client ends the NMT state operational."""

    def read(self, field: Field) -> Any:
        """Raw value of an object, for the SDO server."""
        if field.name == "hardware_version":
            return "simulated"
        if field.type == "text":
            return field.default
        relative = self.id if is_relative(field.index, field.subindex) else 0
        return field.to_raw(self.settings[field.name]) + relative

    def write(self, field: Field, value: float) -> None:
        """Store a new physical value of a setting, which has been checked against the contract."""
        self.settings[field.name] = value

    def write_text(self, field: Field, text: str) -> None:
        """Take a text that a client writes."""
        raise SdoAbortedError(VALUE_RANGE)

    def receive(self, pdo: Pdo, values: Mapping[str, float]) -> None:
        """Take process data, whose values have been checked against the contract."""
        for name in pdo.fields:
            self.write(self.contract[name], values[name])

    def receive_cycle(self, pdo: Pdo, values: Sequence[Mapping[str, float]], period_ns: int) -> None:
        """Take process data that come over and over from now on, one each `period_ns`; none: they have ended."""

    def heard(self, node_id: int) -> None:
        """Called at each heartbeat of another node, if this one can watch them (1016h)."""

    def transmit(self, name: str) -> None:
        """Send the PDO of that name now; a node that is not operational sends none. Raises UnknownName."""
        pdo = self.process_data.as_set(self.contract.sent(name))
        if self.wire is not None and pdo is not None:
            self.wire.transmit(pdo)

    def emergency(self, code: int) -> None:
        """Send an emergency message."""
        if self.wire is not None:
            self.wire.emergency(code)

    def at_sync(self) -> list[Pdo]:
        """The PDOs that the node sends at each SYNC, by their transmission types, as they are set now."""
        sent = [pdo for pdo in self.contract.pdos if self.process_data.at_sync(pdo, self.settings)]
        return [pdo for pdo in map(self.process_data.as_set, sent) if pdo is not None]

    def frames_at(self, time_ns: Times, films: Callable[[], Floats], period_ns: int) -> list[tuple[int, list[bytes]]]:
        """What the node sends at some SYNCs: the identifier of each message with the data of all its frames.

        Args:
            time_ns: times of the SYNCs, shape (n,) [ns].
            films: gives the voltages of all films at these times, shape (films, n) [V].
            period_ns: the SYNC period [ns].
        """
        return [(pdo.cob_id(self.id), len(time_ns) * [self.packed(pdo)]) for pdo in self.at_sync()]

    def packed(self, pdo: Pdo) -> bytes:
        """Data of a PDO as the objects are now."""
        fields = [self.contract[name] for name in pdo.fields]
        return b"".join(codec(f.type, "<").pack(self.read(f)) for f in fields)


def local_node(device: CanopenDevice) -> canopen.LocalNode:
    """canopen's local node for a device, with all objects of the device's contract."""
    local = canopen.LocalNode(device.id, object_dictionary(device.contract))
    local.sdo = SdoServer(local.sdo.rx_cobid, local.sdo.tx_cobid, local)  # type: ignore[no-untyped-call]
    return local


def attach(
    network: LockedNetwork,
    local: Any,
    device: CanopenDevice,
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
        if device.process_data.has(index):
            return device.process_data.read(index, subindex)
        field = _field(device, index, subindex)
        return None if field is None else device.read(field)

    return read


def _receiver(local: Any, device: CanopenDevice, declared: Pdo, changed: Callable[[], object]) -> Any:
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


def _cyclic_receiver(device: CanopenDevice, declared: Pdo) -> Callable[[Sequence[bytes], int], object]:
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


def _heartbeat_receiver(device: CanopenDevice, node_id: int) -> Any:
    return lambda _cob_id, _data, _timestamp: device.heard(node_id)


class _Attached:
    """Meets `Wire`."""

    def __init__(self, network: LockedNetwork, local: Any, device: CanopenDevice) -> None:
        self._network, self._local, self._device = network, local, device

    @property
    def operational(self) -> bool:
        return bool(self._local.nmt.state == "OPERATIONAL")

    def transmit(self, pdo: Pdo) -> None:
        if self._local.nmt.state == "OPERATIONAL":
            self._network.send_message(pdo.cob_id(self._device.id), self._device.packed(pdo))

    def emergency(self, code: int) -> None:
        self._local.emcy.send(code, int(self._device.settings.get("error_register", 0)))


def _writer(device: CanopenDevice, changed: Callable[[], object]) -> Any:
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
