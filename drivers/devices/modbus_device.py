"""The base of the Modbus drivers."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import cache
from typing import ClassVar, Self

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import Device, Place
from palpate.drivers.links.modbus import (
    BASIC,
    EXTENDED,
    REGULAR,
    ModbusLink,
    read_identity,
    read_registers,
    write_registers,
)
from palpate.instrument.contracts.contract import PROBE, Value
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkError, UsageError

VENDOR, PRODUCT, REVISION, APPLICATION, SERIAL = 0, 1, 2, 6, 0x80


class ModbusDevice(Device):
    """Reads and writes the fields of the contract by checked requests.

    A write is sent once; if it is not confirmed, it is read back. The driver remembers written settings in order to
    restore them, but no orders.

    Replies on a serial line have no transaction number. So that a late reply cannot answer the next read, successive
    reads ask for different numbers of registers, if the contract has one more to read.
    """

    orders: ClassVar[frozenset[str]] = frozenset()  # fields that make the device do something

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the driver of a device; a driver whose constructor takes more arguments overrides this."""
        return cls(place.link, place.unit, place.clock)

    def __init__(self, link: ModbusLink, unit: int, clock: Clock) -> None:
        super().__init__(f"{self.contract.title} at {link.name} unit {unit}")
        self.link: ModbusLink = link
        self.unit = unit
        self.clock = clock
        self._settings: dict[str, Value] = {}
        self._layout = cache(self.contract.layout)
        self._last_count = 0  # number of registers in the last read

    def identify(self) -> None:
        """Check that this is the contract's device and that it agrees on the word order.

        Raises:
            IdentityError: another vendor, product or major version, another word order, or another serial number
                than before.
            LinkError, LinkTimeout, DeviceError: it does not answer, or refuses.
        """
        objects = self._asked(self._identity)
        expected = self.contract.identity
        found = (objects.get(VENDOR, ""), objects.get(PRODUCT, ""), objects.get(REVISION, ""))
        wanted = (expected.vendor, expected.product, expected.revision)
        if found[:2] != wanted[:2] or found[2].split(".")[0] != wanted[2].split(".")[0]:
            raise IdentityError(
                f"{self.name}: identifies itself as {' '.join(found).strip() or 'nothing'}, the contract is for "
                f"{' '.join(wanted)}; check the address and unit id in the bench file"
            )
        probe = int(self.get("probe"))
        if probe != PROBE:
            raise IdentityError(
                f"{self.name}: word-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "set the device to big-endian words (most significant first)"
            )
        self.serial = self._same(objects.get(SERIAL, ""))
        self.simulated = objects.get(APPLICATION, "") == "simulated"

    def _identity(self) -> dict[int, str]:
        """Identity objects by number; the lower categories are asked for if the extended one leaves them out."""
        objects = self._category(EXTENDED)
        if VENDOR not in objects:
            objects |= self._category(BASIC) | self._category(REGULAR)
        return objects

    def _category(self, category: int) -> dict[int, str]:
        reply = self.link.transact(self.name, read_identity, category, self.unit)
        return {k: v.decode(errors="replace") for k, v in getattr(reply, "information", {}).items()}

    def get(self, name: str) -> float:
        """Physical value of one field, in the contract's unit."""
        return self.get_many(name)[0]

    def get_many(self, *names: str) -> list[float]:
        """Physical values of adjacent fields, read in one request, in the contract's units.

        Raises:
            LinkError, LinkTimeout, DeviceError: no answer, an exception response, or a value outside its limits.
        """
        return self._asked(lambda: list(map(self._value, names, self._read(names))))

    def get_text(self, name: str) -> str:
        """Content of a text field. Raises LinkError, LinkTimeout, DeviceError: no answer, or one that is no text."""
        return self._asked(lambda: self._text(name, *self._read((name,))))

    def _text(self, name: str, data: bytes) -> str:
        try:
            return self.contract.decode_text(name, data)
        except ValueError as error:
            raise DeviceError(f"{self.name}: {name} holds no text in UTF-8 ({error}); write it anew") from None

    def _read(self, names: tuple[str, ...]) -> list[bytes]:
        start, count, places = self._layout(names)
        if self.link.serial and count == self._last_count:
            start, count, places = self._layout(self.contract.widened(names))
        self._last_count = count
        try:
            reply = self.link.transact(self.name, read_registers, start, count, self.unit)
        except DeviceError as error:
            raise DeviceError(f"{error}, to a read of {', '.join(names)}", code=error.code) from None
        if reply.function_code != 3 or len(reply.registers) != count:
            raise DeviceError(
                f"{self.name}: answered function {reply.function_code} with {len(reply.registers)} registers "
                f"where function 3 with {count} was asked; the reply is not used"
            )
        data = struct.pack(f">{count}H", *reply.registers)
        return [data[place] for place in places[: len(names)]]

    def set(self, **values: Value) -> None:
        """Write adjacent fields in one FC16 request, which is never repeated.

        Raises:
            RangeError: a value outside its limits; nothing is sent.
            DeviceError: the device refused, naming the fields and values.
            LinkError, LinkTimeout: it is not confirmed, and does not read back as written.
        """
        names = sorted(values, key=lambda name: self.contract[name].address)
        data = b"".join([self.contract.encode(name, values[name]) for name in names])
        start, count = self.contract.block(values)
        if len(data) != 2 * count:
            raise UsageError(
                f"{self.contract.title}: {', '.join(values)} are not adjacent in the contract; write them one by one"
            )
        registers = [int.from_bytes(data[i : i + 2], "big") for i in range(0, len(data), 2)]
        try:
            self._told(lambda: self._write(start, registers, values))
        except BenchError as error:
            if isinstance(error, LinkError):
                self._remember(values)  # a write without confirmation may have been carried out
            if self.broken or self.read_attempts == 1 or not self._reads_back(values):
                raise
            self.noticed(f"{error}; read back, it was carried out")
        self._remember(values)

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> None:
        try:
            reply = self.link.transact(self.name, write_registers, start, registers, self.unit)
        except DeviceError as error:
            raise DeviceError(f"{error}, to {self._described(values)}", code=error.code) from None
        if reply.function_code != 16 or reply.address != start or reply.count != len(registers):
            raise DeviceError(f"{self.name}: did not confirm {self._described(values)}; the setting is uncertain")

    def _remember(self, values: Mapping[str, Value]) -> None:
        for name, value in values.items():
            if self.contract[name].access == "rw" and name not in self.orders:
                self._settings[name] = value

    def _reads_back(self, values: Mapping[str, Value]) -> bool:
        """Whether all that was written can be read, and reads as it was written."""
        if self.orders & values.keys() or any(self.contract[name].access != "rw" for name in values):
            return False
        try:
            return not self._differing(values)
        except BenchError:
            return False

    def _differing(self, values: Mapping[str, Value]) -> dict[str, float]:
        """Those that the device holds otherwise, as it holds them: within their limits or not."""
        found = dict(zip(values, self._asked(lambda: self._read(tuple(values))), strict=True))
        return {
            name: self.contract.decode(name, found[name])
            for name, value in values.items()
            if found[name] != self.contract.encode(name, value)
        }

    def differences(self) -> list[str]:
        """The settings that the device no longer holds. Raises LinkError, DeviceError."""
        differing = self._differing(self._settings) if self._settings else {}
        return [
            f"{self.name}: {name} is {value:g}, was set to {self._settings[name]}" for name, value in differing.items()
        ]

    def restore(self) -> None:
        """Write lost settings again, and check that they stay. Raises as `set`, and DeviceError: they do not stay."""
        for name in self._differing(self._settings) if self._settings else {}:
            self.set(**{name: self._settings[name]})
        if left := self.differences():
            raise DeviceError(f"{'; '.join(left)}: it does not take its settings; look at it")

    def _described(self, values: Mapping[str, Value]) -> str:
        return ", ".join(self.contract.described(name, value) for name, value in values.items())
