"""What all simulated Modbus devices share: the settings of their contract, and the refusal of what a device refuses."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar, NamedTuple, Self

from pymodbus.constants import ExcCodes

from palpate.instrument.bench.kinds import DeviceKind, Role
from palpate.instrument.contracts.contract import Contract, Field
from palpate.instrument.contracts.field import BITS, READS, WRITES, Table
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock


@dataclass(frozen=True)
class SimulatedPlace:
    """What a simulated device gets from its bench.

    Attributes:
        clock: the bench's clock.
        rig: the physical state of the scene, a `Rig`; untyped, because `simulators/rig.py` may import the wire.
        unit: Modbus unit id, or CANopen node id.
        serial: serial number: text on Modbus, an integer on CANopen.
        settings: settings of its device kind, from the bench file.
        kind: its device kind.
        find: returns the simulated device that fills a role; call it once all devices exist. Raises
            BenchError: no device fills it.
        samples: samples in the sample changer.
        number: which of the devices that fill its role it is, from 1, if it is a sensor node; 0: it fills none.
    """

    clock: VirtualClock
    rig: Any
    unit: int
    serial: Any
    settings: Any
    kind: DeviceKind
    find: Callable[[Role], Any]
    samples: Sequence[Sample] = ()
    number: int = 0


class Refused(Exception):
    """The device refuses a write, with this Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception code {code}")
        self.code = code


ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4
DEVICE_BUSY = 6


def first_settings(contract: Contract) -> dict[str, float]:
    """The numbers that a device holds at power-on: its defaults, its marks, and the units that the map expects."""
    settings = {f.name: float(f.default) for f in contract.fields if f.type != "text"}
    settings |= {mark.field: float(mark.value) for mark in contract.marks if not isinstance(mark.value, str)}
    for f in contract.fields:
        if f.unit_in:
            settings[f.unit_in] = float(contract[f.unit_in].choices[f.unit])
    return settings


class SimulatedDevice:
    """One device on a Modbus server. Methods are called under the clock's lock."""

    contract: Contract
    readings: ClassVar[tuple[str, ...]] = ()  # names of displayed fields, which the fault `stuck_display` can freeze
    speed = 1.0  # speed of this clock relative to the clients' clock, in whose seconds a watchdog counts
    rig: Any  # that of its place, once it stands on a bench

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        """Make the device for its place on a bench; a device whose constructor takes more arguments overrides this."""
        made = cls(place.clock, place.serial)
        made.rig = place.rig
        return made

    def __init__(self, clock: VirtualClock, serial: str) -> None:
        self.clock = clock
        self.serial = serial
        self.settings = first_settings(self.contract)
        clock.add(self)

    def read(self, name: str) -> float:
        """Present physical value of a field, in the contract's unit."""
        return self.settings[name]

    def write(self, values: dict[str, float]) -> None:
        """Store what a client writes, which has been checked against the contract's limits. Raises Refused."""
        self.settings.update(values)

    def turn(self, values: dict[str, float]) -> None:
        """Store what somebody sets at the front panel. Raises Refused."""
        self.write(values)

    def read_text(self, name: str) -> str:
        """Present content of a text field."""
        raise NotImplementedError

    def write_text(self, name: str, text: str) -> None:
        """Store a text that a client writes. Raises Refused."""
        raise NotImplementedError

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.turn({f.name: float(f.default) for f in self.contract.fields if f.access == "rw"})

    def out_of_range(self) -> None:
        """Called after a write was refused because a value lies outside the contract's limits."""

    def requested(self) -> None:
        """Called when a request of any kind has come in."""

    def next_event_ns(self) -> int:
        return NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        pass


# --- Registers and coils of one simulated Modbus device, as its contract declares them -----------------

BLOCKS = 64  # number of register blocks whose fields are cached
TABLE_OF: dict[int, Table] = {function: table for table, function in READS.items()} | {
    function: table for table, functions in WRITES.items() for function in functions
}
IDENTIFY = 43

Answer = bytes | list[bool] | ExcCodes


class _PlainRange(NamedTuple):
    """What lies in a range of a table.

    Attributes:
        fields: the fields that lie there, at least partly.
        filled: whether they fill it.
        together: what packs their raw values if each is there as a whole and once; None: they are packed one by one.
    """

    fields: list[Field]
    filled: bool
    together: struct.Struct | None


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
        """The registers of a range as bytes, its bits, or the exception code with which the device refuses."""
        try:
            table = self._table(function)
            if table not in BITS and count > self.contract.manners.most_read:
                raise Refused(ExcCodes.ILLEGAL_VALUE)
            with self.device.clock.lock:
                found = self._whole(table, address, count)
                if table in BITS:
                    return [bool(self.device.read(f.name)) for f in found.fields]
                if found.together is not None:
                    return found.together.pack(*[f.to_raw(self.device.read(f.name)) for f in found.fields])
                return self._registers(found.fields, address, count)
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
                fields = self._whole(table, address, len(values)).fields
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

    def _fields_at(self, table: Table, address: int, count: int) -> _PlainRange:
        end = address + count
        found = [f for f in self._tables[table] if f.address < end and f.address + f.width > address]
        held = [at for f in found for at in range(f.address, f.address + f.width)]
        alone = held == list(range(address, end)) and table not in BITS
        return _PlainRange(
            found, set(held).issuperset(range(address, end)), self.contract.together(found) if alone else None
        )

    def _whole(self, table: Table, address: int, count: int) -> _PlainRange:
        """What lies in a range. Raises Refused: a part of it does not exist."""
        found = self._at(table, address, count)
        if not found.filled:
            raise Refused(ExcCodes.ILLEGAL_ADDRESS)
        self.device.requested()
        return found

    def _registers(self, fields: Sequence[Field], address: int, count: int) -> bytes:
        registers = [0] * count
        for f in fields:
            data = self._bytes(f)
            for number, register in enumerate(struct.unpack(f">{len(data) // 2}H", data), f.address - address):
                if 0 <= number < count:
                    registers[number] |= register  # several fields may share a register
        return struct.pack(f">{count}H", *registers)

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

    async def async_getValues(
        self, unit: int, function: int, address: int, count: int
    ) -> list[int] | list[bool] | ExcCodes:
        """Called by a request; it never awaits, because meanwhile pymodbus could answer another one."""
        found = self.registers[unit].read(function, address, count)
        return list(struct.unpack(f">{count}H", found)) if isinstance(found, bytes) else found

    async def async_setValues(
        self, unit: int, function: int, address: int, values: list[int] | list[bool]
    ) -> ExcCodes | None:
        """Called by a request; it never awaits."""
        return self.registers[unit].write(function, address, values)
