"""The text of a map file that is made from a maker's EDS or DCF."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from palpate.instrument.config import LARGEST_FILE
from palpate.instrument.contracts.field import Field, sdo
from palpate.instrument.contracts.maps import eds
from palpate.instrument.contracts.maps.data_sheet import DataSheet, called, printable, read_sheet
from palpate.instrument.contracts.maps.map_file import map_of
from palpate.instrument.contracts.maps.sheet_pdos import Mapped, pdos
from palpate.instrument.contracts.pdo import SENT, TAKEN
from palpate.instrument.contracts.rates import BITRATES
from palpate.instrument.errors import ConfigError

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
        objects: see `eds.chosen`.
        name: name of the map; "": made of the product's name.
        node: node id that the device has as it leaves the factory; None: that of a DCF, if it has one.
        tell: is called with each sentence on what the map does not have of the file, and why; it is in the text, too.

    Raises:
        ConfigError: the file cannot be read, or some of the objects cannot be used; the message names each.
    """
    sheet = read_sheet(path)
    sheet = replace(sheet, node=node or sheet.node)
    title = sheet.named("productname") or Path(sheet.name).stem
    vendor, product, revision = eds.identity(sheet)
    asked = eds.chosen(sheet, objects)
    found = {direction: pdos(sheet, first) for direction, first in FIRST.items()}
    fields, left_out = _fields(sheet, asked, [pdo for several, _ in found.values() for pdo in several])
    left_out += [note for _, notes in found.values() for note in notes]
    bitrate = sheet.bitrate if sheet.bitrate in BITRATES else None
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
        *(f"Note: {each}" for each in (*eds.doubts(sheet), *sheet.notes)),
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
    usual = [*map(sdo, ALWAYS), *(sdo(eds.IDENTITY, sub) for sub in range(1, 5))]
    wanted = {**dict.fromkeys(usual, ""), **dict.fromkeys((at for pdo in pdos for at in pdo.objects), ""), **asked}
    fields: dict[int, Field] = {}
    refused, left_out = [], []
    for address, name in sorted(wanted.items()):
        try:
            fields[address], without = eds.field_of(sheet, address, name)
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
