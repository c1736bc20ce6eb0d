"""What a map takes from a maker's electronic data sheet (EDS) or configuration (DCF): its fields, and its identity.

Such a file belongs to its maker. A map made from it keeps addresses, types and limits, which are facts, the file's name
and its SHA-256; names and meanings of objects are our own.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w

from palpate.instrument.config import LARGEST_FILE, MOST_PROBLEMS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import (
    COB_ID,
    KEPT,
    LARGEST,
    PDOS,
    SENT,
    TAKEN,
    TRANSMISSION_TYPE,
    is_relative,
)
from palpate.instrument.contracts.field import SIZE, STRUCT, Access, Field, Type, codec, sdo
from palpate.instrument.contracts.maps.map_file import BITRATES, OBJECT, map_of
from palpate.instrument.errors import ConfigError, check_path

# --- the data sheet ------------------------------------------------------------------------------------

# Such a file is an INI file. Keys and sections may be in any case and any order, and values may be missing. Nothing is
# guessed: what cannot be read is told when somebody asks for it.


LARGEST_SHEET = 10_000_000  # bytes; files of thousands of objects have one or two million
SECTION = re.compile(r"\[([^\]]*)\]")
OBJECT_SECTION = re.compile(r"([0-9a-f]{1,4})(?:sub([0-9a-f]{1,2}))?")
DOMAIN, UNSIGNED8, LAST_TYPE = 0x0F, 0x05, 0x1F  # data types; beyond the last one they are the maker's own
DOMAIN_OBJECT = "2"  # object type
MOST_SUBINDICES = 254
DEVICE = "deviceinfo"
COMMISSIONING = ("devicecomissioning", "devicecommissioning")  # CiA 306 spells it in the first way
NODES = range(1, 128)
NOT_CONFIGURED = (0, 255)  # node ids
SLOWEST_IN_BITS = 10_000  # bit/s; a number of kbit/s is below
LONGEST_NAME = 200  # characters
SHOWN = 40  # characters of a value in a message

Section = Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Entry:
    """An object as its section has it; a text is "" where the section has no such key, or no value.

    Attributes:
        data_type: number of its type in CiA 301; None: the section gives none that can be read.
        access: its access, in lower case.
        low: its least value.
        high: its greatest value.
        default: its value after power-on.
        configured: its value in a configured device, in a DCF.
        compact: whether it is one of a list that the file gives in short (`CompactSubObj`).
    """

    data_type: int | None
    access: str
    low: str = ""
    high: str = ""
    default: str = ""
    configured: str = ""
    compact: bool = False

    @property
    def effective(self) -> str:
        """Its value: as a DCF has configured it, or as it is after power-on."""
        return self.configured or self.default


@dataclass(frozen=True)
class DataSheet:
    """A maker's EDS or DCF.

    Attributes:
        name: name of the file.
        sha256: its SHA-256, hexadecimal.
        objects: its objects by index and subindex.
        device: what its section `[DeviceInfo]` says, by keys in lower case.
        node: the node id for which a DCF was made; 0: none.
        bitrate: the bit rate for which a DCF was made [bit/s]; None: none.
        notes: what is odd about the file as a whole.
    """

    name: str
    sha256: str
    objects: Mapping[int, Mapping[int, Entry]]
    device: Section
    node: int
    bitrate: int | None
    notes: tuple[str, ...]

    def entry(self, address: int) -> Entry:
        """The object at an address. Raises ConfigError: the sheet has none."""
        subs = self.objects.get(address >> 8, {})
        if address & 0xFF not in subs:
            has = "subindices " + ", ".join(f"{sub:X}" for sub in sorted(subs)) if subs else "no such object"
            raise ConfigError(f"{self.name}: {called(address)}: it has {has}")
        return subs[address & 0xFF]

    def named(self, key: str) -> str:
        """A name in `[DeviceInfo]`, without characters that cannot be printed."""
        return printable(self.device.get(key, ""))[:LONGEST_NAME]


def printable(text: str) -> str:
    """A text without the characters that cannot be printed, some of which would be orders to a terminal."""
    return "".join(each for each in text if each.isprintable())


def called(address: int) -> str:
    """An object's index and subindex in hexadecimal."""
    return f"{address >> 8:04X}:{address & 0xFF:X}"


def whole(text: str) -> int:
    """A whole number, decimal or hexadecimal. Raises ValueError: it is none, or it is another one in octal."""
    if re.fullmatch(r"[+-]?[0-9]+", text):
        if re.fullmatch(r"[+-]?0[0-7]+", text) and int(text, 8) != int(text, 10):
            raise ValueError(f"{text[:SHOWN]} may be octal or decimal")
        return int(text, 10) if len(text) < SHOWN else _refuse(text)
    if re.fullmatch(r"[+-]?0[xX][0-9a-fA-F]+", text):
        return int(text, 16)
    return _refuse(text)


