"""CAN links; the only import of python-can and canopen in the drivers."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import can
import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from instrument.bench import CanBus
from instrument.errors import DeviceError, LinkError, LinkTimeout

for _name in ("can", "canopen"):  # their warnings would go to stderr; whatever fails is raised
    logging.getLogger(_name).addHandler(logging.NullHandler())
canopen.Network.NOTIFIER_CYCLE = 0.05  # s; closing waits for one cycle, the default is a second

LATE_ANSWERS = 10  # that one interrupted transfer can leave; a node that sends more is not to be trusted

FrameCallback = Callable[[int, bytearray, float], None]


class CanLink:
    """One CAN bus, shared by the nodes on it; SDO transfers go one at a time.

    After a time-out, or a signal in the middle, a node's answer may still be on its way and would answer the
    next request. The node is therefore listened to until it has been silent for a whole time-out.
    """

    def __init__(self, bus: CanBus) -> None:
        self.name = f"{bus.interface}:{bus.channel}"
        self._description = bus
        self._lock = threading.Lock()
        self._network: canopen.Network | None = None
        self._answers_due: set[canopen.RemoteNode] = set()

    def open(self) -> None:
        """Join the bus. Raises LinkError."""
        d = self._description
        try:
            bus = can.Bus(interface=d.interface, channel=d.channel, bitrate=d.bitrate)
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
            raise LinkError(
                f"CAN bus {self.name} cannot be opened: {error}; check the interface and channel in the bench file"
            ) from error
        self._network = canopen.Network(bus)
        self._network.connect()

    def close(self) -> None:
        """Leave the bus. Raises LinkError where it failed meanwhile."""
        network, self._network = self._network, None
        if network is not None:
            try:
                network.disconnect()
            except (can.CanError, OSError) as error:
                raise LinkError(f"CAN bus {self.name} failed: {error}; check adapter and cable") from error

    @property
    def network(self) -> canopen.Network:
        if self._network is None:
            raise LinkError(f"CAN bus {self.name} is not open; open the bench first")
        return self._network

    def add_node(self, node_id: int) -> canopen.RemoteNode:
        node = canopen.RemoteNode(node_id, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        node.sdo.RESPONSE_TIMEOUT = self._description.timeout
        self.network.add_node(node)
        return node

    def subscribe(self, cob_id: int, callback: FrameCallback) -> None:
        """Call `callback(cob_id, data, timestamp)` in the receiving thread for each such frame."""
        self.network.subscribe(cob_id, callback)

    def upload(self, who: str, node: canopen.RemoteNode, index: int, subindex: int) -> bytes:
        """Read an object. Raises LinkError, LinkTimeout, DeviceError."""
        data: bytes = self._transfer(who, node, node.sdo.upload, index, subindex)
        return data

    def download(self, who: str, node: canopen.RemoteNode, index: int, subindex: int, data: bytes) -> None:
        """Write an object, once. Raises LinkError, LinkTimeout, DeviceError."""
        self._transfer(who, node, node.sdo.download, index, subindex, data)

    def _transfer(self, who: str, node: canopen.RemoteNode, call: Callable[..., Any], *args: object) -> Any:
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
                raise LinkTimeout(
                    f"{who}: no valid answer within {self._description.timeout:g} s; check power, bit rate, node id"
                ) from error
            except (can.CanError, OSError) as error:
                raise LinkError(f"{who}: {self.name} failed: {error}; check adapter and termination") from error
            self._answers_due.discard(node)
            return result

    def _await_silence(self, who: str, node: canopen.RemoteNode) -> None:
        with suppress(queue.Empty):
            for _ in range(LATE_ANSWERS):
                node.sdo.responses.get(timeout=self._description.timeout)
            raise LinkError(f"{who}: keeps answering what was not asked; look for a second SDO client on the bus")

    def command(self, node: canopen.RemoteNode, state: str) -> None:
        """NMT: ask a node to go to `state` (OPERATIONAL, PRE-OPERATIONAL, STOPPED, RESET); there is no answer."""
        with self._lock:
            try:
                node.nmt.state = state
            except (can.CanError, OSError) as error:
                raise LinkError(f"{self.name} failed: {error}; check adapter and termination") from error
