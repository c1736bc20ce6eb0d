"""The CAN bus between simulated nodes and their clients."""

from __future__ import annotations

import itertools
import logging
import os
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Self

import can
import canopen
from can.interfaces.virtual import VirtualBus
from canopen.network import MessageListener
from canopen.sdo.exceptions import SdoAbortedError

from palpate.instrument.bench.links import (
    MULTICAST,
    WITHIN_MACHINE,
    Block,
    arrived,
    close_bus_in_child,
    keep_to_group,
    leave,
    takes_blocks,
)
from palpate.instrument.contracts.contract import Field, Pdo
from palpate.instrument.contracts.declaration import Receiver
from palpate.instrument.contracts.object_dictionary import object_dictionary
from palpate.instrument.errors import BenchError
from palpate.instrument.own_process import close_in_child
from palpate.simulators.clock import VirtualClock
from palpate.simulators.wire.canopen_device import VALUE_RANGE, SdoServer, SimulatedNode

# --- the bus -------------------------------------------------------------------------------------------


canopen.Network.NOTIFIER_CYCLE = 0.05  # s; closing waits for one cycle; canopen's default of 1 s is too slow

for _name in ("can", "canopen"):
    logging.getLogger(_name).addHandler(logging.NullHandler())  # keeps a client's bad frames out of our stderr

_numbers = itertools.count(1)
GROUPS = 1 << 16  # number of multicast groups, 239.74.0.0/16


class _Frame(can.Message):
    """A CAN frame that is constant after it was sent, so that all receivers on the virtual bus can share it.

    Attributes:
        time_ns: time on the bench's clock at which it is sent [ns].
    """

    __slots__ = ("time_ns",)
    time_ns: int

    @classmethod
    def of(cls, time_ns: int, cob_id: int, data: bytes) -> Self:
        """Make a frame faster than python-can's constructor, which checks arguments that are known to be good here."""
        frame = cls.__new__(cls)
        frame.time_ns = time_ns
        frame.arbitration_id, frame.data, frame.dlc = cob_id, bytearray(data), len(data)
        frame.timestamp, frame.channel, frame.is_rx = 0.0, None, True
        frame.is_extended_id = frame.is_remote_frame = frame.is_error_frame = False
        frame.is_fd = frame.bitrate_switch = frame.error_state_indicator = False
        return frame

    def __deepcopy__(self, memo: object) -> Self:
        return self


class _Virtual(VirtualBus):
    """python-can's virtual bus, which connects clients in this process."""

    def hand_over(self, block: Block) -> None:
        """Give a block of frames whole to each receiver that takes blocks, and frame by frame to others."""
        self._check_if_open()
        for receiver in self.channel:
            if receiver is self.queue:
                continue
            if takes_blocks(receiver):
                receiver.put(block)  # type: ignore[arg-type]
            else:
                for each in block.frames():
                    receiver.put(_Frame.of(*each))


def own_channel(interface: str) -> str:
    """A channel of python-can that no other bench on this machine uses."""
    if interface != MULTICAST:
        return f"palpate-{os.getpid()}-{next(_numbers)}"
    while True:
        number = (os.getpid() + next(_numbers)) % GROUPS
        group = f"239.74.{number >> 8}.{number & 255}"
        with suppress(BenchError), _claimed(group):
            return group


def _claimed(group: str) -> socket.socket:
    """Claim a multicast group for one served bench of this machine, until the claim is closed or the process ends.

    On a shared group the nodes of two benches would answer each other's clients. A client claims nothing.

    Raises BenchError: another bench is served on this group.
    """
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f"\0palpate {group}")  # an abstract name: Linux makes no file for it
    except OSError:
        claim.close()
        raise BenchError(
            f"CAN bus {MULTICAST}:{group} is in use by another served bench; leave the channel out, or give another one"
        ) from None
    return claim


def open_bus(interface: str, channel: str) -> can.BusABC:
    """Open a bus of python-can. Raises BenchError: it cannot be opened, or another bench is served on it."""
    with ExitStack() as stack:
        claim = stack.enter_context(_claimed(channel)) if interface == MULTICAST else None
        options = WITHIN_MACHINE if interface == MULTICAST else {}
        try:
            bus = _Virtual(channel) if interface == "virtual" else can.Bus(channel, interface, **options)
        except Exception as error:  # each interface of python-can raises other types, even NameError
            raise BenchError(
                f"CAN bus {interface}:{channel} cannot be opened: {error}; give another interface"
            ) from error
        close_bus_in_child(bus)
        if claim is not None:
            close_in_child(claim, lambda found: [found.fileno()])
            keep_to_group(bus)
            _release_with(bus, claim)
        stack.pop_all()
    return bus


