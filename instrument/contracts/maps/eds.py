"""What a map takes from a maker's electronic data sheet (EDS) or configuration (DCF): its fields, and its identity.

Such a file belongs to its maker. A map made from it keeps addresses, types and limits, which are facts, the file's name
and its SHA-256; names and meanings of objects are our own.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Field, sdo
from palpate.instrument.contracts.maps.data_sheet import DataSheet, Entry, called, objects_of, whole, word
from palpate.instrument.contracts.maps.objects import STANDARD
from palpate.instrument.contracts.maps.sheet_pdos import pdos
from palpate.instrument.contracts.maps.sheet_values import access_of, split, type_of, value_of
from palpate.instrument.contracts.maps.tables import OBJECT
from palpate.instrument.contracts.pdo import SENT, TAKEN, is_relative
from palpate.instrument.contracts.wire_types import Type
from palpate.instrument.errors import ConfigError

FOLDERS = "PALPATE_EDS"  # environment variable: folders of makers' own files
IDENTITY = 0x1018
NUMBERS = ("VendorNumber", "ProductNumber", "RevisionNumber")  # keys of [DeviceInfo]
MOST = 0xFFFF_FFFF  # of a part of the identity


def field_of(sheet: DataSheet, address: int, name: str = "") -> tuple[Field, list[str]]:
    """The field of an object, and what the sheet says of it that the field does not have, and why.

    Args:
        sheet: the data sheet.
        address: the object's address.
        name: name of the field; "": that of CiA's profiles, or one made of the address.

    Raises ConfigError: the sheet has no such object, or it is of a type or an access that cannot be used.
    """
    found = sheet.entry(address)
    try:
        type_, access = type_of(found), access_of(found)
    except ValueError as error:
        raise ConfigError(f"{sheet.name}: {called(address)}: {error}") from None
    own, meaning = STANDARD.get(address, (f"object_{called(address).replace(':', '_').lower()}", ""))
    left_out: list[str] = []
    low = high = default = None
    if type_ != "text":
        low, high = _limits(found, type_, left_out)
        default = _default(sheet, found, address, type_, left_out)
        if default is not None and ((low is not None and default < low) or (high is not None and default > high)):
            left_out.append(f"its default {found.default} is outside its limits")
            default = None
    field = Field(
        name or own,
        address,
        type_,
        meaning or f"object {called(address)} of the device",
        access=access,
        minimum=low,
        maximum=high,
        source=f"[1] {sheet.name}",
        default=0.0 if default is None else default,
    )
    return field, [f"{called(address)}: {each}" for each in left_out]


def _limits(found: Entry, type_: Type, left_out: list[str]) -> tuple[float | None, float | None]:
    """Least and greatest value that the sheet gives; None where it gives none, or one that says nothing."""
    limits: list[float | None] = []
    for what, text in (("least", found.low), ("greatest", found.high)):
        try:
            limits.append(value_of(text, type_) if text else None)
        except ValueError as error:
            left_out.append(f"its {what} value: {error}")
            limits.append(None)
    low, high = limits
    if low is None or high is None or low < high:
        return low, high
    if low > high:
        left_out.append(f"its limits {found.low} to {found.high} contradict each other")
    elif low != 0:  # makers write 0 to 0 for: no limits
        left_out.append(f"its limits {found.low} to {found.high} leave one value")
    return None, None


def _default(sheet: DataSheet, found: Entry, address: int, type_: Type, left_out: list[str]) -> float | None:
    """The value after power-on, of a COB-ID without the node id; None: it is not known."""
    of_cob_id = is_relative(address >> 8, address & 0xFF)
    text = found.default or ("" if of_cob_id else found.configured)
    if not text:
        return None
    try:
        relative, rest = split(text)
        value = value_of(rest, type_)
        if relative and not of_cob_id:
            raise ValueError(f"{text} counts from the node id")
        if of_cob_id and not relative:
            if not sheet.node or value < sheet.node:
                raise ValueError(f"{text} is that of one node id")
            value -= sheet.node
    except ValueError as error:
        left_out.append(f"its default: {error}")
        return None
    return value


def identity(sheet: DataSheet) -> tuple[str, str, str]:
    """Vendor, product and revision as 1018h tells them, hexadecimal; "" where the sheet does not say.

    A DCF may have them as the value of the configured device alone.
    """
    vendor, product, revision = (f"{n:08X}" if (n := _part(sheet, sub, [])) else "" for sub in (1, 2, 3))
    return vendor, product, revision


def doubts(sheet: DataSheet) -> list[str]:
    """What of the identity cannot be used, and where 1018h and `[DeviceInfo]` contradict each other."""
    found: list[str] = []
    for subindex, key in enumerate(NUMBERS, 1):
        number = _part(sheet, subindex, found)
        also = _whole(word(sheet.device.get(key.lower(), "")), f"[DeviceInfo] {key}", found)
        if number and also and number != also:
            found.append(f"{called(sdo(IDENTITY, subindex))} is 0x{number:X}, [DeviceInfo] {key} 0x{also:X}")
    return found


def _part(sheet: DataSheet, subindex: int, doubts: list[str]) -> int:
    entry = sheet.objects.get(IDENTITY, {}).get(subindex)
    text = "" if entry is None else entry.default or entry.configured
    return _whole(text, called(sdo(IDENTITY, subindex)), doubts)


def _whole(text: str, what: str, doubts: list[str]) -> int:
    """A part of the identity; 0: none that can be used."""
    try:
        number = whole(text) if text else 0
        if not 0 <= number <= MOST:
            raise ValueError(f"{text[:40]} has more than 32 bits")
    except ValueError as error:
        doubts.append(f"{what}: {error}; it is not used")
        return 0
    return number


def chosen(sheet: DataSheet, texts: Sequence[str]) -> dict[int, str]:
    """The objects that are named as "6401:1" or "6401:1=NAME", or "6401" for all of an index; with their names.

    Raises ConfigError: a text has another form, or the sheet has no such object.
    """
    found: dict[int, str] = {}
    for text in texts:
        place, _, name = text.partition("=")
        whole_index = re.fullmatch(r"[0-9A-Fa-f]{4}", place)
        if whole_index and not name:
            found |= dict.fromkeys(objects_of(sheet, int(place, 16)), "")
            continue
        match = OBJECT.fullmatch(place if ":" in place else f"{place}:0")
        if match is None or (name and not re.fullmatch("[a-z][a-z0-9_]*", name)):
            raise ConfigError(f'object {text!r}: give index and subindex in hexadecimal, as "6401:1" or "6401:1=load"')
        found[sdo(int(match[1], 16), int(match[2], 16))] = name
    return found


def folders() -> list[Path]:
    """The folders of makers' own files, which the environment variable PALPATE_EDS names."""
    return [Path(folder) for folder in os.environ.get(FOLDERS, "").split(os.pathsep) if folder]


