"""A CAN link without a wire: one node answers from its objects, as a contract lays them out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.sensor_node import CanopenSensorNode
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Value
from palpate.instrument.contracts.own import SENSOR_NODE
from palpate.instrument.errors import DeviceError
from palpate.simulators.clock import VirtualClock


class Objects:
    """Stands in for a `CanLink` with one node.

    Attributes:
        held: the bytes of each object, by index and subindex.
        done: uploads, downloads and commands, in order.
        failures: raised instead of an answer, one a transfer; None: that one is answered.
        subscribed: who wants frames of an identifier.
        whole: who takes blocks, by what they would take frames with.
    """

    name = "bus"

    def __init__(self, contract: Contract, **values: Value) -> None:
        self.contract = contract
        self.held: dict[tuple[int, int], bytes] = {}
        self.done: list[tuple[Any, ...]] = []
        self.failures: list[Exception | None] = []
        self.subscribed: dict[int, Callable[..., None]] = {}
        self.whole: dict[Callable[..., None], Callable[..., None]] = {}
        self.put(**{field.name: field.default for field in contract.fields if not field.beside})
        self.put(**values)

    def put(self, **values: Value) -> None:
        """Let objects have these values: names of choices, texts, or numbers, also beyond their limits."""
        for name, value in values.items():
            field = self.contract[name]
            if field.type == "text":
                data = str(value).encode()
            else:
                data = self.contract.pack(name, field.choices[value] if isinstance(value, str) else value)
            self.held[field.index, field.subindex] = data

    def value(self, name: str) -> float:
        field = self.contract[name]
        return self.contract.decode(name, self.held[field.index, field.subindex])

    def add_node(self, node_id: int) -> int:
        return node_id

    def subscribe(self, cob_id: int, callback: Callable[..., None]) -> None:
        self.subscribed[cob_id] = callback

    def take_blocks(self, instead_of: Callable[..., None], callback: Callable[..., None]) -> None:
        self.whole[instead_of] = callback

    def send(self, cob_id: int, data: bytes) -> None:
        """A frame of the node comes to whoever wants it."""
        if cob_id in self.subscribed:
            self.subscribed[cob_id](cob_id, bytearray(data), 0.0)

    def upload(self, _who: str, node: int, index: int, subindex: int, size: int | None = None) -> bytes:
        return self._transfer(lambda: self.held[index, subindex], "upload", node, index, subindex, size)

    def download(self, _who: str, node: int, index: int, subindex: int, data: bytes) -> None:
        def write() -> bytes:
            self.held[index, subindex] = data
            return b""

        self._transfer(write, "download", node, index, subindex, data)

    def command(self, node: int, state: str) -> None:
        self.done.append(("command", node, state))

    def _transfer(self, call: Callable[[], bytes], *done: Any) -> bytes:
        self.done.append(done)
        if self.failures and (failure := self.failures.pop(0)):
            raise failure
        try:
            return call()
        except KeyError:
            raise DeviceError("node: aborted the transfer: Object does not exist") from None


DEFAULTS: dict[str, Any] = {"emergency_cob_id": 0x83, "device_name": "Palpate SN-1"}


def node(**held: Any) -> tuple[CanopenSensorNode, Any, VirtualClock]:
    """A connected driver of node 3."""
    link: Any = Objects(SENSOR_NODE, **{**DEFAULTS, **held})
    clock = VirtualClock()
    driver = CanopenSensorNode.at(DevicePlace(link, 3, None, clock))
    driver.connect()
    link.done.clear()
    return driver, link, clock
