"""A second reader of makers' EDS and DCF files, straight from CiA 306, against which the importer of maps is held.

It shares no line with the importer, and knows nothing of maps: it says what a file says.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import Pdo
from palpate.instrument.contracts.field import Field
from palpate.instrument.contracts.maps.eds import imported
from palpate.instrument.contracts.maps.map_file import map_of
from palpate.instrument.errors import ConfigError

# CiA 301, 7.4.7.1: number of the type, its name here, its bytes, and whether it has a sign
INTEGERS = {
    1: ("bool", 1, False), 2: ("int8", 1, True), 3: ("int16", 2, True), 4: ("int32", 4, True),
    5: ("uint8", 1, False), 6: ("uint16", 2, False), 7: ("uint32", 4, False), 0x10: ("int24", 3, True),
    0x15: ("int64", 8, True), 0x16: ("uint24", 3, False), 0x1B: ("uint64", 8, False),
}  # fmt: skip
FLOATS = {8: ("float32", ">f"), 0x11: ("float64", ">d")}
TEXT, TEXT_NAME = 9, "text"
ACCESS = {"const": "ro", "ro": "ro", "wo": "wo", "rw": "rw", "rwr": "rw", "rww": "rw"}
EXACT = 2**53
AT_ONCE = 400  # objects of one map


@dataclass(frozen=True)
class Told:
    """One object: its type's number, its access, and the texts of its values; "" where the file says nothing."""

    kind: int
    access: str
    low: str
    high: str
    default: str
    value: str

    @property
    def now(self) -> str:
        return self.value or self.default


@dataclass
class Held:
    """What came of holding an import against a file."""

    objects: int = 0
    pdos: int = 0
    wrong: list[str] = field(default_factory=list)
    lost: list[str] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)

    @property
    def faults(self) -> list[str]:
        return [*self.wrong, *self.lost, *self.refused]


def text_of(path: Path) -> str:
    content = path.read_bytes()
    for encoding in ("utf-16",) if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "latin-1"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    raise AssertionError(path)


def sections_of(text: str) -> dict[str, dict[str, str]]:
    """Sections and keys in capitals; the first one of two counts."""
    parts = re.split(r"(?m)^[ \t]*\[([^\]\r\n]*)\].*$", text)[1:]
    found: dict[str, dict[str, str]] = {}
    for name, body in reversed(list(zip(parts[::2], parts[1::2], strict=True))):
        pairs = re.findall(r"(?m)^[ \t]*([^\s;=\[#][^=\r\n]*?)[ \t]*=[ \t]*([^\r\n]*)", body)
        found[name.upper()] = {key.upper(): value.strip() for key, value in reversed(pairs)}
    return found


def number(text: str) -> int | None:
    text = text.split(";")[0].strip()
    if re.fullmatch(r"[+-]?0[xX][0-9a-fA-F]+", text):
        return int(text, 16)
    if not re.fullmatch(r"[+-]?\d+", text):
        return None
    octal = re.fullmatch(r"0[0-7]+", text)
    return None if octal and int(text, 8) != int(text) else int(text)


def objects_of(sections: dict[str, dict[str, str]]) -> dict[tuple[int, int], Told]:
    found: dict[tuple[int, int], Told] = {}
    for name, keys in sections.items():
        match = re.fullmatch(r"([0-9A-F]{1,4})(SUB([0-9A-F]{1,2}))?", name)
        if match is None:
            continue
        index = int(match[1], 16)
        several = any(re.fullmatch(match[1] + "SUB[0-9A-F]{1,2}", other) for other in sections)
        listed = number(keys.get("COMPACTSUBOBJ", "")) or 0
        if match[2]:
            found[index, int(match[3], 16)] = _told(keys, sections)
        elif listed and not several:
            one = _told(keys, sections)
            own = sections.get(f"{match[1]}VALUE", {})
            found[index, 0] = Told(5, "ro", "", "", str(listed), "")
            for sub in range(1, min(listed, 254) + 1):
                value = own.get(str(sub), "").split(";")[0].strip() or one.value
                found[index, sub] = Told(one.kind, one.access, one.low, one.high, one.default, value)
        elif not several and not (number(keys.get("SUBNUMBER", "")) or 0):
            found[index, 0] = _told(keys, sections)
    return found


