"""The process data (PDOs) of a maker's data sheet, as far as a map can hold them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from palpate.instrument.contracts.field import sdo
from palpate.instrument.contracts.maps.data_sheet import DataSheet, Entry, called, whole
from palpate.instrument.contracts.maps.sheet_values import ACCESS, access_of, split, type_of
from palpate.instrument.contracts.pdo import COB_ID, KEPT, LARGEST, PDOS, SENT, TRANSMISSION_TYPE
from palpate.instrument.contracts.wire_types import SIZE
from palpate.instrument.errors import ConfigError

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
    if used is not None and used.told and _raw(sheet, sdo(index, COB_ID))[1] & INVALID:
        return None
    entries = _entries(sheet, index + PDOS)
    if not entries:
        return None
    if used is None or not used.told:
        raise ValueError(f"{called(sdo(index, COB_ID))} gives no COB-ID")
    base, node = _cob_id(sheet, index)
    objects = [_object(sheet, number, entry, index >= SENT) for number, entry in enumerate(entries, 1)]
    if (bits := sum(entry & 0xFF for entry in entries)) > BITS:
        raise ValueError(f"holds {bits} bits, and a frame {BITS}")
    if twice := [address for number, address in enumerate(objects) if address in objects[:number]]:
        raise ValueError(f"holds {called(twice[0])} twice")
    transmission = WHEN_IT_WANTS
    if TRANSMISSION_TYPE in communication and communication[TRANSMISSION_TYPE].told:
        transmission = _number(sheet, sdo(index, TRANSMISSION_TYPE))
    if not 0 <= transmission <= WHEN_IT_WANTS:
        raise ValueError(f"its transmission type {transmission} is beyond 0 to {WHEN_IT_WANTS}")
    return Mapped(index, base, node, tuple(objects), transmission, _fixed(communication, mapping, index, len(entries)))


def _raw(sheet: DataSheet, address: int) -> tuple[bool, int]:
    """Whether an object's value counts from the node id, and the number. Raises ConfigError: it is none."""
    try:
        relative, rest = split(sheet.entry(address).told)
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
    shown = entry.told[:40]
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
    if 0 not in subs or not subs[0].told:
        if any(entry.told.strip("0xX") for sub, entry in subs.items() if sub):
            raise ValueError(f"{called(sdo(mapping))} gives no number of mapped objects")
        return []
    count = _number(sheet, sdo(mapping))
    if count in MULTIPLEXED:
        raise ValueError(f"{called(sdo(mapping))} = {count}: it is a multiplexed PDO, which a map cannot hold")
    while count in subs and count and subs[count].compact and not subs[count].told.strip("0xX"):
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