def _refuse(text: str) -> int:
    raise ValueError(f"{text[:SHOWN]!r} is no whole number")


def word(text: str) -> str:
    """A value without the comment behind it. Texts that people read may hold semicolons, and are not cut so."""
    return text.partition(";")[0].strip()


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
    notes: list[str] = []
    sections = _sections(_text(content, path), notes)
    if len(notes) > MOST_PROBLEMS:
        notes[MOST_PROBLEMS:] = [f"{len(notes) - MOST_PROBLEMS} more lines are not used"]
    if DEVICE not in sections:
        raise ConfigError(f"{path}: has no section [DeviceInfo]; give an EDS or DCF")
    objects = _objects(sections, notes)
    if not objects:
        raise ConfigError(f"{path}: has no objects; give an EDS or DCF")
    configured = next((sections[name] for name in COMMISSIONING if name in sections), {})
    return DataSheet(
        path.name,
        hashlib.sha256(content).hexdigest(),
        objects,
        sections[DEVICE],
        _node(configured, notes),
        _bitrate(configured, notes),
        tuple(notes),
    )


def _text(content: bytes, path: Path) -> str:
    """The text of a file. CiA 306 asks for ASCII; makers use what their editors do. Raises ConfigError: it is none."""
    try:
        if content.startswith((b"\xff\xfe", b"\xfe\xff")):
            return content.decode("utf-16")
        if b"\0" in content[:4]:
            return content.decode("utf-16-le" if content[1] == 0 else "utf-16-be")
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"\0" in content:
            raise ConfigError(f"{path}: is no text in UTF-8, UTF-16 or Latin-1; give an EDS or DCF") from None
        return content.decode("latin-1")


def _sections(text: str, notes: list[str]) -> dict[str, dict[str, str]]:
    """The sections by name, each with its values by key, all names in lower case.

    Of a section or key that is there twice the first one counts, as in Windows' own reader of such files.
    """
    found: dict[str, dict[str, str]] = {}
    name, values = "", dict[str, str]()
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if not line or line.startswith((";", "#")):
            continue
        if line.startswith("["):
            match = SECTION.match(line)
            if match is None:
                notes.append(f"line {number} is no section, and is not used: {_shown(line)}")
                continue
            name = re.sub(r"\s", "", match[1]).lower()
            values = {}
            if name in found:
                notes.append(f"section [{_shown(match[1])}] is there twice; line {number} and what follows is not used")
                continue
            found[name] = values
            continue
        key, equals, value = line.partition("=")
        key = key.strip().lower()
        if not equals or not name:
            if name != "comments":
                notes.append(f"line {number} is neither section nor key, and is not used: {_shown(line)}")
        elif key in values and values[key] != value.strip():
            notes.append(f"section [{_shown(name)}] has {_shown(key)} twice; line {number} is not used")
        else:
            values.setdefault(key, value.strip())
    return found


def _shown(text: str) -> str:
    return printable(text[:SHOWN])


def _objects(sections: Mapping[str, Section], notes: list[str]) -> dict[int, dict[int, Entry]]:
    """The objects by index and subindex."""
    heads: dict[int, Section] = {}
    found: dict[int, dict[int, Entry]] = {}
    for name, section in sections.items():
        match = OBJECT_SECTION.fullmatch(name)
        if match is None:
            continue
        index = int(match[1], 16)
        if match[2] is None:
            heads[index] = section
        else:
            found.setdefault(index, {})[int(match[2], 16)] = _entry(section, sections)
    for index, head in heads.items():
        values = sections.get(f"{index:x}value", sections.get(f"{index:04x}value", {}))
        try:
            count = whole(word(head.get("compactsubobj", "")) or "0")
        except ValueError as error:
            notes.append(f"{index:04X}: its CompactSubObj = {error}; its subindices are not known")
            count = 0
        if count and index not in found:
            found[index] = dict(_compact(head, values, min(count, MOST_SUBINDICES), sections))
        elif index not in found and not word(head.get("subnumber", "")).strip("0x"):
            found[index] = {0: _entry(head, sections)}
    if modules := word(sections.get("supportedmodules", {}).get("nrofentries", "")).strip("0x"):
        notes.append(f"has {modules} kinds of modules, whose objects are not read")
    return found


def _compact(
    head: Section, values: Section, count: int, sections: Mapping[str, Section]
) -> Iterator[tuple[int, Entry]]:
    """The objects of a list that the file gives in short: all alike, but for the values that are given one by one."""
    like = _entry(head, sections)
    yield 0, Entry(UNSIGNED8, "ro", default=str(count))
    for sub in range(1, count + 1):
        own = word(values.get(str(sub), ""))
        yield sub, Entry(like.data_type, like.access, like.low, like.high, like.default, own or like.configured, True)