def own_copy(name: str) -> Path | None:
    """A maker's file in the first of these folders that has it; None: none has. `name` must be no path."""
    if Path(name).name != name:
        return None
    return next((folder / name for folder in folders() if (folder / name).is_file()), None)


def disagreements(sheet: DataSheet, fields: Sequence[Field]) -> Iterator[str]:
    """Where fields of a map say something else than the data sheet from which it was made."""
    for f in fields:
        try:
            said, _ = field_of(sheet, f.address)
        except ConfigError as error:
            yield f"{f.name}: {error}"
            continue
        for what, here, there in (("type", f.type, said.type), ("access", f.access, said.access)):
            if here != there:
                yield f"{f.name}: {what} is {here!r}, in {sheet.name} it is {there!r}"


def fixed_otherwise(sheet: DataSheet, contract: Contract) -> Iterator[str]:
    """Where a map says something else of a PDO than the data sheet, which lets nobody set it up."""
    for ours, first in ((contract.pdos, SENT), (contract.receives, TAKEN)):
        known = {each.index: each for each in pdos(sheet, first)[0] if each.fixed}
        for pdo in ours:
            there = known.get(pdo.index or pdo.fixed)
            if there is None:
                continue
            if pdo.index:
                yield f"PDO {pdo.name}: index: nobody can set it up, because in {sheet.name} {there.fixed}"
            if (pdo.base, pdo.node) != (there.base, there.node):
                yield f"PDO {pdo.name}: base is {pdo.base:#x}, in {sheet.name} it is {there.base:#x}"
            if (objects := tuple(contract[name].address for name in pdo.fields)) != there.objects:
                wanted = ", ".join(map(called, there.objects))
                yield f"PDO {pdo.name}: holds {', '.join(map(called, objects))}, in {sheet.name} it holds {wanted}"
