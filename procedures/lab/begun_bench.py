"""A bench file begun from what a search for devices has found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import tomli_w

from palpate.drivers.scan import FoundDevice
from palpate.instrument.bench.description import BenchDescription
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.bench.links import CanBus, Link, SerialLine, TcpLink
from palpate.instrument.config import check
from palpate.instrument.errors import ConfigError

NAMES: dict[type[Link], tuple[str, str]] = {
    TcpLink: ("modbus-tcp", "tcp"),
    SerialLine: ("modbus-rtu", "line"),
    CanBus: ("canopen", "can"),
}  # fmt: skip


def begun_bench(found: Sequence[FoundDevice], kinds: Sequence[DeviceKind]) -> str:
    """The text of a bench file with each device that one kind fits; the others are comments in it.

    What such a file still lacks, as a kind for a device that is not known, stands in its first lines.
    """
    by_name = {kind.name: kind for kind in kinds}
    links: dict[str, dict[str, Any]] = {}
    devices: dict[str, dict[str, Any]] = {}
    unknown: list[str] = []
    for each in found:
        link = _link(links, each.link)
        place = {"link": link, "node" if each.kind == "canopen" else "unit": each.unit}
        if each.identified:
            kind = by_name[each.fits[0]]
            section = kind.key | place
            if kind.map is not None and each.kind != "modbus-tcp":
                section["set_to_link"] = True  # it answers with the settings of this link
            devices[_new(_plain(kind.name), devices)] = section
            continue
        likely = each.fits or each.candidates
        unknown += ["", f"# unit {each.unit} on {link} answers, and is not known: {each.says or 'it tells nothing'}"]
        unknown += [f"# could be: {' or '.join(likely) or 'no kind that has a map'}"]
        section = (by_name[likely[0]].key if likely else {"map": "FILE"}) | place
        lines = [f"[device.NAME_{each.unit}]", *(f"{key} = {_value(value)}" for key, value in section.items())]
        if not each.fits:
            lines.append('inventory = "LABEL"')
        unknown += [f"# {line}" for line in lines]
    used = {section["link"] for section in devices.values()}
    data = {
        "name": "my bench",
        "link": {name: table for name, table in links.items() if name in used},
        "device": devices,
    }
    text = tomli_w.dumps(data)
    waiting = [name for name in links if name not in used]
    for name in waiting:
        unknown += ["", *(f"# {line}" for line in tomli_w.dumps({"link": {name: links[name]}}).splitlines())]
    return "\n".join([*_still_to_do(data, devices), text.rstrip(), *unknown, ""])


def _still_to_do(data: dict[str, Any], devices: dict[str, Any]) -> list[str]:
    """Comments that say why the file cannot be used yet; none: it can."""
    if not devices:
        return ["# no device is known yet: see below"]
    try:
        check(dict(data), BenchDescription, "this file")
    except ConfigError as error:
        return ["# before it can be used:", *(f"# {line}" for line in str(error).splitlines())]
    return []


def _link(links: dict[str, dict[str, Any]], link: Link) -> str:
    """Name of a link, which is added if it is new."""
    kind, short = NAMES[type(link)]
    table = {"kind": kind} | link.model_dump(mode="json", exclude_defaults=True)
    table |= {key: getattr(link, key) for key in ("baudrate", "parity", "bitrate") if hasattr(link, key)}
    table.pop("timeout", None)  # that of a search is short
    for name, before in links.items():
        if before == table:
            return name
    name = _new(short, links)
    links[name] = table
    return name


def _new(wanted: str, taken: dict[str, Any]) -> str:
    """The wanted name, with a number where it is taken."""
    number, name = 1, wanted
    while name in taken:
        number += 1
        name = f"{wanted}_{number}"
    return name


def _plain(kind: str) -> str:
    return kind.replace("-", "_")[:36]


def _value(value: object) -> str:
    return f'"{value}"' if isinstance(value, str) else str(value)
