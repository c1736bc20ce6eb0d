"""The declaration of a device: its fields, its process data, its commands and its manners, which are found by name."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import re
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, field, fields
from typing import Any, Literal

from palpate.instrument.contracts.field import (
    BITS,
    GREATEST_SCALE,
    LEAST_SCALE,
    ONE_REGISTER,
    SIZE,
    Field,
    Value,
    check_name,
    check_once,
)
from palpate.instrument.errors import ConfigError, RangeError, UnknownName

# --- process data objects ------------------------------------------------------------------------------


NODES = range(1, 128)
LARGEST = 0x7FF  # identifier of a frame
# Identifiers of other messages, whatever the node: of NMT, SYNC and time stamps, with those that CiA 301 keeps free;
# of node guarding. Those that a node has beside its PDOs are below.
KEPT = (range(0x00, 0x81), range(0x100, 0x181), range(0x6E0, 0x700), range(0x780, 0x800))
OF_A_NODE = {"emergencies": 0x80, "SDO answers": 0x580, "SDO requests": 0x600, "heartbeat": 0x700}
SENT, TAKEN = 0x1800, 0x1400  # objects of the first PDO that a node sends, and of the first that it takes
COB_ID, TRANSMISSION_TYPE = 1, 2  # their subindices
AT_SYNC = range(1, 241)  # transmission types
PDOS = 0x200  # PDOs that a node can have in each direction, and objects between one's communication and its mapping
MOST_ENTRIES = 8  # objects of one byte fill a frame
INHIBIT_STEP, LONGEST_INHIBIT = 1e-4, 6.5535  # s


@dataclass(frozen=True, slots=True)
class Pdo:
    """A process data object: COB-ID `base + node id`, fields packed in order.

    Attributes:
        name: its name.
        base: its COB-ID without the node id.
        fields: its fields.
        index: its communication object (1800h and on, or 1400h and on), if a driver sets the PDO when it connects; 0:
            the node has it as it is.
        transmission: its transmission type, which is then set; 1: at every SYNC, 255: when the node wants.
        inhibit: least time between two frames that a node sends, which is then set [s].
        fixed: its communication object, if the node lets nobody set the PDO up; 0: it is not known, or it can be.
        node: the node id at which alone its COB-ID is known; 0: any.
    """

    name: str
    base: int
    fields: tuple[str, ...]
    index: int = 0
    transmission: int = 1
    inhibit: float = 0.0
    fixed: int = 0
    node: int = 0

    def cob_id(self, node_id: int) -> int:
        """Its COB-ID at a node id. Raises ConfigError: it is known at another node id alone."""
        if self.node not in (0, node_id):
            raise ConfigError(
                f"PDO {self.name} has the COB-ID 0x{self.base + self.node:X} at node id {self.node}, and none that is "
                f"known at node id {node_id}; give the device node id {self.node}, or import the maker's file anew"
            )
        return self.base + node_id

    def node_of(self, cob_id: int) -> int:
        """The node id at which it has a COB-ID; 0: there is none."""
        node_id = cob_id - self.base
        return node_id if node_id in NODES and self.node in (0, node_id) else 0


def is_relative(index: int, subindex: int) -> bool:
    """Whether an object holds a COB-ID, to whose default the node id is added."""
    emergency = index == 0x1014
    return emergency or (subindex == COB_ID and (TAKEN <= index < TAKEN + PDOS or SENT <= index < SENT + PDOS))


# --- cyclic frames: a list of frames with one identifier, which a CAN bus sends over and over ------------

# On a real bus the kernel of Linux does this (its broadcast manager). A bus within this machine has no such kernel:
# there the list is handed to the bus's other end, in frames with 29-bit identifiers that no node listens to. That end
# then acts as if it received the frames in time.

MOST_CYCLIC = 256  # frames of a list, as in Linux
HANDED_OVER, CONTENT = 0x1CBC_0000, 0x800  # identifiers are these and the identifier of the frames
HEAD = struct.Struct("<HI")  # number of frames, 0: the list ends; time between two frames [us]

Listed = tuple[int, list[bytes], int]
"""Identifier, frames, and the time between two frames [us]; no frames: the list ends."""


def hand_over(cob_id: int, frames: Sequence[bytes], period_us: int) -> Iterator[tuple[int, bytes]]:
    """29-bit identifier and data of the frames that hand a list over; an empty list ends the last one."""
    yield HANDED_OVER | cob_id, HEAD.pack(len(frames), period_us)
    for data in frames:
        yield HANDED_OVER | CONTENT | cob_id, data


class Receiver:
    """Puts lists together from the frames that hand them over."""

    def __init__(self) -> None:
        self._begun: dict[int, Listed] = {}
        self._missing: dict[int, int] = {}

    def heard(self, identifier: int, data: bytes) -> Listed | None:
        """The list that a frame completes; None: it completes none, or is none of these frames."""
        cob_id, kind = identifier & LARGEST, identifier & ~LARGEST
        if kind == HANDED_OVER and len(data) == HEAD.size:
            count, period_us = HEAD.unpack(data)
            if count > MOST_CYCLIC or (count and not period_us):  # no kernel takes such a list
                return None
            self._missing[cob_id] = count
            self._begun[cob_id] = cob_id, [], period_us
        elif kind == HANDED_OVER | CONTENT and self._missing.get(cob_id):
            self._begun[cob_id][1].append(data)
            self._missing[cob_id] -= 1
        else:
            return None
        return None if self._missing[cob_id] else self._begun[cob_id]


# --- how it is known, how it takes orders, how fast it may be asked --------------------------------------

MOST_READ, MOST_WRITTEN = 125, 123  # registers of one request ("MODBUS application protocol" 1.1b3, 6.3 and 6.12)
LARGEST_UNIT = 247
ITSELF = (0, 255)  # units of the device at a TCP address itself ("MODBUS Messaging on TCP/IP" 1.0b, 4.4.1.2)


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity that a device reports (Modbus function 43/14, CANopen object 0x1018)."""

    vendor: str
    product: str
    revision: str


