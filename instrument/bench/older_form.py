"""The form of bench files before `[link.NAME]` and `[device.NAME]`, in which older runs and logs were recorded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

ON_TCP = ("signal_generator", "shaker_amplifier", "sample_changer")  # each section was a link and the device on it
MOVED = ("host", "port", "timeout")  # keys of such a section that belong to the link
ON_LINE = {"strain_indicator": 1, "positioner": 2}  # both were on [line], with these units if the file gave none
SECTIONS = (*ON_TCP, "line", *ON_LINE, "can")


def older_sections(data: Mapping[str, Any]) -> list[str]:
    """Names of the sections of a bench file that are of the older form."""
    return [name for name in SECTIONS if isinstance(data.get(name), dict)]


def renewed(data: Mapping[str, Any]) -> dict[str, Any]:
    """The content of a bench file in the present form; devices at one TCP address get one link."""
    found = {name: dict(data[name]) for name in older_sections(data)}
    links: dict[str, Any] = {}
    devices: dict[str, Any] = {}
    names: dict[str, str] = {}  # of the links on TCP, by address
    for name in ON_TCP:
        if name in found:
            section = found[name]
            link = {"kind": "modbus-tcp", **{key: section.pop(key) for key in MOVED if key in section}}
            at = names.setdefault(f"{link.get('host')}:{link.get('port', 502)}".lower(), name)
            links.setdefault(at, link)
            devices[name] = {"kind": name, "link": at, "unit": 1, **section}
    if "line" in found:
        links["line"] = {"kind": "modbus-rtu", **found["line"]}
    for name, unit in ON_LINE.items():
        if name in found or "line" in found:
            devices[name] = {"kind": name, "link": "line", "unit": unit, **found.get(name, {})}
    if "can" in found:
        nodes = found["can"].pop("nodes", [])
        links["can"] = {"kind": "canopen", **found["can"]}
        for number, node in enumerate(nodes if isinstance(nodes, list) else [], 1):
            devices[f"sensor_node_{number}"] = {"kind": "sensor_node", "link": "can", "node": node}
    rest = {key: value for key, value in data.items() if key not in found}
    own = {key: rest.pop(key, None) or {} for key in ("link", "device")}
    return {**rest, "link": links | own["link"], "device": devices | own["device"]}