def _release_with(bus: can.BusABC, claim: socket.socket) -> None:
    shut_down = bus.shutdown

    def shutdown() -> None:
        shut_down()
        claim.close()

    bus.shutdown = shutdown  # type: ignore[method-assign]


def hand_over(bus: can.BusABC, block: Block) -> None:
    """Send a block of frames: whole on a virtual bus, unless an injected fault has replaced its `send`."""
    if isinstance(bus, _Virtual) and "send" not in vars(bus):
        bus.hand_over(block)
        return
    for each in block.frames():
        bus.send(_Frame.of(*each))


class MendedListener(MessageListener):
    """canopen's listener, with two of its faults mended; it also takes lists of cyclic frames for the bus.

    canopen takes an extended identifier for a standard one, and stops at the first data that are no frame.
    """

    network: LockedNetwork

    def on_message_received(self, msg: can.Message) -> None:
        if msg.is_fd:
            return
        if msg.is_extended_id:
            self.network.handed_over(msg.arbitration_id, bytes(msg.data))
        else:
            super().on_message_received(msg)  # type: ignore[no-untyped-call]

    def on_error(self, exc: Exception) -> None:
        """Go on after an error, unless the bus itself has failed."""
        if isinstance(exc.__cause__, OSError) or self.network.notifier is None:
            raise NotImplementedError
        self.network.notifier.exception = None  # while it is set, canopen sends nothing


class LockedNetwork(canopen.Network):
    """canopen's network; it handles each frame, and so sends each answer, under the clock's lock.

    Attributes:
        cyclic: for each identifier, what is called with the frames that come over and over from now on, and with the
            time between two of them [us]; without frames they have ended.
    """

    def __init__(self, bus: can.BusABC, clock: VirtualClock) -> None:
        super().__init__(bus)
        self._own = bus
        self.clock = clock
        self.listeners = [MendedListener(self)]
        self.cyclic: dict[int, Callable[[Sequence[bytes], int], object]] = {}
        self._receiver = Receiver()

    def take(self) -> bool:
        """Handle the frames that have come, as python-can's thread does where no steps do; whether there were any."""
        frames = arrived(self._own)
        for frame in frames:
            for listener in self.listeners:
                with suppress(Exception):  # what is wrong with a client's frame is no matter of the next one
                    listener(frame)
        return bool(frames)

    def handed_over(self, identifier: int, data: bytes) -> None:
        """Take a frame with a 29-bit identifier, which may hand over a list of cyclic frames."""
        with self.clock.lock:
            if (found := self._receiver.heard(identifier, data)) is not None and found[0] in self.cyclic:
                self.cyclic[found[0]](found[1], found[2])

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame like canopen does, but without a copy for each receiver."""
        self._own.send(_Frame.of(self.clock.now_ns(), can_id, data))
        self.check()

    def notify(self, can_id: int, data: bytearray, timestamp: float) -> None:
        with self.clock.lock:
            try:
                super().notify(can_id, data, timestamp)
            except Exception as error:
                self.clock.failed(error)
                raise


class _Periodic:
    """A periodic message on the virtual clock, with the methods that canopen's heartbeat calls."""

    def __init__(self, network: VirtualNetwork, cob_id: int, data: bytes, period_ns: int) -> None:
        self._network = network
        self._cob_id = cob_id
        self._data = bytes(data)
        self._period_ns = period_ns
        self.due_ns = network.clock.now_ns() + period_ns
        network.periodic.append(self)

    def stop(self) -> None:
        self._network.periodic.remove(self)

    def update(self, data: bytes) -> None:
        self._data = bytes(data)

    def send(self) -> None:
        self._network.send_message(self._cob_id, self._data)
        self.due_ns += self._period_ns


class VirtualNetwork(LockedNetwork):
    """canopen's network with periodic messages sent on the bench's clock."""

    def __init__(self, bus: can.BusABC, clock: VirtualClock) -> None:
        super().__init__(bus, clock)
        self.periodic: list[_Periodic] = []

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> Any:
        return _Periodic(self, can_id, data, round(period * 1e9))


# --- a node on it --------------------------------------------------------------------------------------


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