@dataclass(frozen=True, slots=True)
class Mark:
    """What a field reads on each device of a kind, by which one without an identity object is known.

    Attributes:
        field: name of the field.
        value: its value; of a text, how it begins.
    """

    field: str
    value: Value


@dataclass(frozen=True, slots=True)
class Condition:
    """A state of a device: a field that reads one of some raw values.

    Attributes:
        field: name of the field.
        values: the raw values.
        mask: bits of it that count, as of a CiA 402 status word; None: all.
    """

    field: str
    values: tuple[int, ...]
    mask: int | None = None

    def holds(self, raw: float) -> bool:
        """Whether a raw value of the field fulfils it; one that is no whole number never does."""
        if not math.isfinite(raw) or raw != int(raw):
            return False
        return (int(raw) if self.mask is None else int(raw) & self.mask) in self.values


@dataclass(frozen=True, slots=True)
class Command:
    """An order that is given by writing a code, with the handshake that the device wants.

    Attributes:
        name: its name.
        field: name of the field that is written.
        value: what is written: a value in the field's unit, a choice, or a text.
        after: names of the commands that must be given before it, in order.
        done: state in which it is carried out; None: a confirmed write is all that can be known.
        failed: state in which the device has refused it.
        clear: value that is written when it is done, so that it can be given again; None: the device clears it.
        seconds: longest time that it may take [s].
    """

    name: str
    field: str
    value: Value
    after: tuple[str, ...] = ()
    done: Condition | None = None
    failed: Condition | None = None
    clear: Value | None = None
    seconds: float = 1.0

    def __post_init__(self) -> None:
        """Raises ConfigError: its time limit makes no sense."""
        if not (math.isfinite(self.seconds) and 0 < self.seconds <= 600):
            raise ConfigError(f"command {self.name}: seconds = {self.seconds:g}; give more than 0, up to 600")


@dataclass(frozen=True, slots=True)
class Manners:
    """Limits of a device on its bus.

    Attributes:
        most_read: greatest number of registers that it gives in one reply.
        most_written: greatest number of registers that it takes in one request.
        gap: shortest silence between a reply and the next request [s], beside that of the line itself.
        responds: longest time until it begins to reply [s], if that exceeds the link's time-out; None: it does not.
        busy: longest time for which it may answer that it is busy (exception 6), or still at work on what it has
            acknowledged (exception 5), before that counts as a failure [s]; 0: the first such answer does.
        units: least and greatest unit id at which it can answer.
        together: runs of fields that a request must write whole, or else they are half old and half new.
    """

    most_read: int = MOST_READ
    most_written: int = MOST_WRITTEN
    gap: float = 0.0
    responds: float | None = None
    busy: float = 1.0
    units: tuple[int, int] = (1, LARGEST_UNIT)
    together: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        """Check that the limits are possible. Raises ConfigError."""
        low, high = self.units
        for what, given, least, most in (
            ("most_read", self.most_read, 1, MOST_READ),
            ("most_written", self.most_written, 1, MOST_WRITTEN),
            ("gap", self.gap, 0, 10),
            ("responds", 1.0 if self.responds is None else self.responds, 1e-4, 60),
            ("busy", self.busy, 0, 60),
            ("units", low, 0, high),
            ("units", high, low, LARGEST_UNIT),
        ):
            if not least <= given <= most:
                raise ConfigError(f"manners: {what} = {given:g} is outside {least:g} to {most:g}")