def _entry(section: Section, sections: Mapping[str, Section]) -> Entry:
    try:
        data_type = whole(word(section.get("datatype", "")))
        if data_type > LAST_TYPE:  # editors of CANFestival describe an object with limits by a type of its own
            inner = sections.get(f"{data_type:x}sub1") or sections.get(f"{data_type:04x}sub1", {})
            data_type = whole(word(inner.get("defaultvalue", ""))) if inner else data_type
    except ValueError:
        data_type = None
    if data_type is None and word(section.get("objecttype", "")).lower().removeprefix("0x").strip("0") == DOMAIN_OBJECT:
        data_type = DOMAIN

    def given(key: str) -> str:
        return word(section.get(key, ""))

    return Entry(
        data_type,
        given("accesstype").lower(),
        given("lowlimit"),
        given("highlimit"),
        given("defaultvalue"),
        given("parametervalue"),
    )


def _node(configured: Section, notes: list[str]) -> int:
    """The node id for which a DCF was made; 0: none."""
    text = word(configured.get("nodeid", ""))
    try:
        node = whole(text or "0")
    except ValueError as error:
        notes.append(f"NodeID {error}; it is not used")
        return 0
    if node in NODES or node in NOT_CONFIGURED:
        return node if node in NODES else 0
    notes.append(f"NodeID = {_shown(text)} is no node id (1 to 127), and is not used")
    return 0


def _bitrate(configured: Section, notes: list[str]) -> int | None:
    """The bit rate for which a DCF was made [bit/s]; None: none."""
    text = word(configured.get("baudrate", ""))
    try:
        rate = whole(text or "0")
    except ValueError as error:
        notes.append(f"Baudrate {error}; it is not used")
        return None
    if rate >= SLOWEST_IN_BITS:
        notes.append(f"Baudrate = {_shown(text)} is taken in bit/s; CiA 306 has kbit/s")
        return rate
    return 1000 * rate or None


def objects_of(sheet: DataSheet, index: int) -> list[int]:
    """Addresses of the objects of an index, without the number of its subindices."""
    subs = sheet.objects.get(index, {0: None})
    return [sdo(index, sub) for sub in subs if sub or len(subs) == 1]


# --- types, access and values of objects, as CiA 306 writes them -----------------------------------------

# by the numbers of CiA 301; what has no type of ours cannot be used
TYPES: dict[int, tuple[str, Type | None]] = {
    0x01: ("BOOLEAN", "bool"), 0x02: ("INTEGER8", "int8"), 0x03: ("INTEGER16", "int16"), 0x04: ("INTEGER32", "int32"),
    0x05: ("UNSIGNED8", "uint8"), 0x06: ("UNSIGNED16", "uint16"), 0x07: ("UNSIGNED32", "uint32"),
    0x08: ("REAL32", "float32"), 0x09: ("VISIBLE_STRING", "text"), 0x0A: ("OCTET_STRING", None),
    0x0B: ("UNICODE_STRING", None), 0x0C: ("TIME_OF_DAY", None), 0x0D: ("TIME_DIFFERENCE", None),
    DOMAIN: ("DOMAIN", None), 0x10: ("INTEGER24", "int24"), 0x11: ("REAL64", "float64"), 0x12: ("INTEGER40", None),
    0x13: ("INTEGER48", None), 0x14: ("INTEGER56", None), 0x15: ("INTEGER64", "int64"), 0x16: ("UNSIGNED24", "uint24"),
    0x18: ("UNSIGNED40", None), 0x19: ("UNSIGNED48", None), 0x1A: ("UNSIGNED56", None), 0x1B: ("UNSIGNED64", "uint64"),
}  # fmt: skip
USABLE = ", ".join(name for name, type_ in TYPES.values() if type_)
ACCESS: dict[str, Access] = {"const": "ro", "ro": "ro", "wo": "wo", "rw": "rw", "rwr": "rw", "rww": "rw"}
NODE_ID = "$NODEID"
HEXADECIMAL = ("0x", "0X")


def type_of(entry: Entry) -> Type:
    """The type of an object. Raises ValueError: it has none, or one that cannot be used."""
    if entry.data_type is None:
        raise ValueError(f"has no DataType; valid: {USABLE}")
    name, type_ = TYPES.get(entry.data_type, (f"{entry.data_type:X}h", None))
    if type_ is None:
        raise ValueError(f"its type {name} cannot be used; valid: {USABLE}")
    return type_


