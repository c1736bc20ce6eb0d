"""What a map takes from a maker's electronic data sheet (EDS) or configuration (DCF): its fields, and its identity.

Such a file belongs to its maker. A map made from it keeps addresses, types and limits, which are facts, the file's name
and its SHA-256; names and meanings of objects are our own.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from palpate.instrument.config import LARGEST_FILE
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.field import Field, Type, sdo
from palpate.instrument.contracts.maps.data_sheet import (
    DataSheet,
    Entry,
    Mapped,
    access_of,
    called,
    objects_of,
    pdos,
    printable,
    read_sheet,
    split,
    type_of,
    value_of,
    whole,
    word,
)
from palpate.instrument.contracts.maps.map_file import BITRATES, OBJECT, map_of
from palpate.instrument.contracts.pdo import SENT, TAKEN, is_relative
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