USUAL = Manners()  # those of a device of which nothing is known


# --- the declaration -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Declaration:
    """All that is declared of one kind of device.

    Modbus contracts address 16-bit registers, coils and discrete inputs; CANopen contracts address objects, which are
    little-endian.

    Attributes:
        identity: vendor, product and revision: as the device reports them if `known_by` is `identity`, else for people.
        pdos: process data that a node sends; the first one has its COB-ID and its transmission type in 1800h.
        receives: process data that a node takes; the first one has its COB-ID in 1400h.
        about: for people: whose map it is, and what it imitates.
        known_by: how the right device is told from others: by its `identity` object, by `marks`, or by nothing, so that
            a person must confirm it.
        marks: what its fields read on each such device; all of them must fit.
        serial: field that holds its serial number; "": it is in its identity object, or nowhere.
        commands: orders that it takes.
        manners: limits on its bus.
    """

    name: str
    title: str
    bus: Literal["modbus", "canopen"]
    identity: Identity
    fields: tuple[Field, ...]
    pdos: tuple[Pdo, ...] = ()
    about: str = field(default="", compare=False)
    receives: tuple[Pdo, ...] = ()
    known_by: Literal["identity", "marks", "nothing"] = "identity"
    marks: tuple[Mark, ...] = ()
    serial: str = ""
    commands: tuple[Command, ...] = ()
    manners: Manners = USUAL
    _by_name: dict[str, Field] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Find fields by their names from now on."""
        object.__setattr__(self, "_by_name", {f.name: f for f in self.fields})

    def __getitem__(self, name: str) -> Field:
        try:
            return self._by_name[name]
        except KeyError:
            raise UnknownName(f"field of the {self.title}", name, self._by_name) from None

    def has(self, name: str) -> bool:
        """Whether there is a field of that name."""
        return name in self._by_name

    def block(self, names: Iterable[str]) -> tuple[int, int]:
        """First register and number of registers that hold the named fields (Modbus)."""
        fields = [self[n] for n in names]
        start = min(f.address for f in fields)
        end = max(f.address + f.width for f in fields)
        return start, end - start

    def command(self, name: str) -> Command:
        """An order that the device takes. Raises UnknownName."""
        found = {command.name: command for command in self.commands}
        if name not in found:
            raise UnknownName(f"command of the {self.title}", name, found)
        return found[name]

    def sent(self, name: str) -> Pdo:
        """Process data that a node sends. Raises UnknownName."""
        return self._pdo(name, self.pdos, "sends")

    def taken(self, name: str) -> Pdo:
        """Process data that a node takes. Raises UnknownName."""
        return self._pdo(name, self.receives, "takes")

    def _pdo(self, name: str, among: Sequence[Pdo], does: str) -> Pdo:
        found = {pdo.name: pdo for pdo in among}
        if name not in found:
            raise UnknownName(f"PDO that the {self.title} {does}", name, found)
        return found[name]


# --- checks that fields, commands and process data can be on the bus, and fit each other -----------------

HEXADECIMAL = re.compile("(0[xX])?[0-9A-Fa-f]{1,8}")
Encode = Callable[[str, Value], bytes]
LAST = {"modbus": 0xFFFF, "canopen": 0xFFFFFF}  # greatest address
WHOLE = ", ".join([*(name for name, size in SIZE.items() if size % 2 == 0), "text of an even length"])


def check_declaration(contract: Declaration, encode: Encode) -> None:
    """Check what its fields alone cannot know.

    Args:
        contract: the declaration.
        encode: makes the wire bytes of a field's value.

    Raises:
        ConfigError: something in it is impossible; the message names the device, the field and what is allowed.
    """
    fields = {f.name: f for f in contract.fields}
    names = [f.name for f in contract.fields]
    check_once(contract.title, "fields", names)
    for f in contract.fields:
        _check_place(contract, f)
        _check_beside(contract, f, fields)
    _check_units(contract)
    _check_overlaps(contract)
    _check_parts(contract)
    _check_pdos(contract, fields)
    _check_marks(contract, fields, encode)
    _check_commands(contract, fields, encode)
    _check_together(contract, fields)


def _check_units(contract: Declaration) -> None:
    """Raises ConfigError: one field should tell two units at once."""
    first_fields: dict[str, Field] = {}
    for f in contract.fields:
        first = first_fields.setdefault(f.unit_in, f) if f.unit_in else f
        if first.unit != f.unit:
            raise ConfigError(
                f"{contract.title}: {f.unit_in} should tell {first.unit!r} for {first.name} and {f.unit!r} for "
                f"{f.name}; it has one value, so give both fields one unit"
            )


def _check_parts(contract: Declaration) -> None:
    """Raises ConfigError: parts of one register are written differently, so that none of them can be."""
    parts: dict[tuple[str, int], Field] = {}
    for f in contract.fields:
        if f.part is None:
            continue
        first = parts.setdefault((f.table, f.address), f)
        if (first.octets, first.function, first.access) != (f.octets, f.function, f.access):
            raise ConfigError(
                f"{contract.title}: {first.name} and {f.name} are parts of one register, 0x{f.address:x}; give "
                "them the same octets, function and access"
            )


def _check_place(contract: Declaration, f: Field) -> None:
    """Raises ConfigError: the field cannot be on this bus, or its address is none."""
    where = f"{contract.title}: {f.name}"
    if contract.bus == "canopen":
        if (f.table, f.words, f.octets, f.part, f.function) != ("holding", "big", "big", None, 0):
            raise ConfigError(
                f"{where}: table, function, words, octets and part are for Modbus; leave them out on CANopen"
            )
    elif f.table not in BITS and (f.size % 2 or not f.size):
        raise ConfigError(f"{where} is of type {f.type}, which fills no whole 16-bit registers; valid: {WHOLE}")
    last = LAST[contract.bus]
    end = f.address + (f.width if contract.bus == "modbus" else 1) - 1
    if f.address < 0 or end > last:
        raise ConfigError(
            f"{where} ends at address {end}; the addresses go from 0 to {last}"
            + ("; register 400001 of a manual has the address 0" if contract.bus == "modbus" and end > last else "")
        )
    limits = contract.manners
    if contract.bus == "modbus" and f.table not in BITS:
        if f.access != "wo" and f.width > limits.most_read:
            raise ConfigError(f"{where} takes {f.width} registers, but a reply holds {limits.most_read}")
        if f.access != "ro" and f.width > limits.most_written:
            raise ConfigError(f"{where} takes {f.width} registers, but a request holds {limits.most_written}")


def _check_beside(contract: Declaration, f: Field, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: the fields that tell its scale, sign or unit cannot tell it."""
    where = f"{contract.title}: {f.name}"
    if f.scaling is not None:
        other = _number(contract, f"{where}: its scale", f.scaling.told_by, fields)
        if other.access != "ro":
            raise ConfigError(
                f"{where}: its scale is in {other.name}, which has access {other.access!r}; it must be 'ro', so that "
                "nothing changes the scale of a reading"
            )
        if other.beside:
            raise ConfigError(f"{where}: its scale is in {other.name}, whose own scale is not fixed; give a fixed one")
        if (f.scaling.by == "table") != bool(f.scaling.table):
            raise ConfigError(f"{where}: by = {f.scaling.by!r}; give a table if it is 'table', and only then")
        if any(not LEAST_SCALE <= factor <= GREATEST_SCALE for factor in f.scaling.table.values()):
            raise ConfigError(
                f"{where}: its table of scales has a factor that is not above 0, or not {LEAST_SCALE:g} to "
                f"{GREATEST_SCALE:g}"
            )
    if f.sign is not None:
        name, bit = f.sign
        other = _number(contract, f"{where}: its sign", name, fields)
        if contract.bus != "modbus" or f.access != "ro":
            raise ConfigError(f"{where}: its sign is in {name}; that is for fields of Modbus that are only read")
        if bit not in other.bits:
            raise ConfigError(f"{where}: its sign is in {name}.{bit}; valid bits: {', '.join(other.bits) or 'none'}")
        start, count = contract.block([f.name, name])
        addresses = {at for each in contract.fields for at in range(each.address, each.address + each.width)}
        holes = not addresses.issuperset(range(start, start + count))
        if other.table != f.table or count > contract.manners.most_read or holes:
            raise ConfigError(
                f"{where}: its sign is in {name}, which one request cannot read with it, so that the sign could be of "
                f"another moment; a reply holds {contract.manners.most_read} registers of one table, all of them fields"
            )
    if f.unit_in:
        other = _number(contract, f"{where}: its unit", f.unit_in, fields)
        if f.unit not in other.choices:
            raise ConfigError(
                f"{where}: {f.unit_in} cannot tell its unit {f.unit!r}, only {', '.join(other.choices) or 'none'}"
            )