def access_of(entry: Entry) -> Access:
    """The access of an object. Raises ValueError: it has none, or one that CiA 306 does not know."""
    if entry.access not in ACCESS:
        raise ValueError(f"its access {entry.access!r} is unknown; valid: {', '.join(ACCESS)}")
    return ACCESS[entry.access]


def split(text: str) -> tuple[bool, str]:
    """Whether a value counts from the node id (`$NODEID`), and what stands beside that.

    Raises ValueError: more than a sum of the two.
    """
    if NODE_ID not in text.upper():
        return False, text
    before, _, after = (part.strip() for part in re.sub(r"(?i)\$nodeid", "\0", text, count=1).partition("\0"))
    if not before and not after:
        return True, "0"
    if before and not after and before.endswith("+"):
        return True, before[:-1].strip()
    if after and not before and after.startswith("+"):
        return True, after[1:].strip()
    raise ValueError(f"{text!r} is no sum of {NODE_ID} and a number")


def value_of(text: str, type_: Type) -> float:
    """The number that a text stands for in a type, which is not `text`. A whole number is exact.

    A signed number may be given by the bit pattern of its type, a float by that of IEEE 754, both in hexadecimal.

    Raises ValueError: the text is no such number, or the type cannot hold it.
    """
    if type_.startswith("float"):
        return _float(text, type_)
    number = whole(text)
    bits = 8 * SIZE[type_]
    if type_.startswith("int") and text.startswith(HEXADECIMAL) and 1 << bits - 1 <= number < 1 << bits:
        number -= 1 << bits
    try:
        codec(type_, "<").pack(number)
    except (struct.error, OverflowError):
        least, most = (-(1 << bits - 1), (1 << bits - 1) - 1) if type_.startswith("int") else (0, (1 << bits) - 1)
        why = "more digits than can be kept" if least <= number <= most else f"beyond {least} to {most}"
        raise ValueError(f"{text} has {why}" if "digits" in why else f"{text} is {why}") from None
    if type_ == "bool" and number > 1:
        raise ValueError(f"{text} is beyond 0 to 1")
    return number


