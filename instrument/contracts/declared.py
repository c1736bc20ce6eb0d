"""Checks that the fields, commands and process data of a contract can be on its bus, and fit each other."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from palpate.instrument.contracts.declaration import Declaration
from palpate.instrument.contracts.field import BITS, Field, Value
from palpate.instrument.contracts.manners import Condition
from palpate.instrument.contracts.pdo import LONGEST_INHIBIT, PDOS, SENT, TAKEN, Pdo
from palpate.instrument.contracts.wire_types import SIZE
from palpate.instrument.errors import ConfigError, RangeError

Encode = Callable[[str, Value], bytes]
LARGEST_PDO = 8  # bytes
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
    _check_once(contract, "fields", names)
    for f in contract.fields:
        _check_place(contract, f)
        _check_beside(contract, f, fields)
    _check_overlaps(contract)
    _check_pdos(contract, fields)
    _check_marks(contract, fields)
    _check_commands(contract, fields, encode)
    _check_together(contract, fields)


def _check_once(contract: Declaration, what: str, names: Sequence[str]) -> None:
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ConfigError(f"{contract.title}: several {what} have the name {', '.join(twice)}; each needs its own")


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
        raise ConfigError(f"{where} ends at address {end}; the addresses go from 0 to {last}")
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
        if any(not factor > 0 for factor in f.scaling.table.values()):
            raise ConfigError(f"{where}: its table of scales has a factor that is not above 0")
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
        if not 0 < (size := sum(fields[name].size for name in pdo.fields)) <= LARGEST_PDO:
            raise ConfigError(f"{contract.title}: PDO {pdo.name} has {size} bytes; give 1 to {LARGEST_PDO}")
    for first, pdos in ((SENT, contract.pdos), (TAKEN, contract.receives)):
        set_up = [pdo for pdo in pdos if pdo.index]
        for pdo in set_up:
            _check_set_up(contract, pdo, first)
        _check_once(contract, "PDOs", [f"0x{pdo.index:X}" for pdo in set_up])
    _check_once(contract, "PDOs", [pdo.name for pdo in (*contract.pdos, *contract.receives)])


def _is_hexadecimal(text: str) -> bool:
    try:
        int(text, 16)
    except ValueError:
        return False
    return True


def _check_set_up(contract: Declaration, pdo: Pdo, first: int) -> None:
    """Raises ConfigError: no driver can set this PDO up."""
    for what, given, least, most in (
        ("index", pdo.index, first, first + PDOS - 1),
        ("transmission", pdo.transmission, 0, 255),
        ("inhibit", pdo.inhibit, 0, LONGEST_INHIBIT),
    ):
        if not least <= given <= most:
            limits = f"0x{least:X} to 0x{most:X}" if what == "index" else f"{least} to {most:g}"
            raise ConfigError(f"{contract.title}: PDO {pdo.name}: {what} = {given:g} is outside {limits}")


def _check_marks(contract: Declaration, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: it cannot be known by what it says, or its serial number is in no field that can be read."""
    identity = contract.identity
    parts = [part for part in (identity.vendor, identity.product, identity.revision) if part]
    if contract.bus == "canopen" and contract.known_by == "identity" and not all(map(_is_hexadecimal, parts)):
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
    if contract.serial and (contract.serial not in fields or fields[contract.serial].access == "wo"):
        raise ConfigError(f"{contract.title}: its serial number is in {contract.serial!r}, which cannot be read")


def _check_commands(contract: Declaration, fields: Mapping[str, Field], encode: Encode) -> None:
    """Raises ConfigError: a command cannot be given, or what it waits for cannot be read."""
    _check_once(contract, "commands", [command.name for command in contract.commands])
    known: list[str] = []
    for command in contract.commands:
        where = f"{contract.title}: command {command.name}"
        f = fields.get(command.field)
        if f is None or f.access == "ro":
            able = [each.name for each in contract.fields if each.access != "ro"]
            raise ConfigError(f"{where}: {command.field!r} cannot be written; valid: {', '.join(able) or 'none'}")
        for value in (command.value, *(() if command.clear is None else (command.clear,))):
            _check_value(where, f, value, encode)
        for condition in (command.done, command.failed):
            _check_condition(contract, where, condition, fields)
        if unknown := [name for name in command.after if name not in known]:
            raise ConfigError(
                f"{where}: is after {unknown[0]!r}, no command before it; valid: {', '.join(known) or 'none'}"
            )
        known.append(command.name)


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
    mask = (1 << 8 * f.size) - 1 if condition.mask is None else condition.mask
    if not condition.values or any(value & ~mask for value in condition.values):
        raise ConfigError(
            f"{where}: waits for {list(condition.values)} in {f.name}, which cannot read so (mask 0x{mask:X})"
        )


def _check_together(contract: Declaration, fields: Mapping[str, Field]) -> None:
    """Raises ConfigError: fields that must be written together cannot be, or a part stands alone."""
    for run in contract.manners.together:
        if unknown := [name for name in run if name not in fields or fields[name].access == "ro"]:
            raise ConfigError(f"{contract.title}: together: {unknown[0]!r} is no field that can be written")
        _, count = contract.block(run)
        if count != sum(fields[name].width for name in run) or count > contract.manners.most_written:
            raise ConfigError(
                f"{contract.title}: together: {', '.join(run)} must be adjacent, and take up to "
                f"{contract.manners.most_written} registers"
            )