def _number(contract: Declaration, where: str, name: str, fields: Mapping[str, Field]) -> Field:
    """A number field that can be read. Raises ConfigError: there is none of that name."""
    f = fields.get(name)
    if f is None or f.type == "text" or f.access == "wo":
        able = [each.name for each in contract.fields if each.type != "text" and each.access != "wo"]
        raise ConfigError(
            f"{where} is in {name!r}, which is no number field that can be read; valid: {', '.join(able)}"
        )
    return f


def _check_overlaps(contract: Declaration) -> None:
    """Raises ConfigError: two fields are at one place, and are not different parts of one register."""
    modbus = contract.bus == "modbus"
    tables = {f.table for f in contract.fields}
    for table in sorted(tables):
        some = sorted((f for f in contract.fields if f.table == table), key=lambda f: (f.address, f.part or (0, 0)))
        for first, second in itertools.pairwise(some):
            if first.address + (first.width if modbus else 1) <= second.address:
                continue
            if first.part and second.part and sum(first.part) <= second.part[0] and first.address == second.address:
                continue
            raise ConfigError(f"{contract.title}: {first.name} and {second.name} overlap at 0x{second.address:x}")


def _check_marks(contract: Declaration, fields: Mapping[str, Field], encode: Encode) -> None:
    """Raises ConfigError: it cannot be known by what it says, or its serial number is in no field that can be read."""
    identity = contract.identity
    parts = [part for part in (identity.vendor, identity.product, identity.revision) if part]
    if contract.bus == "canopen" and contract.known_by == "identity" and not all(map(HEXADECIMAL.fullmatch, parts)):
        raise ConfigError(
            f"{contract.title}: is known by vendor, product and revision {parts}; a node tells numbers: give them in "
            'hexadecimal, as "0x2BE", or "" for one that it does not tell'
        )
    if (contract.known_by == "marks") != bool(contract.marks):
        has = "has marks, but is known by " + contract.known_by if contract.marks else "is known by marks, but has none"
        raise ConfigError(f"{contract.title}: {has}; give marks where known_by is 'marks', and only there")
    for mark in contract.marks:
        f = fields.get(mark.field)
        if f is None or f.access == "wo" or (f.type == "text") != isinstance(mark.value, str):
            raise ConfigError(
                f"{contract.title}: is known by {mark.field} = {mark.value!r}, which is no value of a field that can "
                "be read; name another field, or give a number for a number and a text for a text"
            )
        if f.beside:
            raise ConfigError(
                f"{contract.title}: is known by {f.name}, whose scale or sign is told by {', '.join(f.beside)}; name a "
                "field of a fixed scale"
            )
        if isinstance(mark.value, str) and not mark.value:
            raise ConfigError(
                f"{contract.title}: is known by {f.name}, which may begin with any text; give its beginning"
            )
        _check_value(f"{contract.title}: is known by {f.name}", f, mark.value, encode)
    check_once(contract.title, "marks", [mark.field for mark in contract.marks])
    if contract.serial and (contract.serial not in fields or fields[contract.serial].access == "wo"):
        raise ConfigError(f"{contract.title}: its serial number is in {contract.serial!r}, which cannot be read")


