"""Registers and coils of one simulated Modbus device, as its contract declares them."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache

from pymodbus.constants import ExcCodes

from palpate.instrument.contracts.contract import Field
from palpate.instrument.contracts.field import BITS, READS, WRITES, Table
from palpate.simulators.wire.device import Refused, SimulatedDevice

BLOCKS = 64  # number of register blocks whose fields are cached
TABLE_OF: dict[int, Table] = {function: table for table, function in READS.items()} | {
    function: table for table, functions in WRITES.items() for function in functions
}
IDENTIFY = 43

Answer = list[int] | list[bool] | ExcCodes


class Registers:
    """Carries out requests for the registers and coils of one device, with the checks of a real one."""

    def __init__(self, device: SimulatedDevice) -> None:
        self.device = device
        self.contract = device.contract
        self._at = lru_cache(BLOCKS)(self._fields_at)
        by_table: dict[Table, list[Field]] = {}
        for f in self.contract.fields:
            by_table.setdefault(f.table, []).append(f)
        self._tables = by_table

    @cached_property
    def functions(self) -> frozenset[int]:
        """Codes of the functions that the device has."""
        found = {IDENTIFY} if self.contract.known_by == "identity" else set()
        for table, some in self._tables.items():
            found.add(READS[table])
            for f in some:
                if f.access != "ro":
                    found.update((f.function,) if f.function else WRITES[table])
        return frozenset(found)

    def read(self, function: int, address: int, count: int) -> Answer:
        """The registers or bits of a range, or the exception code with which the device refuses."""
        try:
            table = self._table(function)
            if table not in BITS and count > self.contract.manners.most_read:
                raise Refused(ExcCodes.ILLEGAL_VALUE)
            with self.device.clock.lock:
                fields = self._whole(table, address, count)
                if table in BITS:
                    return [bool(self.device.read(f.name)) for f in fields]
                return self._registers(fields, address, count)
        except Refused as refused:
            return ExcCodes(refused.code)
        except Exception as error:  # whatever a scene's numbers lead to
            self.device.clock.failed(error)
            return ExcCodes.DEVICE_FAILURE

    def write(self, function: int, address: int, values: Sequence[int] | Sequence[bool]) -> ExcCodes | None:
        """Write a range; returns the exception code with which the device refuses, or None."""
        try:
            table = self._table(function)
            if table not in BITS and len(values) > self.contract.manners.most_written:
                raise Refused(ExcCodes.ILLEGAL_VALUE)
            with self.device.clock.lock:
                fields = self._whole(table, address, len(values))
                if any(f.access == "ro" for f in fields):
                    raise Refused(ExcCodes.ILLEGAL_ADDRESS)
                if any(f.function not in (0, function) for f in fields):
                    raise Refused(ExcCodes.ILLEGAL_FUNCTION)
                numbers, texts = self._taken(fields, address, [int(value) for value in values])
                if numbers:
                    self.device.write(numbers)
                for name, text in texts.items():
                    self.device.write_text(name, text)
        except Refused as refused:
            return ExcCodes(refused.code)
        except Exception as error:  # whatever a scene's numbers lead to
            self.device.clock.failed(error)
            return ExcCodes.DEVICE_FAILURE
        return None

    def _table(self, function: int) -> Table:
        if function not in self.functions:
            raise Refused(ExcCodes.ILLEGAL_FUNCTION)
        return TABLE_OF[function]

    def _fields_at(self, table: Table, address: int, count: int) -> tuple[list[Field], bool]:
        """Fields of a table that lie in a range, at least partly, and whether they fill it."""
        end = address + count
        found = [f for f in self._tables[table] if f.address < end and f.address + f.width > address]
        held = {at for f in found for at in range(f.address, f.address + f.width)}
        return found, held.issuperset(range(address, end))

    def _whole(self, table: Table, address: int, count: int) -> list[Field]:
        """The fields of a range. Raises Refused: a part of it does not exist."""
        fields, filled = self._at(table, address, count)
        if not filled:
            raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        self.device.requested()
        return fields

    def _registers(self, fields: Sequence[Field], address: int, count: int) -> list[int]:
        registers = [0] * count
        for f in fields:
            data = self._bytes(f)
            for number, register in enumerate(struct.unpack(f">{len(data) // 2}H", data), f.address - address):
                if 0 <= number < count:
                    registers[number] |= register  # several fields may share a register
        return registers

    def _bytes(self, f: Field) -> bytes:
        if f.type == "text":
            return self.contract.encode_text(f.name, self.device.read_text(f.name))
        return self.contract.pack(f.name, self.device.read(f.name), self._beside(f))

    def _beside(self, f: Field) -> Mapping[str, float]:
        return {name: self.device.read(name) for name in f.beside}

    def _taken(
        self, fields: Sequence[Field], address: int, registers: Sequence[int]
    ) -> tuple[dict[str, float], dict[str, str]]:
        """Physical values and texts of a write, after the checks of a real device. Raises Refused."""
        values: dict[str, float] = {}
        texts: dict[str, str] = {}
        for f in fields:
            at = f.address - address
            if at < 0 or at + f.width > len(registers):  # only a part of a value, as one half of 32 bits
                raise Refused(ExcCodes.ILLEGAL_VALUE)
            if f.table in BITS:
                values[f.name] = float(registers[at])
                continue
            data = struct.pack(f">{f.width}H", *registers[at : at + f.width])
            if f.type == "text":
                try:
                    texts[f.name] = self.contract.decode_text(f.name, data)
                except ValueError:
                    raise Refused(ExcCodes.ILLEGAL_VALUE) from None
                continue
            if not self.contract.allows(f.name, value := self._value(f, data)):
                self.device.out_of_range()
                raise Refused(ExcCodes.ILLEGAL_VALUE)
            values[f.name] = value
        return values, texts

    def _value(self, f: Field, data: bytes) -> float:
        """Physical value of what a client writes; NaN: it is none, as with more digits than can be kept."""
        try:
            return self.contract.decode(f.name, data, self._beside(f))
        except struct.error:
            return math.nan


class Units:
    """The devices of a server by unit id, in the form in which pymodbus' requests ask for their datastore."""

    def __init__(self, registers: Mapping[int, Registers]) -> None:
        self.registers = registers

    async def async_getValues(self, unit: int, function: int, address: int, count: int) -> Answer:
        """Called by a request; it never awaits, because meanwhile pymodbus could answer another one."""
        return self.registers[unit].read(function, address, count)

    async def async_setValues(
        self, unit: int, function: int, address: int, values: list[int] | list[bool]
    ) -> ExcCodes | None:
        """Called by a request; it never awaits."""
        return self.registers[unit].write(function, address, values)