def _told(keys: dict[str, str], sections: dict[str, dict[str, str]]) -> Told:
    values = {key: text.split(";")[0].strip() for key, text in keys.items()}
    kind = number(values.get("DATATYPE", "")) or 0
    if kind > 0x1F:  # a type of the maker, as CANFestival has them
        kind = number(sections.get(f"{kind:X}SUB1", {}).get("DEFAULTVALUE", "")) or kind
    return Told(
        kind,
        values.get("ACCESSTYPE", "").lower(),
        *(values.get(key, "") for key in ("LOWLIMIT", "HIGHLIMIT", "DEFAULTVALUE", "PARAMETERVALUE")),
    )


def value_in(text: str, kind: int) -> float | None:
    """The number of a text in a type; None: it is none that the type can hold and that a float keeps."""
    if kind in FLOATS:
        code = FLOATS[kind][1]
        try:
            if text[:2] in ("0x", "0X"):
                return float(struct.unpack(code, int(text, 16).to_bytes(struct.calcsize(code), "big"))[0])
            return float(struct.unpack(code, struct.pack(code, float(text)))[0])
        except (ValueError, OverflowError):
            return None
    found = number(text)
    if found is None:
        return None
    _, size, signed = INTEGERS[kind]
    if signed and text[:2] in ("0x", "0X") and 0 <= found < 256**size:
        found = int.from_bytes(found.to_bytes(size, "big"), "big", signed=True)
    least, most = (-(256**size) // 2, 256**size // 2 - 1) if signed else (0, 256**size - 1)
    if kind == 1:
        most = 1
    return found if least <= found <= most and abs(found) <= EXACT else None


def hold(path: Path, node: int = 0) -> Held:
    """Import all that a file has, and look for what is wrong, lost without a note, or refused wrongly."""
    sections = sections_of(text_of(path))
    objects = objects_of(sections)
    usable = [
        place
        for place, told in objects.items()
        if (told.kind in INTEGERS or told.kind in FLOATS or told.kind == TEXT) and told.access in ACCESS
    ]
    held = Held(len(usable))
    commissioned = sections.get("DEVICECOMISSIONING", sections.get("DEVICECOMMISSIONING", {}))
    own = number(commissioned.get("NODEID", "")) or 0
    node = node or (own if 0 < own < 128 else 0)
    for at in range(0, max(len(usable), 1), AT_ONCE):
        some = usable[at : at + AT_ONCE]
        notes: list[str] = []
        try:
            text = imported(path, [f"{index:04X}:{sub:X}" for index, sub in some], "", node or None, notes.append)
        except ConfigError as error:
            held.refused.append(f"{path.name}: {error}")
            continue
        contract = map_of(path.with_suffix(".toml"), text.encode()).contract
        by_place = {(f.index, f.subindex): f for f in contract.fields}
        for place in some:
            _hold_object(held, path.name, place, objects[place], by_place.get(place), notes, node)
        if not at:
            for first, ours in ((0x1800, contract.pdos), (0x1400, contract.receives)):
                _hold_pdos(held, path.name, objects, first, contract, ours, notes, node)
    return held


def _hold_object(
    held: Held, name: str, place: tuple[int, int], told: Told, f: Field | None, notes: list[str], node: int
) -> None:
    where = f"{place[0]:04X}:{place[1]:X}"
    noted = any(f"{where}:" in note for note in notes)
    if f is None:
        held.lost.append(f"{name}: {where}")
        return
    kind = INTEGERS[told.kind][0] if told.kind in INTEGERS else FLOATS.get(told.kind, (TEXT_NAME, ""))[0]
    if (f.type, f.access) != (kind, ACCESS[told.access]):
        held.wrong.append(f"{name}: {where}: {f.type} {f.access}, {kind} {told.access}")
    if f.type == TEXT_NAME:
        return
    low, high = (value_in(text, told.kind) if text else None for text in (told.low, told.high))
    none = (told.low and told.high) and (low == high == 0)  # as makers write: no limits
    for what, ours, theirs, text in (("low", f.minimum, low, told.low), ("high", f.maximum, high, told.high)):
        if ours is not None and ours != theirs:
            held.wrong.append(f"{name}: {where}: {what} {ours}, {text!r}")
        if ours is None and text and not none and not noted:
            held.lost.append(f"{name}: {where}: {what} {text!r}")
    cob_id = place[0] == 0x1014 or (place[1] == 1 and (place[0] >> 9 << 9) in (0x1400, 0x1800))
    text = told.default or ("" if cob_id else told.value)
    relative = "$NODEID" in text.upper()
    rest = re.sub(r"(?i)\$nodeid|\+|\s", "", text) or "0" if relative else text
    default = value_in(rest, told.kind) if text and (cob_id or not relative) else None
    if cob_id and not relative and default is not None:
        default = default - node if node and default >= node else None
    given = f.default if f.default else 0.0
    if given and given != default:
        held.wrong.append(f"{name}: {where}: default {f.default}, {text!r}")
    if text and not given and default != 0 and not noted:
        held.lost.append(f"{name}: {where}: default {text!r}")


def _entries(objects: dict[tuple[int, int], Told], mapping: int) -> Iterator[int | None]:
    count = number(objects[mapping, 0].now) if (mapping, 0) in objects else 0
    for sub in range(1, (count or 0) + 1):
        yield number(objects[mapping, sub].now) if (mapping, sub) in objects else None


def _hold_pdos(
    held: Held,
    name: str,
    objects: dict[tuple[int, int], Told],
    first: int,
    contract: Contract,
    ours: tuple[Pdo, ...],
    notes: list[str],
    node: int,
) -> None:
    for index in range(first, first + 0x200):
        pdo = next((each for each in ours if (each.index or each.fixed) == index), None)
        noted = any(note.startswith(f"Left out: PDO {index:04X}h:") for note in notes)
        told = objects.get((index, 1))
        text = "" if told is None else told.now
        relative = "$NODEID" in text.upper()
        raw = number(re.sub(r"(?i)\$nodeid|\+|\s", "", text) or "0") if text else None
        entries = list(_entries(objects, index + 0x200))
        while entries and entries[-1] in (0, None):
            entries.pop()
        used = raw is not None and not raw >> 31 & 1 and bool(entries)
        held.pdos += used
        where = f"{name}: PDO {index:04X}h"
        if pdo is None:
            if used and not noted:
                held.lost.append(where)
            continue
        if not used or raw is None:
            held.wrong.append(f"{where} is not in use")
            continue
        at = node or 5
        if pdo.cob_id(at) != (raw & 0x7FF) + (at if relative else 0) or raw >> 29 & 1 or (not relative and not node):
            held.wrong.append(f"{where}: COB-ID {pdo.cob_id(at):X}h at node {at}, {text!r}")
        packed = [contract[each].address << 8 | 8 * contract[each].size for each in pdo.fields]
        if packed != entries:
            held.wrong.append(f"{where}: holds {[f'{each:x}' for each in packed]}, {entries}")
        places = [(index, 1), (index, 2), *((index + 0x200, sub) for sub in range(len(entries) + 1))]
        free = all(place in objects and ACCESS.get(objects[place].access) == "rw" for place in places)
        if bool(pdo.index) != free:
            held.wrong.append(f"{where}: can {'' if free else 'not '}be set up")