def _check_commands(contract: Declaration, fields: Mapping[str, Field], encode: Encode) -> None:
    """Raises ConfigError: a command cannot be given, or what it waits for cannot be read."""
    check_once(contract.title, "commands", [command.name for command in contract.commands])
    before: list[str] = []
    for command in contract.commands:
        where = f"{contract.title}: command {command.name}"
        f = fields.get(command.field)
        if f is None or f.access == "ro":
            able = [each.name for each in contract.fields if each.access != "ro"]
            raise ConfigError(f"{where}: {command.field!r} cannot be written; valid: {', '.join(able) or 'none'}")
        check_name(f"{contract.title}: command", command.name)
        if f.beside:
            raise ConfigError(
                f"{where}: {f.name} has a scale that {', '.join(f.beside)} tells; give a field of a fixed one"
            )
        if others := _written_with(contract, f):
            raise ConfigError(
                f"{where}: {f.name} cannot be written without {', '.join(others)}, for which the command has no value; "
                "declare them as one field"
            )
        if command.clear == command.value:
            raise ConfigError(f"{where}: clear = {command.clear!r} is its value, so that nothing is cleared")
        for value in (command.value, *(() if command.clear is None else (command.clear,))):
            _check_value(where, f, value, encode)
        for condition in (command.done, command.failed):
            _check_condition(contract, where, condition, fields)
        if command.done and command.failed and _both(command.done, command.failed):
            raise ConfigError(
                f"{where}: is done and has failed in one state of {command.done.field}; give different values"
            )
        if unknown := [name for name in command.after if name not in before]:
            raise ConfigError(
                f"{where}: is after {unknown[0]!r}, no command before it; valid: {', '.join(before) or 'none'}"
            )
        before.append(command.name)


