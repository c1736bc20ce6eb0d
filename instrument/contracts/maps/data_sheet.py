"""Reads a maker's electronic data sheet (EDS) or configuration (DCF), as CiA 306 defines them and as makers write them.

Such a file is an INI file. Keys and sections may be in any case and any order, and values may be missing. Nothing is
guessed: what cannot be read is told when somebody asks for it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from palpate.instrument.config import MOST_PROBLEMS
from palpate.instrument.contracts.field import sdo
from palpate.instrument.errors import ConfigError, check_path

LARGEST_SHEET = 10_000_000  # bytes; files of thousands of objects have one or two million
SECTION = re.compile(r"\[([^\]]*)\]")
OBJECT = re.compile(r"([0-9a-f]{1,4})(?:sub([0-9a-f]{1,2}))?")
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
    def told(self) -> str:
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
        match = OBJECT.fullmatch(name)
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
