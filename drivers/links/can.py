"""CAN links; the only import of python-can and canopen in the drivers."""

from __future__ import annotations

import itertools
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import astuple, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import can
import canopen
from can.interfaces.virtual import VirtualBus
from canopen.lss import LssError, LssMaster
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from palpate.drivers.clock import WallClock
from palpate.drivers.links import causes
from palpate.instrument.bench import links as files
from palpate.instrument.bench.links import (
    MULTICAST,
    WITHIN_MACHINE,
    Block,
    CanBus,
    Octets,
    Stepper,
    arrived,
    close_bus_in_child,
    keep_to_group,
    leave,
    take_blocks,
)
from palpate.instrument.contracts.declaration import hand_over
from palpate.instrument.contracts.own import shortest_transfer
from palpate.instrument.errors import ConfigError, DeviceError, LinkError, LinkTimeout, UnknownName
from palpate.instrument.own_process import OwnLock

# --- SDO transfers (CiA 301): the answer that belongs to a request -------------------------------------


LATE_ANSWERS = 10  # greatest number that an interrupted transfer can leave; a node that sends more is not trusted
LARGEST_OBJECT = 4096  # bytes; a device name has some tens
SEGMENT = 7  # bytes of an object in a frame
FRAME = 8  # bytes
SPECIFIER, TOGGLE = 0xE0, 0x10  # bits of a command
DOWNLOAD, UPLOAD, UPLOAD_SEGMENT, DOWNLOAD_SEGMENT, ABORT = 0x20, 0x40, 0x60, 0x00, 0x80
ANSWER_OF = {DOWNLOAD: 0x60, UPLOAD: 0x40, UPLOAD_SEGMENT: 0x00, DOWNLOAD_SEGMENT: 0x20}
TIMED_OUT = 0x0504_0000
NO_OBJECT = bytes(3)


