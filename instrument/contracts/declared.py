"""Checks that the fields, commands and process data of a contract can be on its bus, and fit each other."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping

from palpate.instrument.contracts.contradictions import GREATEST_SCALE, LEAST_SCALE, check_name, check_once
from palpate.instrument.contracts.declaration import Declaration
from palpate.instrument.contracts.declared_pdos import check_pdos
from palpate.instrument.contracts.field import BITS, ONE_REGISTER, Field, Value
from palpate.instrument.contracts.manners import Condition
from palpate.instrument.contracts.wire_types import SIZE
from palpate.instrument.errors import ConfigError, RangeError

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
    check_pdos(contract, fields)
    _check_marks(contract, fields, encode)
    _check_commands(contract, fields, encode)
    _check_together(contract, fields)


def _check_units(contract: Declaration) -> None:
    """Raises ConfigError: one field should tell two units at once."""
    told: dict[str, Field] = {}
    for f in contract.fields:
        first = told.setdefault(f.unit_in, f) if f.unit_in else f
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
        known = {at for each in contract.fields for at in range(each.address, each.address + each.width)}
        holes = not known.issuperset(range(start, start + count))
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
    known: list[str] = []
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
        if unknown := [name for name in command.after if name not in known]:
            raise ConfigError(
                f"{where}: is after {unknown[0]!r}, no command before it; valid: {', '.join(known) or 'none'}"
            )
        known.append(command.name)


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
