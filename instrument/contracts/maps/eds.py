"""Map files made from a maker's electronic data sheet (EDS) or configuration (DCF) by CiA 306.

Such a file belongs to its maker. A map made from it keeps addresses, types and limits, which are facts, the file's name
and its SHA-256; names and meanings of objects are our own.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from canopen.objectdictionary import ODVariable, datatypes
from canopen.objectdictionary.eds import import_eds

from palpate.instrument.contracts.field import Access, Field, sdo
from palpate.instrument.contracts.maps.objects import STANDARD
from palpate.instrument.contracts.maps.tables import OBJECT
from palpate.instrument.contracts.pdo import COB_ID, LARGEST, PDOS, TRANSMISSION_TYPE, is_relative
from palpate.instrument.contracts.wire_types import Type, codec
from palpate.instrument.errors import ConfigError, check_path

logging.getLogger("canopen").addHandler(logging.NullHandler())  # its warnings print names of a file as they are
FOLDERS = "PALPATE_EDS"  # environment variable: folders of makers' own files
LARGEST_SHEET = 10_000_000  # bytes; files of thousands of objects have one or two million
TYPES: dict[int, Type] = {
    datatypes.BOOLEAN: "bool", datatypes.INTEGER8: "int8", datatypes.INTEGER16: "int16",
    datatypes.INTEGER24: "int24", datatypes.INTEGER32: "int32", datatypes.INTEGER64: "int64",
    datatypes.UNSIGNED8: "uint8", datatypes.UNSIGNED16: "uint16", datatypes.UNSIGNED24: "uint24",
    datatypes.UNSIGNED32: "uint32", datatypes.UNSIGNED64: "uint64", datatypes.REAL32: "float32",
    datatypes.REAL64: "float64", datatypes.VISIBLE_STRING: "text",
}  # fmt: skip
ACCESS: dict[str, Access] = {"const": "ro", "ro": "ro", "wo": "wo", "rw": "rw", "rwr": "rw", "rww": "rw"}
EMPTY_NUMBER = re.compile(r"(?m)^(?:VendorNumber|ProductNumber|RevisionNumber|Granularity|NrOf\wXPDO)\s*=\s*$")
COMMENTS = re.compile(r"(?ms)^\[Comments\].*?(?=^\[|\Z)")  # their number of lines is often wrong
IDENTITY = 0x1018
INVALID = 1 << 31  # bit of a COB-ID: the PDO is not used


@dataclass(frozen=True)
class DataSheet:
    """A maker's EDS or DCF.

    Attributes:
        name: name of the file.
        sha256: its SHA-256, hexadecimal.
        objects: its object dictionary, a `canopen.ObjectDictionary`; COB-IDs without the node id.
        node: the node id for which a DCF was made; 0: none.
    """

    name: str
    sha256: str
    objects: Any
    node: int


def read_sheet(path: Path) -> DataSheet:
    """Read an EDS or DCF. Raises ConfigError: it is missing, too large, or no such file."""
    check_path(path)
    try:
        if not path.is_file():
            raise ConfigError(f"{path}: is no file; give the path of an EDS or DCF")
        if path.stat().st_size > LARGEST_SHEET:
            raise ConfigError(f"{path}: larger than {LARGEST_SHEET} bytes; this is no EDS or DCF")
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; give a readable file") from None
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # CiA 306 asks for ASCII; makers use what their editors do
    if "[DeviceInfo]" not in text:
        raise ConfigError(f"{path}: has no section [DeviceInfo]; give an EDS or DCF")
    text = COMMENTS.sub("", EMPTY_NUMBER.sub("", text))
    try:
        objects: Any = import_eds(io.StringIO(text), 0)  # type: ignore[no-untyped-call]
        node = re.search(r"(?mi)^NodeID\s*=\s*(\w+)", text)
        node_id = int(node[1], 0) if node else 0
    except Exception as error:  # the library raises whatever a wrong line leads to
        raise ConfigError(
            f"{path}: is no EDS or DCF that can be read: {type(error).__name__}: {' '.join(str(error).split())}"
        ) from None
    if not list(objects):
        raise ConfigError(f"{path}: has no objects; give an EDS or DCF")
    return DataSheet(path.name, hashlib.sha256(content).hexdigest(), objects, node_id)


def variable(sheet: DataSheet, address: int) -> Any:
    """The object at an address, an `ODVariable`. Raises ConfigError: the sheet has none."""
    index, subindex = address >> 8, address & 0xFF
    entry = sheet.objects.get(index)
    if isinstance(entry, ODVariable):
        entry = {0: entry}
    if entry is None or subindex not in entry:
        has = "no such object" if entry is None else "subindices " + ", ".join(f"{sub:X}" for sub in entry)
        raise ConfigError(f"{sheet.name}: {called(address)}: it has {has}")
    return entry[subindex]


def called(address: int) -> str:
    """An object's index and subindex in hexadecimal."""
    return f"{address >> 8:04X}:{address & 0xFF:X}"