def _written_with(contract: Declaration, f: Field) -> list[str]:
    """The fields that the device takes only in one request with a field."""
    runs = {name for run in contract.manners.together if f.name in run for name in run}
    shared = {each.name for each in contract.fields if f.part and each.part and each.address == f.address}
    return sorted((runs | shared) - {f.name})


def _both(one: Condition, other: Condition) -> bool:
    """Whether a field can be in both states at once, if both look at the same bits of it."""
    return (one.field, one.mask) == (other.field, other.mask) and not set(one.values).isdisjoint(other.values)


def _check_value(where: str, f: Field, value: Value, encode: Encode) -> None:
    try:
        encode(f.name, value)
    except RangeError as error:
        raise ConfigError(f"{where}: {error}") from None


def _check_condition(
    contract: Declaration, where: str, condition: Condition | None, fields: Mapping[str, Field]
) -> None:
    if condition is None:
        return
    f = _number(contract, f"{where}: what it waits for", condition.field, fields)
    bits = f.part[1] if f.part else 8 * f.size
    if condition.mask is not None and not 0 < condition.mask < 1 << bits:
        raise ConfigError(f"{where}: mask = {condition.mask:#x} of {f.name}; give 0x1 to {(1 << bits) - 1:#X}")
    mask = (1 << bits) - 1 if condition.mask is None else condition.mask
    whole = f.type.startswith("int") and condition.mask is None
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if whole else (0, mask)
    if whole and (given := [value for value in condition.values if high < value <= mask]):
        raise ConfigError(
            f"{where}: waits for {given[0]:#x} in {f.name}; a {f.type} with these bits reads {given[0] - mask - 1}, "
            "give that"
        )
    if not condition.values or any(value < low or (value >= 0 and value & ~mask) for value in condition.values):
        raise ConfigError(
            f"{where}: waits for {list(condition.values)} in {f.name}, which cannot read so (mask 0x{mask:X})"
        )