def _float(text: str, type_: Type) -> float:
    packed = struct.Struct("<" + STRUCT[type_])
    try:
        if text.startswith(HEXADECIMAL):
            number: float = packed.unpack(whole(text).to_bytes(packed.size, "little"))[0]
        elif re.fullmatch(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?", text):
            number = packed.unpack(packed.pack(float(text)))[0]  # as near as the type comes to it
        else:
            raise ValueError(f"{text[:40]!r} is no number")
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{text[:40]} is beyond a number of {8 * packed.size} bits")
    return number


# --- the process data, as far as a map can hold them -----------------------------------------------------

INVALID, NO_RTR, EXTENDED = 1 << 31, 1 << 30, 1 << 29  # bits of a COB-ID: not used, no remote frames, 29 bits
FLAGS = INVALID | NO_RTR | EXTENDED
MULTIPLEXED = (254, 255)  # numbers of mapped objects
MOST_MAPPED = 64  # objects of one bit fill a frame
BITS = 64  # of a frame
LAST_DUMMY = 0x1F  # objects of which a PDO holds as many bits as their type has, and nobody looks at them
WHEN_IT_WANTS = 255  # transmission type


@dataclass(frozen=True)
class Mapped:
    """A PDO as the maker maps it.

    Attributes:
        index: its communication object.
        base: its COB-ID without the node id.
        node: the node id for which alone the file knows its COB-ID; 0: any.
        objects: addresses of its objects.
        transmission: its transmission type.
        fixed: why no driver can set it up; "": one can.
    """

    index: int
    base: int
    node: int
    objects: tuple[int, ...]
    transmission: int
    fixed: str


def pdos(sheet: DataSheet, first: int) -> tuple[list[Mapped], list[str]]:
    """The PDOs that are in use, and why others are left out.

    Args:
        sheet: the data sheet.
        first: 1800h for the PDOs that the node sends, 1400h for those that it takes.
    """
    found: list[Mapped] = []
    left_out: list[str] = []
    for index in range(first, first + PDOS):
        if index not in sheet.objects and index + PDOS not in sheet.objects:
            continue
        try:
            pdo = _pdo(sheet, index)
            same = next((each for each in found if pdo and each.base == pdo.base), None)
            if same is not None:
                raise ValueError(f"has the COB-ID of PDO {same.index:04X}h")
        except (ConfigError, ValueError) as error:
            left_out.append(f"PDO {index:04X}h: {str(error).removeprefix(sheet.name + ': ')}")
        else:
            found += [] if pdo is None else [pdo]
    return found, left_out


def _pdo(sheet: DataSheet, index: int) -> Mapped | None:
    """A PDO; None: it is not in use. Raises ConfigError, ValueError: no map can hold it."""
    communication = sheet.objects.get(index, {})
    mapping = sheet.objects.get(index + PDOS, {})
    used = communication.get(COB_ID)
    if used is not None and used.effective and _raw(sheet, sdo(index, COB_ID))[1] & INVALID:
        return None
    entries = _entries(sheet, index + PDOS)
    if not entries:
        return None
    if used is None or not used.effective:
        raise ValueError(f"{called(sdo(index, COB_ID))} gives no COB-ID")
    base, node = _cob_id(sheet, index)
    objects = [_object(sheet, number, entry, index >= SENT) for number, entry in enumerate(entries, 1)]
    if (bits := sum(entry & 0xFF for entry in entries)) > BITS:
        raise ValueError(f"holds {bits} bits, and a frame {BITS}")
    if twice := [address for number, address in enumerate(objects) if address in objects[:number]]:
        raise ValueError(f"holds {called(twice[0])} twice")
    transmission = WHEN_IT_WANTS
    if TRANSMISSION_TYPE in communication and communication[TRANSMISSION_TYPE].effective:
        transmission = _number(sheet, sdo(index, TRANSMISSION_TYPE))
    if not 0 <= transmission <= WHEN_IT_WANTS:
        raise ValueError(f"its transmission type {transmission} is beyond 0 to {WHEN_IT_WANTS}")
    return Mapped(index, base, node, tuple(objects), transmission, _fixed(communication, mapping, index, len(entries)))


def _raw(sheet: DataSheet, address: int) -> tuple[bool, int]:
    """Whether an object's value counts from the node id, and the number. Raises ConfigError: it is none."""
    try:
        relative, rest = split(sheet.entry(address).effective)
        return relative, whole(rest)
    except ValueError as error:
        raise ConfigError(f"{sheet.name}: {called(address)}: {error}") from None


def _number(sheet: DataSheet, address: int) -> int:
    relative, number = _raw(sheet, address)
    if relative:
        raise ConfigError(f"{sheet.name}: {called(address)}: counts from the node id, which it cannot")
    return number


def _cob_id(sheet: DataSheet, index: int) -> tuple[int, int]:
    """The COB-ID of a PDO without the node id, and the node id for which alone it is known; 0: any.

    Raises ConfigError, ValueError: there is none that a map can hold.
    """
    address = sdo(index, COB_ID)
    entry = sheet.entry(address)
    relative, number = _raw(sheet, address)
    identifier = number & ~FLAGS
    shown = entry.effective[:40]
    if number & EXTENDED:
        raise ValueError(f"its COB-ID {shown} has 29 bits; a map holds those of 11")
    if number < 0 or identifier > LARGEST:
        raise ValueError(f"its COB-ID {shown} has more than 11 bits")
    if relative:
        if not identifier:
            raise ValueError(f"its COB-ID {shown} is kept for other messages")
        return identifier, 0
    if any(identifier in kept for kept in KEPT):
        raise ValueError(f"its COB-ID {shown} is kept for other messages")
    if not sheet.node:
        raise ValueError(f"its COB-ID {shown} is that of one node id, which the file does not tell; give --node")
    base = identifier - sheet.node
    if entry.configured and entry.default:
        with_id, usual = split(entry.default)
        if with_id and whole(usual) & ~FLAGS == base:  # configured as it is on every node
            return base, 0
    return base, sheet.node


def _entries(sheet: DataSheet, mapping: int) -> list[int]:
    """The mapped objects of a PDO, each with its number of bits. Raises ConfigError, ValueError: they are not known."""
    subs = sheet.objects.get(mapping, {})
    if 0 not in subs or not subs[0].effective:
        if any(entry.effective.strip("0xX") for sub, entry in subs.items() if sub):
            raise ValueError(f"{called(sdo(mapping))} gives no number of mapped objects")
        return []
    count = _number(sheet, sdo(mapping))
    if count in MULTIPLEXED:
        raise ValueError(f"{called(sdo(mapping))} = {count}: it is a multiplexed PDO, which a map cannot hold")
    while count in subs and count and subs[count].compact and not subs[count].effective.strip("0xX"):
        count -= 1  # such a list has a place for every object that there can be
    if not 0 <= count <= MOST_MAPPED:
        raise ValueError(f"{called(sdo(mapping))} = {count}: a PDO holds {MOST_MAPPED} objects at most")
    return [_number(sheet, sdo(mapping, number)) for number in range(1, count + 1)]


def _object(sheet: DataSheet, number: int, entry: int, sent: bool) -> int:
    """The address of a mapped object. Raises ConfigError, ValueError: a map cannot hold it."""
    address, bits = entry >> 8, entry & 0xFF
    if not 0 < entry < 1 << 32:
        raise ValueError(f"its object {number} is {entry:#x}")
    if address >> 8 <= LAST_DUMMY:
        raise ValueError(f"its object {number} is a dummy of {bits} bits, which a map cannot hold")
    found = sheet.entry(address)
    try:
        type_, access = type_of(found), access_of(found)
    except ValueError as error:
        raise ConfigError(f"{sheet.name}: {called(address)}: {error}") from None
    if type_ == "text":
        raise ValueError(f"holds {called(address)}, a text")
    if bits != 8 * SIZE[type_]:
        raise ValueError(f"holds {bits} bits of {called(address)}, a map only its whole {8 * SIZE[type_]}")
    if access == ("wo" if sent else "ro"):
        raise ValueError(f"holds {called(address)}, which can only be {'written' if sent else 'read'}")
    return address


def _fixed(communication: Mapping[int, Entry], mapping: Mapping[int, Entry], index: int, count: int) -> str:
    """Why no driver can set a PDO up: which of the objects that it would write the node does not let it; "": none."""
    needed = [(index, communication, COB_ID), (index, communication, TRANSMISSION_TYPE)]
    for at, subs, sub in (*needed, *((index + PDOS, mapping, number) for number in range(count + 1))):
        access = subs[sub].access if sub in subs else "not there"
        if ACCESS.get(access) != "rw":
            return f"{called(sdo(at, sub))} is {access or 'of no known access'}"
    return ""


# --- what a map takes from it --------------------------------------------------------------------------


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
            of_sheet, _ = field_of(sheet, f.address)
        except ConfigError as error:
            yield f"{f.name}: {error}"
            continue
        for what, here, there in (("type", f.type, of_sheet.type), ("access", f.access, of_sheet.access)):
            if here != there:
                yield f"{f.name}: {what} is {here!r}, in {sheet.name} it is {there!r}"


def fixed_otherwise(sheet: DataSheet, contract: Contract) -> Iterator[str]:
    """Where a map says something else of a PDO than the data sheet, which lets nobody set it up."""
    for ours, first in ((contract.pdos, SENT), (contract.receives, TAKEN)):
        of_sheet = {each.index: each for each in pdos(sheet, first)[0] if each.fixed}
        for pdo in ours:
            there = of_sheet.get(pdo.index or pdo.fixed)
            if there is None:
                continue
            if pdo.index:
                yield f"PDO {pdo.name}: index: nobody can set it up, because in {sheet.name} {there.fixed}"
            if (pdo.base, pdo.node) != (there.base, there.node):
                yield f"PDO {pdo.name}: base is {pdo.base:#x}, in {sheet.name} it is {there.base:#x}"
            if (objects := tuple(contract[name].address for name in pdo.fields)) != there.objects:
                wanted = ", ".join(map(called, there.objects))
                yield f"PDO {pdo.name}: holds {', '.join(map(called, objects))}, in {sheet.name} it holds {wanted}"


# --- the text of a map file that is made from a data sheet -----------------------------------------------

ALWAYS = (0x1000, 0x1001, 0x1017)  # objects that every node has or may have
FIRST = {"sends": SENT, "takes": TAKEN}  # communication objects of the first PDOs
HEAD = """# {title}: made from {file}, which belongs to its maker.
# Units, scales and roles are not in such a file: take them from the manual.

"""


def imported(
    path: Path,
    objects: Sequence[str],
    name: str = "",
    node: int | None = None,
    tell: Callable[[str], object] = lambda _: None,
) -> str:
    """The text of a map: the objects that are named, and those of the PDOs that are in use.

    Args:
        path: the EDS or DCF.
        objects: see `chosen`.
        name: name of the map; "": made of the product's name.
        node: node id that the device has as it leaves the factory; None: that of a DCF, if it has one.
        tell: is called with each sentence on what the map does not have of the file, and why; it is in the text, too.

    Raises:
        ConfigError: the file cannot be read, or some of the objects cannot be used; the message names each.
    """
    sheet = read_sheet(path)
    sheet = replace(sheet, node=node or sheet.node)
    title = sheet.named("productname") or Path(sheet.name).stem
    vendor, product, revision = identity(sheet)
    asked = chosen(sheet, objects)
    found = {direction: pdos(sheet, first) for direction, first in FIRST.items()}
    fields, left_out = _fields(sheet, asked, [pdo for several, _ in found.values() for pdo in several])
    left_out += [note for _, notes in found.values() for note in notes]
    bitrate = sheet.bitrate if sheet.bitrate and sheet.bitrate in BITRATES else None  # a range is searched for None
    notes = [
        *(f"Left out: {each}" for each in left_out),
        *([] if bitrate == sheet.bitrate else [f"Left out: Baudrate: {sheet.bitrate} bit/s is no bit rate of CAN"]),
        *(
            f"Note: PDO {pdo.index:04X}h is as the node has it, no driver sets it up: {pdo.fixed}"
            for several, _ in found.values()
            for pdo in several
            if pdo.fixed
        ),
        *(
            f"Note: PDO {pdo.index:04X}h has its COB-ID {pdo.base + pdo.node:X}h at node id {pdo.node} alone"
            for several, _ in found.values()
            for pdo in several
            if pdo.node
        ),
        *(f"Note: {each}" for each in (*doubts(sheet), *sheet.notes)),
    ]
    device = {
        "name": name or slug(title),
        "title": title,
        "bus": "canopen",
        "links": ["canopen"],
        "vendor": vendor or sheet.named("vendorname") or "not known",
        "product": product,
        "revision": revision,
        "known_by": "identity" if vendor and product else "nothing",
        "documents": [sheet.name],
    }
    if sdo(0x1018, 4) in fields:
        device["serial"] = fields[sdo(0x1018, 4)].name
    line = {key: value for key, value in (("bitrate", bitrate), ("node", sheet.node or None)) if value is not None}
    data = {
        "device": device,
        "line": line,
        "eds": {"name": sheet.name, "sha256": sheet.sha256},
        "field": {f.name: _table(f) for f in fields.values()},
        **{
            direction: {
                f"{direction}_{pdo.index - FIRST[direction] + 1}": {
                    "base": pdo.base,
                    "fields": [fields[at].name for at in pdo.objects],
                    "fixed" if pdo.fixed else "index": pdo.index,
                    "transmission": pdo.transmission,
                    **({"node": pdo.node} if pdo.node else {}),
                }
                for pdo in several
            }
            for direction, (several, _) in found.items()
        },
    }
    text = HEAD.format(title=title, file=printable(sheet.name))
    text += "".join(f"# {each}\n" for each in map(printable, notes)) + tomli_w.dumps(data)
    content = text.encode()
    if len(content) > LARGEST_FILE:
        raise ConfigError(f"{path}: a map of {len(fields)} objects is larger than {LARGEST_FILE} bytes; name fewer")
    map_of(path.with_suffix(".toml"), content)
    for each in notes:
        tell(printable(each))
    return text


def slug(title: str) -> str:
    """A name of a map made of a product's name."""
    found = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40].strip("-")
    return found if found[:1].isalpha() else f"device-{found}".strip("-")