class CheckedSdoClient(SdoClient):
    """SDO client that checks answers; canopen's own takes the first answer that comes, of any length.

    Answers have no number. A late or repeated answer is known by its object, by its toggle bit, or because it came
    before request and answer could have been on the bus; it is skipped. The frames of a text do not name their object,
    so a text is read twice, and both readings must agree.

    Attributes:
        shortest: shortest time that request and answer take on the bus [s]; 0 where there is no wire.
        too_soon: number of answers to the last request that came sooner.
        stepper: see `palpate.drivers.clock.BenchClock`.
    """

    shortest = 0.0
    too_soon = 0
    stepper: Stepper | None = None
    _object = NO_OBJECT  # index and subindex of the transfer

    def on_response(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if len(data) == FRAME and self.responses.qsize() <= LATE_ANSWERS:
            super().on_response(can_id, data, timestamp)  # type: ignore[no-untyped-call]

    def request_response(self, sdo_request: bytearray) -> bytes:
        """Send a request and return its answer. Raises SdoCommunicationError: none came in time; SdoAbortedError."""
        request = bytes(sdo_request)
        if request[0] & SPECIFIER in (DOWNLOAD, UPLOAD):
            self._object = request[1:4]
        self._forget()
        self.too_soon = 0
        earliest = self.now() + self.shortest
        self.send_request(request)  # type: ignore[no-untyped-call]
        until = self.now() + self.RESPONSE_TIMEOUT
        for heard in itertools.count():
            left = max(until - self.now(), 0.0)
            if not left and heard > LATE_ANSWERS:
                break
            try:
                answer = self.next_answer(left)
            except queue.Empty:
                break
            if self.now() < earliest:
                self.too_soon += 1
                continue
            if answer[0] == ABORT and answer[1:4] in (self._object, NO_OBJECT):
                raise SdoAbortedError(int.from_bytes(answer[4:], "little"))
            if self._answers(answer, request):
                return answer
        self.abort(TIMED_OUT)  # type: ignore[no-untyped-call]
        raise SdoCommunicationError("no answer in time")

    def next_answer(self, within: float) -> bytes:
        """The next answer of the node, to whatever request. Raises queue.Empty: none comes for so long [s]."""
        if self.stepper is not None:
            until = self.now() + within
            self.stepper.step()
            while self.responses.empty() and (left := until - self.now()) > 0:
                self.stepper.glance(left)
            within = 0.0
        answer: bytes = self.responses.get(timeout=within)
        return answer

    def _answers(self, answer: bytes, request: bytes) -> bool:
        asked = request[0] & SPECIFIER
        if answer[0] & SPECIFIER != ANSWER_OF.get(asked):
            return False
        if asked in (DOWNLOAD, UPLOAD):
            return answer[1:4] == self._object
        return answer[0] & TOGGLE == request[0] & TOGGLE

    def _forget(self) -> None:
        """Throw away answers that came before they were asked for."""
        while not self.responses.empty():
            self.responses.get()

    def now(self) -> float:
        """Time by which answers are late or too soon [s]."""
        return time.monotonic()

    def upload(self, index: int, subindex: int, size: int | None = None) -> bytes:
        """Read an object, which must have the announced size; without one, the first `size` of its four bytes.

        Raises:
            SdoCommunicationError: the object has another size or no end, or its frames differ when they are read again.
            SdoAbortedError: the node refuses.
        """
        data, in_segments = self._read(index, subindex, size)
        if in_segments and self._read(index, subindex, size)[0] != data:
            raise SdoCommunicationError("two reads of the object gave different values")
        return data

    def _read(self, index: int, subindex: int, size: int | None) -> tuple[bytes, bool]:
        """An object, and whether it came in segments."""
        with self.open(index, subindex, "rb", buffering=0) as stream:  # type: ignore[no-untyped-call]
            segments = list(itertools.islice(iter(lambda: stream.read(SEGMENT), b""), LARGEST_OBJECT // SEGMENT))
            data = b"".join(segments)
            if not stream._done or stream.size not in (None, len(data)):
                raise SdoCommunicationError(f"object of {len(data)} bytes, {stream.size} were announced")
            unsaid = stream.exp_data is not None and stream.size is None
            in_segments = stream.exp_data is None
        return data[:size] if unsaid else data, in_segments


# -------------------------------------------------------------------------------------------------------
# Frames that a CAN bus sends over and over by itself, on time, whatever this program is doing meanwhile

KERNEL = "socketcan"  # the interface of python-can whose cyclic frames the kernel sends
WITHIN = ("virtual", MULTICAST)  # buses within this machine, whose other end is palpate's own
LONGEST_US = 60_000_000


class Cyclic:
    """The lists of frames that one bus sends over and over.

    The kernel forgets its lists when this program ends in any way. A bus within this machine goes on with them.
    """

    def __init__(self, bus: can.BusABC, interface: str, name: str) -> None:
        self._bus, self._interface, self._name = bus, interface, name
        self._tasks: dict[int, can.CyclicSendTaskABC | None] = {}

    def check(self) -> None:
        """Raises LinkError: nothing sends frames on time on this interface."""
        if self._interface not in (KERNEL, *WITHIN):
            raise LinkError(
                f"CAN bus {self._name}: {self._interface} cannot send set-points on time, because no timer of the "
                f"kernel does; use an adapter with interface = {KERNEL!r}"
            )

    def begin(self, cob_id: int, frames: Sequence[bytes], period_us: int) -> None:
        """From now on send these frames in turn, the first at once; they replace those of the same identifier.

        Args:
            cob_id: identifier of the frames.
            frames: their data, up to `palpate.instrument.contracts.declaration.MOST_CYCLIC`.
            period_us: time between two frames [us].

        Raises LinkError: nothing sends frames on time on this interface, or it failed.
        """
        self.check()
        if self._interface == KERNEL:
            self.end(cob_id)
            listed = [can.Message(arbitration_id=cob_id, data=data, is_extended_id=False) for data in frames]
            self._tasks[cob_id] = self._bus.send_periodic(listed, 1e-6 * period_us)
        else:
            self._hand_over(cob_id, frames, period_us)
            self._tasks[cob_id] = None

    def end(self, cob_id: int) -> None:
        """Send no more of the frames with this identifier. Raises can.CanError: the bus failed."""
        if cob_id not in self._tasks:
            return
        task = self._tasks.pop(cob_id)
        if task is None:
            self._hand_over(cob_id, (), 0)
        else:
            task.stop()

    def end_all(self) -> None:
        """As `end`, for all lists."""
        for cob_id in list(self._tasks):
            self.end(cob_id)

    def _hand_over(self, cob_id: int, frames: Sequence[bytes], period_us: int) -> None:
        for identifier, data in hand_over(cob_id, frames, period_us):
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=True))


# --- the link ------------------------------------------------------------------------------------------

for _name in ("can", "canopen"):  # their warnings would go to stderr; whatever fails is raised
    logging.getLogger(_name).addHandler(logging.NullHandler())
canopen.Network.NOTIFIER_CYCLE = 0.05  # s; closing a real bus waits for one cycle, the default is a second

HEARTBEAT = 0x700  # identifier of a heartbeat, without the node id
OPERATIONAL = b"\x05"  # state that it tells
SYNC = 0x080
FUNCTION, FROM_NODES = 0x780, (0x080, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700)  # functions that nodes send (CiA 301)
NOT_ACKNOWLEDGED = 0x20  # bit of an error frame's identifier (CAN_ERR_ACK of Linux)

FrameCallback = Callable[[int, bytearray, float], None]
FrameTap = Callable[[bool, can.Message], None]
BlockCallback = Callable[[Mapping[int, Octets]], None]


def has_wire(bus: files.CanBus) -> bool:
    """Whether frames take time on a real wire; not on a bus within this machine, which Linux lists as virtual."""
    if bus.interface == "socketcan":
        return not Path("/sys/devices/virtual/net", bus.channel).exists()
    return bus.interface not in ("virtual", MULTICAST)


class _BlockFrame(can.Message):
    """A frame of a block, with its time on the bench's clock [ns]."""

    __slots__ = ("time_ns",)

    def __init__(self, time_ns: int, cob_id: int, data: bytes) -> None:
        super().__init__(arbitration_id=cob_id, data=data, is_extended_id=False)
        self.time_ns = time_ns


class _Listener(can.Listener):
    """Passes standard data frames to subscribers; canopen's own takes an extended identifier for a standard one."""

    errors = 0  # frames that were destroyed on the bus; controllers send them again
    destroyed = 0  # the same since the bus was opened
    unheard = 0  # of them those of our own that nobody acknowledged
    nodes = False  # whether any node has sent a frame
    own = 0  # identifier of this program's heartbeat, which some interfaces give back

    def __init__(self, subscribers: Mapping[int, Sequence[FrameCallback]]) -> None:
        self._subscribers = subscribers
        self.whole: dict[FrameCallback, BlockCallback] = {}  # who takes blocks, by what they would take frames with

    def on_message_received(self, msg: can.Message | Block) -> None:
        if isinstance(msg, Block):
            self._take(msg)
            return
        if msg.is_error_frame:
            self.errors += 1
            self.destroyed += 1
            self.unheard += bool(msg.arbitration_id & NOT_ACKNOWLEDGED)
            return
        self.nodes |= self._of_node(msg.arbitration_id)
        if not (msg.is_extended_id or msg.is_fd or msg.is_remote_frame):
            try:
                for callback in self._subscribers.get(msg.arbitration_id, ()):
                    callback(msg.arbitration_id, msg.data, msg.timestamp)
            except Exception as error:  # a malformed frame can raise anything
                logging.getLogger("canopen").error("%s", error)

    __call__ = on_message_received

    def _of_node(self, cob_id: int) -> bool:
        return cob_id & FUNCTION in FROM_NODES and cob_id not in (SYNC, self.own)

    def _take(self, block: Block) -> None:
        """Hand a block whole to each subscriber that takes blocks, and frame by frame to the others."""
        whole: dict[BlockCallback, dict[int, Octets]] = {}
        singly: dict[int, list[FrameCallback]] = {}
        for cob_id, data in block.columns:
            self.nodes |= self._of_node(cob_id)
            for callback in self._subscribers.get(cob_id, ()):
                if taker := self.whole.get(callback):
                    whole.setdefault(taker, {})[cob_id] = data
                else:
                    singly.setdefault(cob_id, []).append(callback)
        for taker, columns in whole.items():
            taker(columns)
        if singly:
            for time_ns, cob_id, octets in block.frames():
                for callback in singly.get(cob_id, ()):
                    callback(cob_id, bytearray(octets), time_ns / 1e9)


def _unheard(_cob_id: int, _data: bytearray, _timestamp: float) -> None:
    pass


class _Tapped:
    """Calls a tap once for each frame: for a sent one before it is sent, and not for its echo."""

    def __init__(self, bus: can.BusABC, heard: FrameTap, *, echoes: bool) -> None:
        self._heard = heard
        self._send = bus.send
        self._echoes: deque[tuple[int, bytes]] | None = deque() if echoes else None
        bus.send = self.send  # type: ignore[method-assign]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._heard(True, msg)
        if self._echoes is not None:
            self._echoes.append((msg.arbitration_id, bytes(msg.data)))
        self._send(msg, timeout)

    def __call__(self, msg: can.Message | Block) -> None:
        if isinstance(msg, Block):
            for each in msg.frames():
                self._heard(False, _BlockFrame(*each))
            return
        frame = (msg.arbitration_id, bytes(msg.data))
        if self._echoes and frame in self._echoes:
            while self._echoes.popleft() != frame:
                pass  # an echo that was lost
        else:
            self._heard(False, msg)


def _take_up(network: canopen.Network) -> bool:
    """Take up the frames that have come, as python-can's thread does where nobody steps; whether there were any."""
    frames = arrived(network.bus)
    for frame in frames:
        for listener in network.listeners:
            listener(frame)
    return bool(frames)


class _InOrder:
    """Hands each frame that comes on a bus within this process to its listeners, and knows when all are handed over."""

    def __init__(
        self, received: queue.Queue[can.Message], listeners: Sequence[Callable[[can.Message], object]]
    ) -> None:
        self._received, self._listeners = received, listeners
        self._thread = 0  # in which frames are heard

    def __call__(self, msg: can.Message) -> None:
        self._thread = threading.get_ident()
        try:
            for each in self._listeners:
                each(msg)
        finally:
            self._received.task_done()

    def settle(self, timeout: float) -> None:
        if threading.get_ident() != self._thread:
            with self._received.all_tasks_done:
                self._received.all_tasks_done.wait_for(lambda: not self._received.unfinished_tasks, timeout)


class CanLink:
    """One CAN bus, shared by the nodes on it; SDO transfers go one at a time.

    After a time-out, or a signal in the middle, a node's answer may still be on its way and would answer the
    next request. The node is therefore listened to until it has been silent for a whole time-out.
    """

    def __init__(self, bus: files.CanBus, stepper: Stepper | None = None) -> None:
        """Make a link, closed. `stepper`: see `palpate.drivers.clock.BenchClock`.

        Raises ConfigError: python-can has no such interface.
        """
        self.name = f"{bus.interface}:{bus.channel}"
        if bus.interface not in can.VALID_INTERFACES:
            raise ConfigError(f"CAN bus {self.name}: {UnknownName('interface', bus.interface, can.VALID_INTERFACES)}")
        self._description = bus
        self._stepper = stepper
        self._lock = OwnLock()
        self._network: canopen.Network | None = None
        self._cyclic: Cyclic | None = None
        self._in_order: _InOrder | None = None
        self._listener = _Listener({})  # until the bus is open; that of an absent optional device stays closed
        self._answers_due: set[canopen.RemoteNode] = set()
        self._taps: list[FrameTap] = []
        self.section = "the bench file"  # where the bus is said, and below by node id where each device is
        self.devices: dict[object, str] = {}

    def tap(self, heard: FrameTap) -> None:
        """From `open` on call `heard` with each frame that is sent (True) or received, in the thread that does it."""
        self._taps.append(heard)

    def open(self) -> None:
        """Join the bus. Raises LinkError: it cannot be opened."""
        d = self._description
        try:
            options = WITHIN_MACHINE if d.interface == MULTICAST else {}
            bus = can.Bus(interface=d.interface, channel=d.channel, bitrate=d.bitrate, **options)
        except Exception as error:  # each interface of python-can raises other types, even NameError
            raise LinkError(causes.no_bus(d.interface, d.channel, d.bitrate, error, self.section)) from error
        if causes.is_down(d.interface, d.channel):
            bus.shutdown()
            raise LinkError(causes.down(self.name, d.channel, d.bitrate))
        if d.interface == MULTICAST:
            keep_to_group(bus)
        if isinstance(bus, VirtualBus):
            take_blocks(bus.queue)
        close_bus_in_child(bus)
        self._network = canopen.Network(bus)
        self._cyclic = Cyclic(bus, d.interface, self.name)
        self._listener = _Listener(self._network.subscribers)
        taps = [_Tapped(bus, heard, echoes=d.interface == MULTICAST) for heard in self._taps]
        self._network.listeners = [*taps, self._listener]  # type: ignore[list-item]  # told before anybody acts on it
        if taps and isinstance(bus, VirtualBus) and self._stepper is None:
            self._in_order = _InOrder(bus.queue, self._network.listeners)
            self._network.listeners = [self._in_order]  # type: ignore[list-item]
        self._network.unsubscribe(LssMaster.LSS_RX_COBID)  # canopen would keep these frames for ever
        if self._stepper is None:
            self._network.connect()
        else:
            self._take_up = partial(_take_up, self._network)
            self._stepper.take_turns(self._take_up)

    def _step(self) -> None:
        if self._stepper is not None:
            self._stepper.step()

    def close(self) -> None:
        """Leave the bus. Raises LinkError: it failed meanwhile."""
        network, self._network = self._network, None
        cyclic, self._cyclic, self._in_order = self._cyclic, None, None
        if network is not None:
            try:
                with suppress(can.CanError, OSError):  # whether or not the bus has failed, it is left
                    if cyclic is not None:
                        cyclic.end_all()
                self._step()
                if self._stepper is not None:
                    self._stepper.end_turns(self._take_up)
                leave(network)
            except (can.CanError, OSError) as error:
                raise LinkError(self._why_lost(error)) from error

    @property
    def network(self) -> canopen.Network:
        self._lock.check()
        if self._network is None:
            raise LinkError(f"CAN bus {self.name} is not open; open the bench first")
        return self._network

    def error_frames(self) -> int:
        """Number of error frames on the bus since the last call."""
        errors, self._listener.errors = self._listener.errors, 0
        return errors

    def settle(self) -> None:
        """Return when taps have heard what has come on a bus within this process, or after the time-out."""
        if self._in_order is not None:
            self._in_order.settle(self._description.timeout)
        self._step()

    @property
    def bitrate(self) -> float:
        """Bits a second."""
        return self._description.bitrate

    @property
    def stamped(self) -> bool:
        """Whether time stamps of frames tell when these were on the wire; a bus within this machine has no wire."""
        return has_wire(self._description)

    def add_node(self, node_id: int) -> canopen.RemoteNode:
        """The node of this id; one of several devices may ask for it first."""
        existing = self.network.nodes.get(node_id)
        if isinstance(existing, canopen.RemoteNode):
            return existing
        node = canopen.RemoteNode(node_id, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        node.sdo = CheckedSdoClient(node.sdo.rx_cobid, node.sdo.tx_cobid, node.object_dictionary)  # type: ignore[no-untyped-call]
        node.sdo.RESPONSE_TIMEOUT = self._description.timeout
        node.sdo.stepper = self._stepper
        if has_wire(self._description):
            node.sdo.shortest = shortest_transfer(self._description.bitrate)
        node.sdo_channels = [node.sdo]
        node.emcy.on_emcy = _unheard  # type: ignore[method-assign]  # canopen would keep them all, for ever; who wants them subscribes
        self.network.add_node(node)
        return node

    def subscribe(self, cob_id: int, callback: FrameCallback) -> None:
        """Call `callback(cob_id, data, timestamp)` in the receiving thread for each frame with this identifier."""
        self.network.subscribe(cob_id, callback)

    def take_blocks(self, instead_of: FrameCallback, callback: BlockCallback) -> None:
        """Call `callback`, instead of a subscribed callback for each frame, where a bus hands on a block of frames.

        It gets the data of the subscribed identifiers, in their order on the bus, as `Block.columns` has them.
        """
        self._listener.whole[instead_of] = callback

    def upload(self, who: str, node: canopen.RemoteNode, index: int, subindex: int, size: int | None = None) -> bytes:
        """Read an object; `size` is its size in bytes if the node does not give one.

        Raises LinkError, LinkTimeout, DeviceError.
        """
        data: bytes = self.transfer(who, node, node.sdo.upload, index, subindex, size)
        return data

    def download(self, who: str, node: canopen.RemoteNode, index: int, subindex: int, data: bytes) -> None:
        """Write an object, once. Raises LinkError, LinkTimeout, DeviceError."""
        self.transfer(who, node, node.sdo.download, index, subindex, data)

    def transfer(self, who: str, node: canopen.RemoteNode, call: Callable[..., Any], *args: object) -> Any:
        with self._lock:
            if node in self._answers_due:
                self._await_silence(who, node)
            self._answers_due.add(node)
            try:
                result = call(*args)
            except SdoAbortedError as error:
                self._answers_due.discard(node)
                raise DeviceError(f"{who}: aborted the transfer: {error}") from error
            except SdoCommunicationError as error:
                notifier = None if self._network is None else self._network.notifier
                if notifier is not None and (failure := notifier.exception) is not None:
                    raise LinkError(f"{who}: {self._why_lost(failure)}") from failure
                raise LinkTimeout(
                    f"{who}: no valid answer within {self._description.timeout:g} s; {self._why_none(node)}"
                ) from error
            except (can.CanError, OSError) as error:
                raise LinkError(f"{who}: {self._why_lost(error)}") from error
            self._answers_due.discard(node)
            return result

    def _why_none(self, node: canopen.RemoteNode) -> str:
        """A possible reason why no valid answer came, with its remedy."""
        if node.sdo.too_soon:
            return (
                f"{node.sdo.too_soon} answers came sooner than {self._description.bitrate} bit/s can bring them; look "
                "for a second node of that id, and give the bus its true bitrate"
            )
        heard, section = self._listener, self.section
        if heard.unheard:
            return causes.alone(section)
        if heard.destroyed:
            return (
                f"{heard.destroyed} error frames came: the bus has another bit rate than {self._description.bitrate} "
                f"bit/s, or no termination; correct bitrate in {section}, or look at the cable"
            )
        device = self.devices.get(node.id, "the bench file")
        if heard.nodes:
            return (
                f"other nodes talk on {self.name}, so that bus and bit rate are right; check power of this node, and "
                f"node in {device}"
            )
        return (
            f"nothing is heard on {self.name}; check power and cable of the nodes, bitrate in {section}, and node in "
            f"{device}"
        )

    def _why_lost(self, error: Exception) -> str:
        """Why the bus failed, with the remedy."""
        d = self._description
        return causes.lost_bus(d.interface, d.channel, d.bitrate, error, self.section)

    def _await_silence(self, who: str, node: canopen.RemoteNode) -> None:
        with suppress(queue.Empty):
            for _ in range(LATE_ANSWERS):
                node.sdo.next_answer(self._description.timeout)
            raise LinkError(f"{who}: keeps sending unasked answers; look for a second SDO client on the bus")

    def beat(self, master: int) -> None:
        """Send one heartbeat of this program as node id `master`, which nodes can watch. Raises LinkError.

        It waits for no transfer, because one without an answer could last longer than a node waits for its master.
        """
        self._listener.own = HEARTBEAT + master
        self._send(HEARTBEAT + master, OPERATIONAL)

    def send(self, cob_id: int, data: bytes) -> None:
        """Send one frame, once. Raises LinkError."""
        with self._lock:
            self._send(cob_id, data)

    def _send(self, cob_id: int, data: bytes) -> None:
        try:
            self.network.send_message(cob_id, data)
        except (can.CanError, OSError) as error:
            raise LinkError(self._why_lost(error)) from error
        self._step()

    def begin_cycle(self, cob_id: int, frames: Sequence[bytes], period_us: int) -> None:
        """From now on let the bus send these frames over and over; see `Cyclic.begin`. Raises LinkError."""
        self._with_cyclic(lambda cyclic: cyclic.begin(cob_id, frames, period_us))

    def end_cycle(self, cob_id: int) -> None:
        """Let the bus send no more of the frames with this identifier. Raises LinkError."""
        self._with_cyclic(lambda cyclic: cyclic.end(cob_id))

    def check_cyclic(self) -> None:
        """Raises LinkError: nothing sends frames on time on this bus."""
        self._with_cyclic(lambda cyclic: cyclic.check())

    def _with_cyclic(self, do: Callable[[Cyclic], object]) -> None:
        if self._cyclic is None:
            raise LinkError(f"CAN bus {self.name} is not open; open the bench first")
        with self._lock:
            try:
                do(self._cyclic)
            except (can.CanError, OSError) as error:
                raise LinkError(self._why_lost(error)) from error
            self._step()

    def command(self, node: canopen.RemoteNode, state: str) -> None:
        """NMT: ask a node to go to `state` (OPERATIONAL, PRE-OPERATIONAL, STOPPED, RESET); there is no answer."""
        with self._lock:
            try:
                node.nmt.state = state
            except (can.CanError, OSError) as error:
                raise LinkError(self._why_lost(error)) from error
            self._step()


# -------------------------------------------------------------------------------------------------------
# Listens to a CAN bus without taking part in it: a node with a wrong bit rate destroys the frames of all others

# how python-can's interfaces are told only to listen, by their own arguments (their documentation, python-can 4)
LISTEN_ONLY: dict[str, dict[str, Any]] = {
    "cantact": {"monitor": True},
    "kvaser": {"driver_mode": False},
    "nixnet": {"listen_only": True},
    "pcan": {"state": can.BusState.PASSIVE},
    "seeedstudio": {"operation_mode": "silent"},
    "slcan": {"listen_only": True},
    "systec": {"state": can.BusState.PASSIVE},
    "vector": {"listen_only": True},
}
SET_BY_SYSTEM = (
    "socketcan",
    MULTICAST,
    "virtual",
)  # opening these sets no bit rate
HEARTBEATS, EMERGENCIES, ANSWERS = range(0x701, 0x780), range(0x81, 0x100), range(0x581, 0x600)


@dataclass
class Heard:
    """What was heard on a bus: number of data frames, number of error frames, and the node ids that sent some."""

    frames: int = 0
    errors: int = 0
    nodes: set[int] = field(default_factory=set)


def listens_quietly(bus: CanBus) -> bool:
    """Whether opening the bus to listen disturbs nobody, even with a wrong bit rate."""
    return bus.interface in LISTEN_ONLY or bus.interface in SET_BY_SYSTEM or not has_wire(bus)


def listen(bus: CanBus, seconds: float) -> Heard:
    """Listen for so many seconds. Raises LinkError: the bus cannot be opened, or failed."""
    heard, clock = Heard(), WallClock()
    try:
        with can.Bus(
            interface=bus.interface, channel=bus.channel, bitrate=bus.bitrate, **LISTEN_ONLY.get(bus.interface, {})
        ) as opened:
            if bus.interface == MULTICAST:
                keep_to_group(opened)
            while (left := seconds - 1e-9 * clock.now_ns()) > 0:
                if (frame := opened.recv(left)) is not None:
                    _count(heard, frame)
    except Exception as error:  # each interface of python-can raises other types, even NameError
        where = "--can INTERFACE:CHANNEL"
        raise LinkError(causes.no_bus(bus.interface, bus.channel, bus.bitrate, error, where)) from error
    return heard


def _count(heard: Heard, frame: can.Message) -> None:
    if frame.is_error_frame:
        heard.errors += 1
        return
    heard.frames += 1
    if frame.is_extended_id or frame.is_remote_frame:
        return
    for identifiers in (HEARTBEATS, EMERGENCIES, ANSWERS):
        if frame.arbitration_id in identifiers:
            heard.nodes.add(frame.arbitration_id & 0x7F)


# --- layer setting services (CiA 305) ------------------------------------------------------------------


BIT_TIMING = {1_000_000: 0, 800_000: 1, 500_000: 2, 250_000: 3, 125_000: 4, 50_000: 6, 20_000: 7, 10_000: 8}
UNCONFIGURED = 255  # what a device without a node id tells in its place


@dataclass(frozen=True)
class LssAddress:
    """The four parts of 1018h, which no two devices share."""

    vendor: int
    product: int
    revision: int
    serial: int

    def __str__(self) -> str:
        return " ".join(f"{part:X}h" for part in astuple(self))


class LssDevice:
    """The one device that is in LSS state configuration."""

    def __init__(self, master: LssMaster, name: str) -> None:
        self._master = master
        self._name = name

    def node_id(self) -> int | None:
        """Its node id; None: it has none. Raises LinkTimeout, DeviceError."""
        with self._named_errors("tell its node id"):
            found = int(self._master.inquire_node_id())  # type: ignore[no-untyped-call]
        return None if found == UNCONFIGURED else found

    def set_node_id(self, node: int) -> None:
        """Set its node id, which it uses after a reset. Raises LinkTimeout, DeviceError."""
        with self._named_errors(f"take node id {node}"):
            self._master.configure_node_id(node)  # type: ignore[no-untyped-call]

    def set_bitrate(self, bitrate: int) -> None:
        """Set its bit rate [bit/s], one of `BIT_TIMING`, which it uses when it is switched on again.

        Raises LinkTimeout, DeviceError.
        """
        with self._named_errors(f"take {bitrate} bit/s"):
            self._master.configure_bit_timing(BIT_TIMING[bitrate])  # type: ignore[no-untyped-call]

    def save(self) -> None:
        """Let it keep both when it is switched off. Raises LinkTimeout, DeviceError."""
        with self._named_errors("keep its settings"):
            self._master.store_configuration()  # type: ignore[no-untyped-call]

    @contextmanager
    def _named_errors(self, what: str) -> Iterator[None]:
        try:
            yield
        except LssError as error:
            if str(error).startswith("LSS Error"):
                raise DeviceError(f"{self._name}: refuses to {what} ({error}); look at its manual") from None
            raise LinkTimeout(f"{self._name}: did not {what}: {error}; look at it before you go on") from None


@contextmanager
def selected(link: CanLink, address: LssAddress, timeout: float) -> Iterator[LssDevice]:
    """A context in which the device with this address alone takes settings; the link is open.

    At the end all devices leave LSS state configuration.

    Raises LinkTimeout: no such device answers within `timeout` [s]. LinkError: the bus failed.
    """
    master, name = link.network.lss, f"device {address} on {link.name}"
    master.RESPONSE_TIMEOUT = timeout
    master.responses = queue.Queue()
    link.subscribe(LssMaster.LSS_RX_COBID, master.on_message_received)
    try:
        try:
            found = master.send_switch_state_selective(*astuple(address))  # type: ignore[no-untyped-call]
        except LssError:
            found = False
        if not found:
            raise LinkTimeout(
                f"{name} does not answer; compare all four numbers with 1018h (palpate bus scan shows them), and see "
                "that it has LSS"
            )
        yield LssDevice(master, name)
    finally:
        link.network.unsubscribe(LssMaster.LSS_RX_COBID, master.on_message_received)
        _leave(link, master)


def _leave(link: CanLink, master: LssMaster) -> None:
    try:
        master.send_switch_state_global(LssMaster.WAITING_STATE)  # type: ignore[no-untyped-call]
    except Exception as error:  # each interface of python-can raises other types
        raise LinkError(f"CAN bus {link.name} failed: {error}; switch all devices off and on") from error