def _check_together(contract: Declaration, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: fields that must be written together cannot be, or a part stands alone."""
    for run in contract.manners.together:
        if len(run) < 2:
            raise ConfigError(f"{contract.title}: together: {list(run)} is no run; name two fields or more")
        if unknown := [name for name in run if name not in fields or fields[name].access == "ro"]:
            raise ConfigError(f"{contract.title}: together: {unknown[0]!r} is no field that can be written")
        _, count = contract.block(run)
        if count != sum(fields[name].width for name in run) or count > contract.manners.most_written:
            raise ConfigError(
                f"{contract.title}: together: {', '.join(run)} must be adjacent, and take up to "
                f"{contract.manners.most_written} registers"
            )
        if single := [name for name in run if fields[name].writes == ONE_REGISTER]:
            raise ConfigError(
                f"{contract.title}: together: {single[0]} is written with function 6, which writes it alone"
            )


# --- checks of process data ------------------------------------------------------------------------------

LARGEST_PDO = 8  # bytes


def _check_pdos(contract: Declaration, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: a PDO cannot be sent on a CAN bus, or cannot hold one of its fields."""
    if contract.bus != "canopen" and (contract.pdos or contract.receives):
        raise ConfigError(f"{contract.title}: has PDOs, which are for CANopen only; leave them out")
    for pdo, wrong in (*((each, "wo") for each in contract.pdos), *((each, "ro") for each in contract.receives)):
        for name in pdo.fields:
            if name not in fields or fields[name].type == "text" or fields[name].access == wrong:
                raise ConfigError(
                    f"{contract.title}: PDO {pdo.name} cannot hold {name}: it must be a number field of the contract "
                    f"that can be {'read' if wrong == 'wo' else 'written'}"
                )
        if len(set(pdo.fields)) < len(pdo.fields):
            raise ConfigError(f"{contract.title}: PDO {pdo.name} holds a field twice: {', '.join(pdo.fields)}")
        if not 0 < (size := sum(fields[name].size for name in pdo.fields)) <= LARGEST_PDO:
            raise ConfigError(f"{contract.title}: PDO {pdo.name} has {size} bytes; give 1 to {LARGEST_PDO}")
    for first, pdos in ((SENT, contract.pdos), (TAKEN, contract.receives)):
        placed = [pdo for pdo in pdos if pdo.index or pdo.fixed]
        for pdo in placed:
            _check_pdo_place(contract, pdo, first)
        check_once(contract.title, "PDOs", [f"0x{pdo.index or pdo.fixed:X}" for pdo in placed])
    for pdo in (*contract.pdos, *contract.receives):
        check_name(f"{contract.title}: PDO", pdo.name)
    check_once(contract.title, "PDOs", [pdo.name for pdo in (*contract.pdos, *contract.receives)])


def _check_pdo_place(contract: Declaration, pdo: Pdo, first: int) -> None:
    """Raises ConfigError: no node can have this PDO at its place, or no driver can set it up."""
    if pdo.index and pdo.fixed:
        raise ConfigError(f"{contract.title}: PDO {pdo.name}: gives index and fixed; a driver sets it up, or it cannot")
    for what, given, least, most in (
        ("fixed" if pdo.fixed else "index", pdo.fixed or pdo.index, first, first + PDOS - 1),
        ("transmission", pdo.transmission, 0, 255),
        ("inhibit", pdo.inhibit, 0, LONGEST_INHIBIT),
        ("node", pdo.node, 0, NODES[-1]),
    ):
        if not least <= given <= most:
            limits = f"0x{least:X} to 0x{most:X}" if what in ("index", "fixed") else f"{least} to {most:g}"
            raise ConfigError(f"{contract.title}: PDO {pdo.name}: {what} = {given:g} is outside {limits}")


# --- the digest, by which a run knows whether a device is still what it was ------------------------------

# Keys of the first digests. All others were added later, and are left out where they have their default, so that the
# digest of a contract that does not use them is still that of the first runs.
FIRST_OF_FIELD = (
    "name", "address", "type", "meaning", "unit", "scale", "access", "minimum", "maximum", "default", "choices", "bits",
    "length",
)  # fmt: skip
FIRST_OF_CONTRACT = ("name", "bus", "identity", "fields", "pdos")
FIRST_OF_PDO = ("name", "base", "fields")
FIRST_OF_MANNERS = ("most_read", "most_written", "gap", "responds", "units", "together")
FOR_PEOPLE = ("title",)


def digest(contract: Declaration) -> str:
    """SHA-256 of a whole declaration, without what is for people only."""
    declared = _as_dict(contract, FIRST_OF_CONTRACT)
    declared["fields"] = [_as_dict(f, FIRST_OF_FIELD) for f in contract.fields]
    return hashlib.sha256(json.dumps(declared, sort_keys=True, default=_plain).encode()).hexdigest()


def _as_dict(thing: Field | Declaration | Pdo | Manners, first: tuple[str, ...]) -> dict[str, Any]:
    """The first keys of a field, contract or PDO, and those of the others that are not at their default."""
    found: dict[str, Any] = {}
    for each in fields(thing):
        default = each.default if each.default is not MISSING else None
        value = getattr(thing, each.name, default)
        if each.compare and each.name not in FOR_PEOPLE and (each.name in first or value != default):
            found[each.name] = value
    return found


def _plain(value: Any) -> Any:
    """A mapping or dataclass as a dict, for JSON."""
    if isinstance(value, Pdo):
        return _as_dict(value, FIRST_OF_PDO)
    if isinstance(value, Manners):
        return _as_dict(value, FIRST_OF_MANNERS)
    return dict(value) if isinstance(value, Mapping) else asdict(value)