def _fields(sheet: DataSheet, asked: Mapping[int, str], pdos: Sequence[Mapped]) -> tuple[dict[int, Field], list[str]]:
    """The fields by address, and what is left out. Raises ConfigError: an object that was asked for cannot be used."""
    usual = [*map(sdo, ALWAYS), *(sdo(IDENTITY, sub) for sub in range(1, 5))]
    wanted = {**dict.fromkeys(usual, ""), **dict.fromkeys((at for pdo in pdos for at in pdo.objects), ""), **asked}
    fields: dict[int, Field] = {}
    refused, left_out = [], []
    for address, name in sorted(wanted.items()):
        try:
            fields[address], without = field_of(sheet, address, name)
            left_out += without
        except ConfigError as error:
            if address in asked:
                refused.append(str(error))
            elif address & 0xFF in sheet.objects.get(address >> 8, {}):
                left_out.append(str(error).removeprefix(f"{sheet.name}: "))
    names = Counter(f.name for f in fields.values())
    refused += [
        f"{sheet.name}: {count} objects are called {name}; name them apart"
        for name, count in names.items()
        if count > 1
    ]
    if refused:
        raise ConfigError("\n".join(refused))
    return fields, left_out


def _table(f: Field) -> dict[str, Any]:
    """The keys of a field that differ from what is usual."""
    keys: dict[str, Any] = {"address": called(f.address), "type": f.type, "meaning": f.meaning}
    usual = Field("usual", 0, f.type, "")
    for key in ("access", "minimum", "maximum", "default", "source"):
        if (value := getattr(f, key)) != getattr(usual, key):
            keys[key] = int(value) if isinstance(value, float) and value.is_integer() else value
    return keys


