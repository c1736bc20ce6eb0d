"""The base of the Modbus drivers."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

from palpate.drivers.clock import Clock
from palpate.drivers.devices.device import (
    APPLICATION,
    SERIAL,
    Device,
    check_inventory,
    check_marks,
    check_objects,
    identity_objects,
    serial_number,
)
from palpate.drivers.links.modbus import ACKNOWLEDGED, READERS, SELDOM, SOON, WRITERS, ModbusLink, confirms
from palpate.instrument.contracts.contract import PROBE, Contract, Value
from palpate.instrument.contracts.field import BITS, ONE_REGISTER, READS, Field, Table
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, LinkError, LinkTimeout, UsageError

# --- which requests read or write some fields ----------------------------------------------------------


MOST_BITS = 1968  # coils or discrete inputs of one request ("MODBUS application protocol" 1.1b3, 6.11)
ONE_COIL = 5  # function code that writes one coil


@dataclass(frozen=True, slots=True)
class Read:
    """One request that reads fields.

    Attributes:
        names: the fields.
        function: its function code.
        start: its first register, or its first coil.
        count: number of these.
        places: place of each field in the bytes of the reply; a coil takes one byte.
        bits: whether it reads coils or discrete inputs.
        registers: makes bytes of the registers of its reply.
        wider: a request for the same fields and one beside them; None: there is none.
        apart: requests for the same fields, each only for those that must be read together; none: it is such a request.
    """

    names: tuple[str, ...]
    function: int
    start: int
    count: int
    places: list[slice]
    bits: bool
    registers: struct.Struct
    wider: Read | None = None
    apart: tuple[Read, ...] = ()


@dataclass(frozen=True, slots=True)
class ReadRequests:
    """The requests that read some fields, and the fields that tell their scales and signs.

    Attributes:
        names: the fields that are asked for.
        requests: the requests; between them they hold these fields, and those that are read along.
        along: fields that are read along.
        apart: fields that tell a scale, but stand too far away to be read along.
        scaled: whether some of the fields mean nothing without others.
        direct: whether one request gives the fields and those along, in this order.
    """

    names: tuple[str, ...]
    requests: tuple[Read, ...]
    along: tuple[str, ...]
    apart: tuple[str, ...]
    scaled: bool
    direct: bool


@dataclass(frozen=True, slots=True)
class Write:
    """One request that writes fields.

    Attributes:
        names: the fields, by address.
        function: its function code.
        start: its first register, or its first coil.
        count: number of these.
        bits: whether it writes coils.
        places: first byte of each field, if some of them are parts of one register; else nothing.
    """

    names: tuple[str, ...]
    function: int
    start: int
    count: int
    bits: bool
    places: tuple[int, ...] = ()

    def content(self, data: list[bytes]) -> list[Any]:
        """Registers or coils of the request, from the bytes of each field; bits that no field has are 0."""
        if self.bits:
            return [each != b"\0" for each in data]
        whole = b"".join(data)
        if self.places:
            merged = bytearray(2 * self.count)
            for at, each in zip(self.places, data, strict=True):
                for number, octet in enumerate(each, at):
                    merged[number] |= octet
            whole = bytes(merged)
        return list(struct.unpack(f">{self.count}H", whole))


def fits(contract: Contract, names: Iterable[str]) -> bool:
    """Whether one request can read all these fields: devices refuse to read registers that no field has."""
    fields = [contract[name] for name in names]
    if len({f.table for f in fields}) > 1:
        return False
    start, count = contract.block([f.name for f in fields])
    if count > _most(contract, fields[0].table):
        return False
    return not _holes(contract, fields[0].table, start, count)


def reading(contract: Contract, names: tuple[str, ...], *, scaled: bool = True) -> ReadRequests:
    """The requests that read fields; `scaled`: also what tells their scales and signs.

    Raises UsageError: fields whose sign is in one register stand too far apart for one request.
    """
    units: list[set[str]] = []
    apart: list[str] = []
    for name in names:
        f, unit = contract[name], {name}
        if scaled and f.sign:
            unit.add(f.sign[0])
        if scaled and f.scaling:
            if fits(contract, {*unit, f.scaling.told_by}):
                unit.add(f.scaling.told_by)
            elif f.scaling.told_by not in names:
                apart.append(f.scaling.told_by)
        touched = [each for each in units if each & unit]
        units = [each for each in units if not each & unit] + [unit.union(*touched)]
    for unit in units:
        if not fits(contract, unit):
            raise UsageError(f"{contract.title}: {', '.join(sorted(unit))} do not fit one request; read them apart")
    found: list[list[set[str]]] = []
    for unit in sorted(units, key=lambda unit: _order(contract, unit)):
        if found and fits(contract, unit.union(*found[-1])):
            found[-1].append(unit)
        else:
            found.append([unit])

    def ordered(some: Iterable[str]) -> tuple[str, ...]:
        return tuple(sorted(some, key=lambda name: _rank(names, name)))

    requests = tuple(
        _read(
            contract,
            ordered(set().union(*some)),
            wider=True,
            apart=tuple(_read(contract, ordered(unit)) for unit in some) if len(some) > 1 else (),
        )
        for some in found
    )
    along = tuple(name for each in requests for name in each.names if name not in names)
    wanting = scaled and any(contract[name].beside for name in names)
    direct = len(requests) == 1 and requests[0].names == (*names, *along)
    return ReadRequests(names, requests, along, tuple(dict.fromkeys(apart)), wanting, direct)


def _rank(names: tuple[str, ...], name: str) -> tuple[int, str]:
    return (names.index(name) if name in names else len(names), name)


def _order(contract: Contract, names: Iterable[str]) -> tuple[str, int]:
    """Where fields of one request stand: their table and first address."""
    fields = [contract[name] for name in names]
    return fields[0].table, min(f.address for f in fields)


def _most(contract: Contract, table: Table) -> int:
    return MOST_BITS if table in BITS else contract.manners.most_read


def _holes(contract: Contract, table: Table, start: int, count: int) -> bool:
    """Whether some of the addresses belong to no field."""
    some = (f for f in contract.fields if f.table == table)
    addresses = {at for f in some for at in range(f.address, f.address + f.width)}
    return not addresses.issuperset(range(start, start + count))


def _read(contract: Contract, names: tuple[str, ...], *, wider: bool = False, apart: tuple[Read, ...] = ()) -> Read:
    fields = [contract[name] for name in names]
    start, count = contract.block(names)
    size = 1 if fields[0].table in BITS else 2
    ends = [(size * (f.address - start), f.size) for f in fields]
    wide = widened(contract, names) if wider else names
    places = [slice(at, at + length) for at, length in ends]
    wider_read = _read(contract, wide) if wide != names else None
    registers = struct.Struct(f">{count}H")
    return Read(names, READS[fields[0].table], start, count, places, size == 1, registers, wider_read, apart)


def widened(contract: Contract, names: tuple[str, ...]) -> tuple[str, ...]:
    """These fields and one number field beside them that can be read with them, if there is one.

    That is none which a command waits for, because some devices clear it when it is read.
    """
    start, count = contract.block(names)
    table = contract[names[0]].table
    waited = {each.field for command in contract.commands for each in (command.done, command.failed) if each}
    beside = [
        f.name
        for f in contract.fields
        if f.table == table and f.access != "wo" and f.type != "text" and f.name not in waited
        and (start + count == f.address or f.address + f.width == start)
        and count + f.width <= _most(contract, table)
    ]  # fmt: skip
    return (*names, *beside[-1:])


def companions(contract: Contract, name: str) -> frozenset[str]:
    """The fields that must be written together with one, and itself: its run, and the other parts of its register."""
    found, queue = {name}, [name]
    while queue:
        f = contract[queue.pop()]
        shared = [each.name for each in contract.fields if f.part and _is_other_part(each, f)]
        runs = [run for run in contract.manners.together if f.name in run]
        new = set(itertools.chain(shared, *runs)) - found
        found |= new
        queue += new
    return frozenset(found)


def _is_other_part(other: Field, f: Field) -> bool:
    return other.access != "ro" and (other.table, other.address) == (f.table, f.address)


def write(contract: Contract, given: tuple[str, ...]) -> Write:
    """The request that writes fields. Raises UsageError: one request cannot write them, or not without others."""
    listed = ", ".join(given)
    if missing := set().union(*(companions(contract, name) for name in given)) - set(given):
        raise UsageError(
            f"{contract.title}: {listed} cannot be written without {', '.join(sorted(missing))}, which the device "
            "takes in the same request; give these as well"
        )
    names = tuple(sorted(given, key=lambda name: contract[name].address))
    fields = [contract[name] for name in names]
    start, count = contract.block(names)
    covered = {at for f in fields for at in range(f.address, f.address + f.width)}
    if len({f.table for f in fields}) > 1 or len(covered) != count:
        raise UsageError(f"{contract.title}: {listed} are not adjacent in the contract; write them one by one")
    functions = {f.writes for f in fields}
    if fields[0].table in BITS:
        most = MOST_BITS
        function = functions.pop() if count == 1 else 15
        if count > 1 and any(f.function == ONE_COIL for f in fields):
            most = 1
    else:
        function = functions.pop()
        most = 1 if function == ONE_REGISTER else contract.manners.most_written
    if functions - {function, ONE_COIL} or count > most:
        raise UsageError(
            f"{contract.title}: {listed} take {count} addresses, but one request of the device writes {most}; write "
            "them one by one"
        )
    places = tuple(2 * (f.address - start) for f in fields) if any(f.part for f in fields) else ()
    return Write(names, function, start, count, fields[0].table in BITS, places)


# --- the device ----------------------------------------------------------------------------------------


WRITES_REGISTERS = 16  # function code
NO_FUNCTION = 1  # exception with which a device refuses a function that it does not have
UNKNOWN = (
    "by which the contract knows it: another device or firmware; check its address in the bench file, or use a map "
    "that knows it by marks"
)
ONLY_SO = (2, 3)  # exceptions with which a device refuses a read of anything but its own blocks


class ModbusDevice(Device):
    """Reads and writes the fields of the contract by checked requests, with the functions that the contract names.

    A write is sent once; if it is not confirmed, it is read back. The driver remembers written settings in order to
    restore them, but no orders. A setting whose memory wears is written only if the device holds another value.

    Replies on a serial line have no transaction number. So that a late reply cannot answer the next read, successive
    reads ask for different numbers of registers, if the contract has one more to read. A device that refuses such a
    read, or one of several fields, is asked for the fields alone from then on.
    """

    def __init__(self, link: ModbusLink, unit: int, clock: Clock, contract: Contract | None = None) -> None:
        super().__init__(f"at {link.name} unit {unit}", clock, contract)
        self.link: ModbusLink = link
        self.unit = unit
        self._reading: Callable[[tuple[str, ...]], ReadRequests] = cache(partial(reading, self.contract))
        self._unscaled: Callable[[tuple[str, ...]], ReadRequests] = cache(partial(reading, self.contract, scaled=False))
        self._writing: Callable[[tuple[str, ...]], Write] = cache(partial(write, self.contract))
        self._companions: Callable[[str], frozenset[str]] = cache(partial(companions, self.contract))
        self._is_setting: Callable[[str], bool] = cache(self._restorable)
        manners = self.contract.manners
        self._timing = {"gap": manners.gap, "responds": manners.responds or 0.0, "busy": manners.busy}
        self._last_count = 0  # number of registers in the last read
        self._widens = True  # whether it takes reads of more than was asked for, as far as is known
        self._split: set[tuple[str, ...]] = set()  # fields that it does not give in one request

    def identify(self) -> None:
        """Check that this is the contract's device, and that it tells the same scales and units as before.

        Raises:
            IdentityError: another vendor, product or major version, a mark that does not fit, another word order, or
                another serial number than before; or the bench file does not name a device that cannot be known.
            LinkError, LinkTimeout, DeviceError: it does not answer, refuses, or tells another scale or unit.
        """
        serial = self.recognise()
        if self.contract.has("probe") and (probe := int(self.get("probe"))) != PROBE:
            raise IdentityError(
                f"{self.name}: word-order probe reads 0x{probe:08X}, should read 0x{PROBE:08X}; "
                "set the device to big-endian words (most significant first)"
            )
        self._scales.check()
        self.serial = self._same(serial or serial_number(self))

    def recognise(self) -> str:
        """Check that this is the contract's device, whatever its scales and units; returns the serial number in 43/14.

        Raises as `identify`.
        """
        match self.contract.known_by:
            case "identity":
                return self._check_identity()
            case "marks":
                check_marks(self)
            case "nothing":
                check_inventory(self)
        return ""

    def _check_identity(self) -> str:
        """Check the identity objects that the contract has; returns the serial number among them. Raises as above."""
        try:
            objects = self._asked(partial(identity_objects, self._transact))
        except DeviceError as error:
            if error.code != NO_FUNCTION:
                raise
            raise IdentityError(f"{self.name}: refuses function 43/14, {UNKNOWN}", device=self.name) from None
        except LinkTimeout:
            if not self._answers():
                raise
            why = f"{self.name}: answers reads, but gives no valid answer to function 43/14, {UNKNOWN}"
            raise LinkTimeout(why, device=self.name) from None
        check_objects(self, objects)
        self.simulated = objects.get(APPLICATION, "") == "simulated"
        return objects.get(SERIAL, "")

    def _answers(self) -> bool:
        """Whether it answers a read of a register, be it by a refusal."""
        try:
            self._transact(READERS[3], 0, 1)
        except LinkError:
            return False
        except DeviceError:
            pass
        return True

    def _transact(self, request: Callable[..., Any], *args: object) -> Any:
        return self.link.transact(self.name, request, *args, self.unit, meanwhile=self.afterwards, **self._timing)

    def get(self, name: str) -> float:
        """Physical value of one field, in the contract's unit; NaN: it has no reading. Raises as `get_many`."""
        return self.get_many(name)[0]

    def get_many(self, *names: str) -> list[float]:
        """Physical values of fields, read in one request if they stand together, in the contract's units.

        Raises:
            LinkError, LinkTimeout, DeviceError: no answer, an exception response, a value outside its limits, or a
                scale that has changed.
            UsageError: one request cannot read a sign together with all values that it belongs to.
        """
        plan = self._reading(names)
        if plan.direct and not plan.scaled:
            return self._asked(lambda: list(map(self._value, names, self._ask(plan.requests[0]))))
        return self._asked(lambda: self._values(plan, self._value))

    def _values(self, plan: ReadRequests, value: Callable[..., float]) -> list[float]:
        """Values of a reading, each made by `value` of its name, its bytes and what is beside it."""
        if not plan.scaled:
            return list(map(value, plan.names, self._fetch(plan)))
        beside = {name: self._scales.scale(name) for name in plan.apart}
        names = (*plan.names, *plan.along)
        data = dict(zip(names, self._fetch(plan), strict=True))
        for name in names:
            if not self.contract[name].beside:
                beside[name] = value(name, data[name])
                self._scales.take(name, beside[name])
        return [value(name, data[name], beside) for name in plan.names]

    def held(self, name: str) -> float:
        """Value of a field, which may be outside the limits."""
        return self._asked(lambda: self._values(self._reading((name,)), self._decoded))[0]

    def get_text(self, name: str) -> str:
        """Content of a text field. Raises LinkError, LinkTimeout, DeviceError: no answer, or one that is no text."""
        return self._asked(lambda: self._text(name, *self._read((name,))))

    def _text(self, name: str, data: bytes) -> str:
        try:
            return self.contract.decode_text(name, data)
        except ValueError as error:
            raise DeviceError(f"{self.name}: {name} holds no text ({error}); write it anew") from None

    def _read(self, names: tuple[str, ...]) -> list[bytes]:
        """The bytes of each field, without what tells their scales and signs."""
        return self._fetch(self._unscaled(names))

    def _fetch(self, plan: ReadRequests) -> list[bytes]:
        """The bytes of each field of a reading, then those of the fields that are read along."""
        if plan.direct:
            return self._ask(plan.requests[0])
        found: dict[str, bytes] = {}
        for request in plan.requests:
            found.update(zip(request.names, self._ask(request), strict=True))
        return [found[name] for name in (*plan.names, *plan.along)]

    def _ask(self, read: Read) -> list[bytes]:
        """The bytes of each field of a request. Raises LinkError, LinkTimeout, DeviceError."""
        if read.names in self._split:
            return self._ask_apart(read)
        wider = read.wider
        if self._widens and self.link.serial and read.count == self._last_count and wider:
            try:
                return self._ask_once(wider)[: len(read.names)]
            except DeviceError as error:
                if error.code not in ONLY_SO:
                    raise
            given = self._ask(read)
            self._widens = False
            return given
        try:
            return self._ask_once(read)
        except DeviceError as error:
            if error.code not in ONLY_SO or not read.apart:
                raise
        given = self._ask_apart(read)
        self._split.add(read.names)
        return given

    def _ask_apart(self, read: Read) -> list[bytes]:
        """The bytes of each field of a request, by one request for each that can be read alone."""
        found: dict[str, bytes] = {}
        for part in read.apart:
            found.update(zip(part.names, self._ask_once(part), strict=True))
        return [found[name] for name in read.names]

    def _ask_once(self, read: Read) -> list[bytes]:
        self._last_count = count = read.count
        try:
            reply: Any = self._transact(READERS[read.function], read.start, count)
        except DeviceError as error:
            raise DeviceError(f"{error}, to a read of {', '.join(read.names)}", code=error.code) from None
        if read.bits:
            count = -(-count // 8) * 8  # a reply holds whole bytes
        given = getattr(reply, "bits" if read.bits else "registers", [])
        if reply.function_code != read.function or len(given) != count:
            what = "bits" if read.bits else "registers"
            raise DeviceError(
                f"{self.name}: answered function {reply.function_code} with {len(given)} {what} "
                f"where function {read.function} with {count} was asked; the reply is not used"
            )
        data = bytes(given) if read.bits else read.registers.pack(*given)
        return [data[place] for place in read.places]

    def give(self, /, **values: Value) -> None:
        """As `set`."""
        self.set(**values)

    def set(self, /, **values: Value) -> bool:
        """Write fields that stand together in one request, which is never repeated after it may have been carried out.

        Where the device only acknowledges it (exception 5), settings are read back until they are there. An order may
        be carried out later then, and False is returned: `command` awaits its end, if the contract says how that is
        known, and a driver with `orders` does by `_await_start`.

        Raises:
            RangeError: a value outside its limits; nothing is sent.
            UsageError: one request cannot write them, or not without others; nothing is sent.
            DeviceError: the device refused, naming the fields and values; its memory was written too often; or it
                acknowledged a setting, and does not hold it in time.
            LinkError, LinkTimeout: it is not confirmed, and does not read back as written.
        """
        plan = self._writing(tuple(values))
        data = [self._scales.encode(name, values[name]) for name in plan.names]
        if worn := self._wear.of(values):
            if all(self.contract[name].access == "rw" for name in values) and not self._differing(values):
                self._remember(values)
                return True
            self._wear.count(worn)
        confirmed = True
        try:
            confirmed = self._ordered(lambda: self._send(plan, plan.content(data), values))
        except BenchError as error:
            if isinstance(error, LinkError):
                self._remember(values)  # a write without confirmation may have been carried out
            if self.broken or self.read_attempts == 1 or not self._reads_back(values):
                raise
            self.noticed(f"{error}; read back, it was carried out")
        self._remember(values)
        return confirmed or self._await(values)

    def _await(self, values: Mapping[str, Value]) -> bool:
        """Wait until the device holds what it has acknowledged; returns whether that can be told, as of settings.

        Raises DeviceError: it does not in time.
        """
        if not self._readable(values):
            ends_known = type(self).orders | {each.field for each in self.contract.commands if each.done}
            if values.keys() - ends_known:
                self.noticed(f"{self.name}: acknowledged {self._described(values)}: it is taken, its end is not known")
            return False
        left = self.contract.manners.busy
        while differing := self._differing(values):
            if left <= 0:
                shown = ", ".join(f"{name} is {self._shown(name, data)}" for name, data in differing.items())
                raise DeviceError(
                    f"{self.name}: acknowledged {self._described(values)}, but {shown} after "
                    f"{self.contract.manners.busy:g} s; raise busy in [manners] of its map if it needs longer",
                    device=self.name,
                )
            self.clock.wait(min(SELDOM, left))
            left -= SELDOM
        return True

    def _await_start(self, begun: Callable[[], bool]) -> None:
        """Wait until an acknowledged order has `begun`, at most for as long as the device may be busy."""
        left = self.contract.manners.busy
        while not begun() and left > 0:
            self.clock.wait(min(SOON, left))
            left -= SOON

    def _send(self, plan: Write, content: list[Any], values: Mapping[str, Value]) -> bool:
        """Send a write; returns whether it is confirmed, or else acknowledged."""
        if plan.function == WRITES_REGISTERS:
            return self._write(plan.start, content, values)
        return self._order(plan.function, plan.start, content, values)

    def _write(self, start: int, registers: list[int], values: Mapping[str, Value]) -> bool:
        return self._order(WRITES_REGISTERS, start, registers, values)

    def _order(self, function: int, start: int, content: list[Any], values: Mapping[str, Value]) -> bool:
        try:
            reply = self._transact(WRITERS[function], start, content)
        except DeviceError as error:
            if error.code == ACKNOWLEDGED:
                return False
            raise DeviceError(f"{error}, to {self._described(values)}", code=error.code) from None
        if not confirms(reply, function, start, content):
            raise DeviceError(f"{self.name}: did not confirm {self._described(values)}; the setting is uncertain")
        return True

    def _restorable(self, name: str) -> bool:
        """Whether it can be restored, with all that must be written together with it."""
        return all(self.contract[each].access == "rw" and each not in self.orders for each in self._companions(name))

    def _remember(self, values: Mapping[str, Value]) -> None:
        for name, value in values.items():
            if self._is_setting(name):
                self._settings[name] = value

    def _reads_back(self, values: Mapping[str, Value]) -> bool:
        """Whether all that was written can be read, and reads as it was written."""
        if not self._readable(values):
            return False
        try:
            return not self._differing(values)
        except BenchError:
            return False

    def _readable(self, values: Mapping[str, Value]) -> bool:
        """Whether what was written can be read back: settings can, orders cannot."""
        return not self.orders & values.keys() and all(self.contract[name].access == "rw" for name in values)

    def _differing(self, values: Mapping[str, Value]) -> dict[str, bytes]:
        """Those that the device holds otherwise, as it holds them: within their limits or not."""
        found = dict(zip(values, self._asked(lambda: self._read(tuple(values))), strict=True))
        return {name: found[name] for name, value in values.items() if not self._scales.holds(name, found[name], value)}

    def differences(self) -> list[str]:
        """The settings that the device no longer holds.

        Raises LinkError, DeviceError; DeviceError also where it tells another scale or unit than before.
        """
        self._scales.check()
        differing = self._differing(self._settings) if self._settings else {}
        return [
            f"{self.name}: {name} is {self._shown(name, data)}, was set to {self._settings[name]}"
            for name, data in differing.items()
        ]

    def _shown(self, name: str, data: bytes) -> str:
        if self.contract[name].type == "text":
            return repr(data.decode("utf-8", "replace"))
        return f"{self._decoded(name, data, self._scales.beside(name)):g}"

    def restore(self) -> None:
        """Write lost settings again, and check that they stay. Raises as `set`, and DeviceError: they do not stay."""
        restored: set[str] = set()
        for name in self._differing(self._settings) if self._settings else {}:
            if name not in restored:
                together = self._companions(name)
                self.set(**{each: value for each, value in self._settings.items() if each in together})
                restored |= together
        if left := self.differences():
            raise DeviceError(f"{'; '.join(left)}: it does not take its settings; look at it")

    def _described(self, values: Mapping[str, Value]) -> str:
        return ", ".join(self.contract.described(name, value) for name, value in values.items())