def field_of(sheet: DataSheet, address: int, name: str = "") -> Field:
    """The field of an object.

    Args:
        sheet: the data sheet.
        address: the object's address.
        name: name of the field; "": that of CiA's profiles, or one made of the address.

    Raises ConfigError: the sheet has no such object, or it is of a type or an access that cannot be used.
    """
    found = variable(sheet, address)
    where = f"{sheet.name}: {called(address)}"
    type_ = TYPES.get(found.data_type)
    if type_ is None:
        kind = datatypes_name(found.data_type)
        raise ConfigError(f"{where}: its type {kind} cannot be used; valid: {', '.join(map(datatypes_name, TYPES))}")
    if found.access_type not in ACCESS:
        raise ConfigError(f"{where}: its access {found.access_type!r} is unknown; valid: {', '.join(ACCESS)}")
    own, meaning = STANDARD.get(address, (f"object_{called(address).replace(':', '_').lower()}", ""))
    keys: dict[str, Any] = {}
    if type_ != "text":
        low, high = _limits(found, type_)
        default = _start(found, address, low, high)
        keys = {"minimum": low, "maximum": high} | ({} if default is None else {"default": default})
    return Field(
        name or own,
        address,
        type_,
        meaning or f"object {called(address)} of the device",
        access=ACCESS[found.access_type],
        source=f"[1] {sheet.name}",
        **keys,
    )


def datatypes_name(number: int) -> str:
    """The name of a data type in CiA 301."""
    return next((name for name, value in vars(datatypes).items() if value == number and name.isupper()), f"{number:X}h")


def _fits(value: Any, type_: Type) -> bool:
    try:
        codec(type_, "<").pack(value)
    except (struct.error, TypeError, OverflowError):
        return False
    return True


def _limits(found: Any, type_: Type) -> tuple[float | None, float | None]:
    """Least and greatest value that the sheet gives; None where it gives none, or one that says nothing."""
    low, high = (None if value is None or not _fits(value, type_) else float(value) for value in (found.min, found.max))
    if low is not None and high is not None and low >= high:  # makers write 0 and 0 for: no limits
        return None, None
    return low, high


def _start(found: Any, address: int, low: float | None, high: float | None) -> float | None:
    """The value after power-on; None: the sheet does not tell, or only for a node id."""
    relative = "$NODEID" in str(getattr(found, "default_raw", "")).upper()
    if relative != is_relative(address >> 8, address & 0xFF) and relative:
        return None
    value = found.default if found.default is not None or is_relative(address >> 8, address & 0xFF) else found.value
    fits = _fits(value, TYPES[found.data_type]) and not (low is not None and value < low)
    return float(value) if fits and not (high is not None and value > high) else None


def identity(sheet: DataSheet) -> tuple[str, str, str]:
    """Vendor, product and revision as 1018h tells them, hexadecimal; "" where the sheet does not say.

    A DCF may have them as the value of the configured device alone.
    """
    parts = []
    for subindex in (1, 2, 3):
        try:
            found = variable(sheet, sdo(IDENTITY, subindex))
        except ConfigError:
            parts.append("")
            continue
        value = found.default if found.default is not None else found.value
        parts.append(f"{value:08X}" if value else "")
    return parts[0], parts[1], parts[2]


@dataclass(frozen=True)
class Mapped:
    """A PDO as the maker maps it: its communication object, the base of its COB-ID, and its objects' addresses."""

    index: int
    base: int
    objects: tuple[int, ...]
    transmission: int


def mapped(sheet: DataSheet, first: int) -> Iterator[Mapped]:
    """The PDOs that are in use; `first` is 1800h for those that the node sends, and 1400h for those that it takes."""
    for number in range(PDOS):
        if first + number not in sheet.objects or first + PDOS + number not in sheet.objects:
            continue
        try:
            place = variable(sheet, sdo(first + number, COB_ID))
            kind = _told(variable(sheet, sdo(first + number, TRANSMISSION_TYPE)))
            count = _told(variable(sheet, sdo(first + PDOS + number, 0))) or 0
            entries = [_told(variable(sheet, sdo(first + PDOS + number, n))) for n in range(1, count + 1)]
        except (ConfigError, TypeError):
            continue
        cob_id = place.default  # without the node id; a DCF's own value is for one node id
        used = _told(place)
        if cob_id is None and used is not None:
            cob_id = used - sheet.node
        if cob_id is None or (used or cob_id) & INVALID or not cob_id & LARGEST > 0 or not entries or None in entries:
            continue
        objects = tuple(int(entry or 0) >> 8 for entry in entries)
        yield Mapped(first + number, cob_id & LARGEST, objects, 255 if kind is None else kind)


def _told(found: Any) -> Any:
    """The value of an object: as a DCF has configured it, or as it is after power-on."""
    return found.value if found.value is not None else found.default


def chosen(sheet: DataSheet, texts: Sequence[str]) -> dict[int, str]:
    """The objects that are named as "6401:1" or "6401:1=NAME", or "6401" for all of an index; with their names.

    Raises ConfigError: a text has another form, or the sheet has no such object.
    """
    found: dict[int, str] = {}
    for text in texts:
        place, _, name = text.partition("=")
        whole = re.fullmatch(r"[0-9A-Fa-f]{4}", place)
        if whole and not name:
            entry = sheet.objects.get(int(place, 16))
            subs = [0] if entry is None or isinstance(entry, ODVariable) else [sub for sub in entry if sub]
            found |= {sdo(int(place, 16), sub): "" for sub in subs}
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
            said = field_of(sheet, f.address)
        except ConfigError as error:
            yield f"{f.name}: {error}"
            continue
        for what, here, there in (("type", f.type, said.type), ("access", f.access, said.access)):
            if here != there:
                yield f"{f.name}: {what} is {here!r}, in {sheet.name} it is {there!r}"