# --- names and meanings of the objects that CiA's profiles define, in our own words ----------------------

# by address: name and meaning (CiA 301, 401, 402, 404)
STANDARD: dict[int, tuple[str, str]] = {
    sdo(0x1000): ("device_type", "profile that the device follows"),
    sdo(0x1001): ("error_register", "kinds of errors that are there"),
    sdo(0x1005): ("sync_cob_id", "COB-ID of SYNC, and whether the device produces it"),
    sdo(0x1006): ("sync_period", "period of SYNC in microseconds"),
    sdo(0x1008): ("device_name", "name that the maker gives"),
    sdo(0x1009): ("hardware_version", "version of the hardware"),
    sdo(0x100A): ("software_version", "version of the firmware"),
    sdo(0x100C): ("guard_time", "period of node guarding in milliseconds"),
    sdo(0x100D): ("life_time_factor", "guard times without guarding after which the master counts as gone"),
    sdo(0x1010, 1): ("save_all", "keeps all settings when the power goes"),
    sdo(0x1014): ("emergency_cob_id", "COB-ID of emergency messages"),
    sdo(0x1016, 1): ("heartbeat_consumed_1", "whose heartbeat the device waits for, and how long in milliseconds"),
    sdo(0x1016, 2): ("heartbeat_consumed_2", "whose heartbeat the device waits for, and how long in milliseconds"),
    sdo(0x1017): ("heartbeat", "period of its heartbeat in milliseconds"),
    sdo(0x1018, 1): ("vendor", "number of the maker"),
    sdo(0x1018, 2): ("product", "number of the product"),
    sdo(0x1018, 3): ("revision", "number of the revision"),
    sdo(0x1018, 4): ("serial", "serial number"),
    sdo(0x1019): ("sync_counter_overflow", "value at which the counter of SYNC begins anew"),
    sdo(0x1029, 1): ("on_communication_error", "state that the device goes to on a loss of communication"),
    sdo(0x6007): ("on_abort_of_connection", "what a drive does on a loss of communication"),
    sdo(0x603F): ("error_code", "code of the last error of a drive"),
    sdo(0x6040): ("controlword", "orders of a drive"),
    sdo(0x6041): ("statusword", "state of a drive"),
    sdo(0x605A): ("quick_stop_option", "how a drive stops quickly"),
    sdo(0x6060): ("mode", "mode of operation that is asked for"),
    sdo(0x6061): ("mode_shown", "mode of operation that the drive is in"),
    sdo(0x6064): ("position", "position of a drive"),
    sdo(0x6065): ("following_error_window", "greatest following error"),
    sdo(0x606C): ("velocity", "velocity of a drive"),
    sdo(0x6071): ("target_torque", "torque that is asked for, in thousandths of the rated one"),
    sdo(0x6072): ("torque_limit", "greatest torque, in thousandths of the rated one"),
    sdo(0x6075): ("rated_current", "rated current"),
    sdo(0x6076): ("rated_torque", "rated torque"),
    sdo(0x6077): ("torque", "torque of a drive, in thousandths of the rated one"),
    sdo(0x607A): ("target_position", "position that is asked for"),
    sdo(0x607C): ("home_offset", "position of the home switch"),
    sdo(0x607D, 1): ("position_limit_low", "least position"),
    sdo(0x607D, 2): ("position_limit_high", "greatest position"),
    sdo(0x6081): ("profile_velocity", "velocity of a move"),
    sdo(0x6083): ("profile_acceleration", "acceleration of a move"),
    sdo(0x6084): ("profile_deceleration", "deceleration of a move"),
    sdo(0x6087): ("torque_slope", "greatest change of torque in a second"),
    sdo(0x6098): ("homing_method", "way of homing"),
    sdo(0x60B2): ("torque_offset", "torque that is added"),
    sdo(0x60FF): ("target_velocity", "velocity that is asked for"),
    sdo(0x6502): ("modes_supported", "modes of operation that the drive has"),
    **{sdo(0x6000, n): (f"digital_input_{n}", f"digital inputs, byte {n}") for n in range(1, 9)},
    **{sdo(0x6200, n): (f"digital_output_{n}", f"digital outputs, byte {n}") for n in range(1, 9)},
    **{sdo(0x6401, n): (f"analogue_input_{n}", f"analogue input {n}") for n in range(1, 17)},
    **{sdo(0x6403, n): (f"analogue_input_float_{n}", f"analogue input {n}") for n in range(1, 17)},
    **{sdo(0x6411, n): (f"analogue_output_{n}", f"analogue output {n}") for n in range(1, 17)},
    **{
        sdo(index, n): (f"{name}_{n}", f"{meaning} of channel {n}")
        for index, name, meaning in (
            (0x6443, "output_error_mode", "whether an output takes its error value on a loss of communication"),
            (0x6444, "output_error_value", "value of an output on a loss of communication"),
            (0x6110, "sensor_type", "kind of sensor"),
            (0x6125, "auto_zero", "order to take the present value as zero"),
            (0x6131, "unit_of_value", "unit of the process value"),
            (0x6132, "decimals", "decimals of the process value"),
            (0x6150, "input_status", "state of the process value"),
            (0x7130, "process_value", "process value, 16 bits"),
            (0x8130, "process_value_24", "process value, 24 bits"),
        )
        for n in range(1, 5)
    },
}  # fmt: skip
