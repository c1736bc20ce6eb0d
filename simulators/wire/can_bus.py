"""The CAN bus that simulated nodes share with whoever talks to them."""

from __future__ import annotations

import itertools
import logging
import os
import socket
import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from typing import Any, Self

import can
import canopen
from can.interfaces.virtual import VirtualBus
from canopen.network import MessageListener

from palpate.instrument.bench.multicast import MULTICAST, keep_to_group
from palpate.instrument.errors import BenchError
from palpate.simulators.clock import VirtualClock

canopen.Network.NOTIFIER_CYCLE = 0.05  # s; closing waits for one cycle, the default is a second

for _name in ("can", "canopen"):
    logging.getLogger(_name).addHandler(logging.NullHandler())  # what a client sends is no news on our stderr

_numbers = itertools.count(1)
GROUPS = 1 << 16  # of multicast, 239.74.0.0/16

Payload = tuple[int, bytes]  # identifier and data of a frame


class _Frame(can.Message):
    """A message that nobody changes after it was sent: its receivers on the virtual bus share it."""

    __slots__ = ()

    @classmethod
    def of(cls, cob_id: int, data: bytes, timestamp: float = 0.0, channel: Any = None) -> Self:
        """As python-can makes one, which looks at more, for each of a million."""
        frame = cls.__new__(cls)
        frame.arbitration_id, frame.data, frame.dlc = cob_id, bytearray(data), len(data)
        frame.timestamp, frame.channel, frame.is_rx = timestamp, channel, True
        frame.is_extended_id = frame.is_remote_frame = frame.is_error_frame = False
        frame.is_fd = frame.bitrate_switch = frame.error_state_indicator = False
        return frame

    def __deepcopy__(self, memo: object) -> Self:
        return self


class _Virtual(VirtualBus):
    """python-can's bus of this process."""

    def burst(self, payloads: Sequence[Payload]) -> None:
        """All under one lock of each receiver's queue: under one for each frame the two threads wait for each other."""
        self._check_if_open()
        now, channel = time.time(), self.channel_id
        frames = [_Frame.of(cob_id, data, now, channel) for cob_id, data in payloads]
        for receiver in self.channel:
            if receiver is not self.queue:
                with receiver.mutex:
                    receiver.queue.extend(frames)
                    receiver.not_empty.notify()


def own_channel(interface: str) -> str:
    """A channel of python-can that no other bench of this machine uses."""
    if interface != MULTICAST:
        return f"palpate-{os.getpid()}-{next(_numbers)}"
    while True:
        number = (os.getpid() + next(_numbers)) % GROUPS
        group = f"239.74.{number >> 8}.{number & 255}"
        with suppress(BenchError), _claimed(group):
            return group


def _claimed(group: str) -> socket.socket:
    """A claim on a multicast group among the served benches of this machine, until it is closed or its process ends.

    Nodes of two benches would answer for each other. Who listens to a bench claims nothing.

    Raises BenchError: a bench is served there.
    """
    claim = socket.socket(socket.AF_UNIX)
    try:
        claim.bind(f"\0palpate {group}")  # a name that is no file (Linux)
    except OSError:
        claim.close()
        raise BenchError(
            f"CAN bus {MULTICAST}:{group} is that of another served bench; leave the channel out, or give another"
        ) from None
    return claim


def open_bus(interface: str, channel: str) -> can.BusABC:
    """A bus of python-can. Raises BenchError."""
    with ExitStack() as stack:
        claim = stack.enter_context(_claimed(channel)) if interface == MULTICAST else None
        options: dict[str, Any] = {"hop_limit": 0} if interface == MULTICAST else {}  # does not leave this machine
        try:
            bus = _Virtual(channel) if interface == "virtual" else can.Bus(channel, interface, **options)
        except Exception as error:  # each interface of python-can has its own, down to NameError
            raise BenchError(
                f"CAN bus {interface}:{channel} cannot be opened: {error}; give another interface"
            ) from error
        if claim is not None:
            keep_to_group(bus.fileno())
            _release_with(bus, claim)
        stack.pop_all()
    return bus


def _release_with(bus: can.BusABC, claim: socket.socket) -> None:
    shut_down = bus.shutdown

    def shutdown() -> None:
        shut_down()
        claim.close()

    bus.shutdown = shutdown  # type: ignore[method-assign]


def burst(bus: can.BusABC, payloads: Sequence[Payload]) -> None:
    """Send frames that follow each other: at once on a bus of this process, unless a fault stands in for its `send`."""
    if isinstance(bus, _Virtual) and "send" not in vars(bus):
        bus.burst(payloads)
        return
    for cob_id, data in payloads:
        bus.send(_Frame.of(cob_id, data))


class Listener(MessageListener):
    """canopen's listener, which takes an extended identifier for the standard one; what is no frame ends nothing."""

    def on_message_received(self, msg: can.Message) -> None:
        if not (msg.is_extended_id or msg.is_fd):
            super().on_message_received(msg)  # type: ignore[no-untyped-call]

    def on_error(self, exc: Exception) -> None:
        """Goes on, unless the bus itself has failed."""
        if isinstance(exc.__cause__, OSError) or self.network.notifier is None:
            raise NotImplementedError
        self.network.notifier.exception = None  # canopen would send nothing any more


class LockedNetwork(canopen.Network):
    """canopen's network; what it hears, and so sends, is done under the clock's lock."""

    def __init__(self, bus: can.BusABC, clock: VirtualClock) -> None:
        super().__init__(bus)
        self._own = bus
        self.clock = clock
        self.listeners = [Listener(self)]

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """As canopen does, but that no receiver needs a copy."""
        burst(self._own, [(can_id, data)])
        self.check()

    def notify(self, can_id: int, data: bytearray, timestamp: float) -> None:
        with self.clock.lock:
            super().notify(can_id, data, timestamp)


class _Periodic:
    """A periodic message on the virtual clock, as canopen's heartbeat wants it."""

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
    """canopen's network with its periodic messages on the bench's clock."""

    def __init__(self, bus: can.BusABC, clock: VirtualClock) -> None:
        super().__init__(bus, clock)
        self.periodic: list[_Periodic] = []

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> Any:
        return _Periodic(self, can_id, data, round(period * 1e9))
