"""The base of the CANopen drivers."""

from __future__ import annotations

from typing import ClassVar, Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device, Place
from palpate.drivers.links.can import CanLink
from palpate.instrument.contracts.contract import PROBE, Value, sdo
from palpate.instrument.errors import DeviceError, IdentityError


class CanopenDevice(Device):
    """Reads and writes the objects of the contract by checked SDO transfers.

    A write is sent once. The driver remembers written settings in order to restore them, but no orders.
    """

    orders: ClassVar[frozenset[str]] = frozenset()  # objects that make the node do something

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the driver of a node; a driver whose constructor takes more arguments overrides this."""
        return cls(place.link, place.unit, place.clock)

    def __init__(self, link: CanLink, node_id: int, clock: Clock) -> None:
        super().__init__(f"{self.contract.title} {node_id} at {link.name}")
        self.link: CanLink = link
        self.id = node_id
        self.clock = clock
        self._settings: dict[str, Value] = {}

    def connect(self) -> None:
        """Join the bus and identify the node. Raises as `identify`."""
        self._node = self.link.add_node(self.id)
        self.identify()
        self.simulated = self._text(sdo(0x1009)) == "simulated"

    def identify(self) -> None:
        """Check identity (1018h) and byte order.

        Raises:
            IdentityError: another vendor, product or major revision, another byte order, or another serial number than
                before.
            LinkError, LinkTimeout, DeviceError: the node does not answer, or refuses.
        """
        expected = self.contract.identity
        found = [int(self.get(field)) for field in ("vendor", "product", "revision")]
        wanted = [int(text, 16) for text in (expected.vendor, expected.product, expected.revision)]
        if found[:2] != wanted[:2] or found[2] >> 16 != wanted[2] >> 16:
            raise IdentityError(
                f"{self.name}: identifies itself as {' '.join(f'0x{v:08X}' for v in found)}, the contract is for "
                f"{' '.join(f'0x{v:08X}' for v in wanted)}; check the node id in the bench file"
            )
        if (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: byte-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "this node is not little-endian as CANopen asks; update its firmware"
            )
        self.serial = self._same(f"{int(self.get('serial')):08X}")

    def get(self, name: str) -> float:
        """Physical value of one object. Raises LinkError, LinkTimeout; DeviceError: an abort, or outside its limits."""
        return self._asked(lambda: self._value(name, self._get(name)))

    def _held(self, name: str) -> bytes:
        """The bytes of an object, without a check of their value."""
        return self._asked(lambda: self._get(name))

    def _get(self, name: str) -> bytes:
        field = self.contract[name]
        try:
            data = self.link.upload(self.name, self._node, field.index, field.subindex, field.size)
        except DeviceError as error:
            raise DeviceError(f"{error}, reading {name}") from None
        if len(data) != field.size:
            raise DeviceError(
                f"{self.name}: {name} has {len(data)} bytes instead of {field.size}, so it is not used; check the "
                "node's firmware"
            )
        return data

    def set(self, name: str, value: Value) -> None:
        """Write one object. Raises RangeError before anything is sent, DeviceError where the node aborts."""
        data = self.contract.encode(name, value)
        self._told(lambda: self._set(name, value, data))
        if self.contract[name].access == "rw" and name not in self.orders:
            self._settings[name] = value

    def _set(self, name: str, value: Value, data: bytes) -> None:
        field = self.contract[name]
        try:
            self.link.download(self.name, self._node, field.index, field.subindex, data)
        except DeviceError as error:
            raise DeviceError(f"{error}, writing {self.contract.described(name, value)}") from None

    def differences(self) -> list[str]:
        """The settings that the node no longer holds, whether their present values are allowed or not."""
        found = []
        for name, value in self._settings.items():
            held = self._held(name)
            if held != self.contract.encode(name, value):
                found.append(f"{self.name}: {name} is {self.contract.decode(name, held):g}, was set to {value}")
        return found

    def restore(self) -> None:
        """Write the settings again. Raises as `set`."""
        for name, value in self._settings.items():
            self.set(name, value)

    def _text(self, address: int) -> str:
        return self.link.upload(self.name, self._node, address >> 8, address & 0xFF).decode("ascii", "replace")
