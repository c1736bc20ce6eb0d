"""How drivers read and write the objects of a CANopen node, and know it."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device
from palpate.drivers.devices.identified import check_inventory, check_marks, serial_number
from palpate.drivers.links.can import CanLink
from palpate.instrument.contracts.contract import PROBE, Contract, Value, sdo
from palpate.instrument.contracts.field import told_text
from palpate.instrument.errors import DeviceError, IdentityError

STORE = 0x1010  # object that keeps all others when the right word is written to it
SAVE = b"save"
IDENTITY, REVISION = 0x1018, 3  # object, and its part of which the upper half counts


class CanopenNode(Device):
    """Reads and writes the objects of the contract by checked SDO transfers.

    A write is sent once. The driver remembers written settings in order to restore them, but no orders.
    """

    def __init__(self, link: CanLink, node_id: int, clock: Clock, contract: Contract | None = None) -> None:
        super().__init__(f"{node_id} at {link.name}", clock, contract)
        self.link: CanLink = link
        self.id = node_id

    def _join(self) -> None:
        """Join the bus and identify the node. Raises as `identify`."""
        self.join()
        self.identify()
        with suppress(DeviceError):  # not every node has a hardware version
            self.simulated = self._text(sdo(0x1009)) == "simulated"

    def join(self) -> None:
        """Join the bus; nothing is sent."""
        self._node = self.link.add_node(self.id)

    def identify(self) -> None:
        """Check that this is the contract's device, and that it tells the same scales and units as before.

        Raises:
            IdentityError: another vendor, product or major revision (1018h), a mark that does not fit, another byte
                order, or another serial number than before; or the bench file does not name a device that cannot be
                known.
            LinkError, LinkTimeout, DeviceError: the node does not answer, refuses, or tells another scale or unit.
        """
        self.recognise()
        if self.contract.has("probe") and (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: byte-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "this node is not little-endian as CANopen asks; update its firmware"
            )
        self._scales.check()
        self.serial = self._same(self._serial_number())

    def recognise(self) -> None:
        """Check that this is the contract's device, whatever its scales and units. Raises as `identify`."""
        match self.contract.known_by:
            case "identity":
                self._check_identity()
            case "marks":
                check_marks(self)
            case "nothing":
                check_inventory(self)

    def _check_identity(self) -> None:
        """Check those parts of 1018h that the contract has. Raises IdentityError, LinkError, DeviceError."""
        expected = self.contract.identity
        wanted = {
            number: int(text, 16)
            for number, text in enumerate((expected.vendor, expected.product, expected.revision), 1)
            if text
        }
        found = {number: self._asked(partial(self._identity, number)) for number in wanted}
        if any(found[n] >> 16 != wanted[n] >> 16 if n == REVISION else found[n] != wanted[n] for n in wanted):
            raise IdentityError(
                f"{self.name}: identifies itself as {' '.join(f'0x{v:08X}' for v in found.values())}, the contract is "
                f"for {' '.join(f'0x{v:08X}' for v in wanted.values())}; check the node id in the bench file"
            )

    def _identity(self, part: int) -> int:
        """A part of the identity object. Raises DeviceError: it has no 4 bytes."""
        return int.from_bytes(self._object(IDENTITY, part, 4), "little")

    def _object(self, index: int, subindex: int, size: int) -> bytes:
        """An object that may be no field. Raises LinkError, LinkTimeout; DeviceError: an abort, or another size."""
        data = self.link.upload(self.name, self._node, index, subindex, size)
        if len(data) != size:
            raise DeviceError(
                f"{self.name}: {index:04X}h:{subindex} has {len(data)} bytes instead of {size}, so it is not used; "
                "check the node's firmware"
            )
        return data

    def _serial_number(self) -> str:
        if not self.contract.serial and self.contract.has("serial"):
            return f"{int(self.get('serial')):08X}"
        return serial_number(self)

    def get(self, name: str) -> float:
        """Physical value of one object; NaN: it has no reading.

        Raises LinkError, LinkTimeout; DeviceError: an abort, or a value outside its limits.
        """
        return self._asked(lambda: self._value(name, self._get(name), self._scales.beside(name)))

    def held(self, name: str) -> float:
        """Value of an object, which may be outside the limits."""
        return self._decoded(name, self._held(name), self._scales.beside(name))

    def get_text(self, name: str) -> str:
        """Content of a text object. Raises LinkError, LinkTimeout, DeviceError."""
        return self._asked(lambda: self._text(self.contract[name].address))

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

    def give(self, /, **values: Value) -> None:
        """Write objects one by one, in this order, as `set`; all values are checked before the first is sent."""
        for name, value in values.items():
            self._scales.encode(name, value)
        for name, value in values.items():
            self.set(name, value)

    def set(self, name: str, value: Value) -> None:
        """Write one object, once.

        Raises:
            RangeError: a value outside its limits; nothing is sent.
            DeviceError: the node aborts; or its memory was written too often.
        """
        data = self._scales.encode(name, value)
        if worn := self._wear.of((name,)):
            if self.contract[name].access == "rw" and self._held(name) == data:
                self._remember(name, value)
                return
            self._wear.count(worn)
        self._told(lambda: self._set(name, value, data))
        self._remember(name, value)

    def _set(self, name: str, value: Value, data: bytes) -> None:
        field = self.contract[name]
        try:
            self.link.download(self.name, self._node, field.index, field.subindex, data)
        except DeviceError as error:
            raise DeviceError(f"{error}, writing {self.contract.described(name, value)}") from None

    def _remember(self, name: str, value: Value) -> None:
        if self.contract[name].access == "rw" and name not in self.orders:
            self._settings[name] = value

    def _store(self, what: str, index: int, subindex: int, content: bytes) -> None:
        """Write an object that may be no field. Raises LinkError, LinkTimeout; DeviceError, which names it."""
        try:
            self.link.download(self.name, self._node, index, subindex, content)
        except DeviceError as error:
            raise DeviceError(
                f"{error}, writing {index:04X}h:{subindex} for {what}; the node does not take this, check its map"
            ) from None

    def save(self) -> None:
        """Let the node keep all its settings when it is switched off (1010h). Nothing here does this unasked."""
        self._told(partial(self._store, "its memory", STORE, 1, SAVE))

    def _text(self, address: int) -> str:
        return told_text(self.link.upload(self.name, self._node, address >> 8, address & 0xFF))
