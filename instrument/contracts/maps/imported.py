"""The text of a map file that is made from a maker's EDS or DCF."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomli_w

from palpate.instrument.config import LARGEST_FILE
from palpate.instrument.contracts.field import Field, sdo
from palpate.instrument.contracts.maps import eds
from palpate.instrument.contracts.maps.map_file import map_of
from palpate.instrument.contracts.pdo import SENT, TAKEN
from palpate.instrument.errors import ConfigError

ALWAYS = (0x1000, 0x1001, 0x1017)  # objects that every node has or may have
FIRST = {"sends": SENT, "takes": TAKEN}  # communication objects of the first PDOs
HEAD = """# {title}: made from {file}, which belongs to its maker.
# Units, scales and roles are not in such a file: take them from the manual.

"""


def imported(path: Path, objects: Sequence[str], name: str = "", node: int | None = None) -> str:
    """The text of a map: the objects that are named, and those of the PDOs that are in use.

    Args:
        path: the EDS or DCF.
        objects: see `eds.chosen`.
        name: name of the map; "": made of the product's name.
        node: node id that the device has as it leaves the factory.

    Raises:
        ConfigError: the file cannot be read, or some of the objects cannot be used; the message names each.
    """
    sheet = eds.read_sheet(path)
    told = sheet.objects.device_information
    title = "".join(each for each in str(told.product_name or "") if each.isprintable()) or Path(sheet.name).stem
    vendor, product, revision = eds.identity(sheet)
    asked = eds.chosen(sheet, objects)
    pdos = {direction: list(eds.mapped(sheet, first)) for direction, first in FIRST.items()}
    fields, left_out = _fields(sheet, asked, [each for several in pdos.values() for each in several])
    device = {
        "name": name or slug(title),
        "title": title,
        "bus": "canopen",
        "links": ["canopen"],
        "vendor": vendor or str(told.vendor_name or "not known"),
        "product": product,
        "revision": revision,
        "known_by": "identity" if vendor and product else "nothing",
        "documents": [sheet.name],
    }
    if sdo(0x1018, 4) in fields:
        device["serial"] = fields[sdo(0x1018, 4)].name
    line = {
        key: value
        for key, value in (("bitrate", _bitrate(sheet)), ("node", node or sheet.node or None))
        if value is not None
    }
    data = {
        "device": device,
        "line": line,
        "eds": {"name": sheet.name, "sha256": sheet.sha256},
        "field": {f.name: _table(f) for f in fields.values()},
        **{
            direction: {
                f"{direction}_{each.index - FIRST[direction] + 1}": {
                    "base": each.base,
                    "fields": [fields[at].name for at in each.objects],
                    "index": each.index,
                    "transmission": each.transmission,
                }
                for each in several
                if all(at in fields for at in each.objects)
            }
            for direction, several in pdos.items()
        },
    }
    notes = "".join(f"# Left out: {each}\n" for each in left_out)
    text = HEAD.format(title=title, file=sheet.name) + notes + tomli_w.dumps(data)
    content = text.encode()
    if len(content) > LARGEST_FILE:
        raise ConfigError(f"{path}: a map of {len(fields)} objects is larger than {LARGEST_FILE} bytes; name fewer")
    map_of(path.with_suffix(".toml"), content)
    return text


def slug(title: str) -> str:
    """A name of a map made of a product's name."""
    found = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40].strip("-")
    return found if found[:1].isalpha() else f"device-{found}".strip("-")


def _fields(
    sheet: eds.DataSheet, asked: Mapping[int, str], pdos: Sequence[eds.Mapped]
) -> tuple[dict[int, Field], list[str]]:
    """The fields by address, and what is left out of what nobody asked for. Raises ConfigError: of what was asked."""
    identity = [sdo(eds.IDENTITY, sub) for sub in range(1, 5)]
    wanted = {**dict.fromkeys((*map(sdo, ALWAYS), *identity), ""), **dict.fromkeys(_carried(pdos), ""), **asked}
    fields: dict[int, Field] = {}
    refused, left_out = [], []
    for address, name in sorted(wanted.items()):
        try:
            fields[address] = eds.field_of(sheet, address, name)
        except ConfigError as error:
            if address in asked:
                refused.append(str(error))
            elif address not in (*map(sdo, ALWAYS), *identity):
                left_out.append(str(error))
    names = Counter(f.name for f in fields.values())
    refused += [
        f"{sheet.name}: {count} objects are called {name}; name them apart"
        for name, count in names.items()
        if count > 1
    ]
    if refused:
        raise ConfigError("\n".join(refused))
    return fields, left_out


def _carried(pdos: Sequence[eds.Mapped]) -> Iterator[int]:
    for each in pdos:
        yield from each.objects


def _table(f: Field) -> dict[str, Any]:
    """The keys of a field that differ from what is usual."""
    keys: dict[str, Any] = {"address": eds.called(f.address), "type": f.type, "meaning": f.meaning}
    usual = Field("usual", 0, f.type, "")
    for key in ("access", "minimum", "maximum", "default", "source"):
        if (value := getattr(f, key)) != getattr(usual, key):
            keys[key] = int(value) if isinstance(value, float) and value.is_integer() else value
    return keys


def _bitrate(sheet: eds.DataSheet) -> int | None:
    """The bit rate that a DCF names."""
    rate = sheet.objects.bitrate
    return rate if isinstance(rate, int) and rate > 0 else None
