"""Compares two bench files by the links and devices that they describe, independently of their form."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args

from palpate.instrument.bench.description import BenchDescription, Listed, filling
from palpate.instrument.bench.kinds import Role
from palpate.instrument.bench.links import KIND_OF

Tables = dict[str, dict[str, Any]]


def compared(before: BenchDescription, now: BenchDescription) -> tuple[dict[str, Any], dict[str, Any]]:
    """Two benches as tables that are equal where the benches are.

    If a link or a device has different names in the two files, both tables use the name of the first file.
    """
    first, second = _tables(before), _tables(now)
    links = _names(first["link"], second["link"])
    for name, device in second["device"].items():  # a changed link is recognised by the devices on it
        known = first["device"].get(name, device)["link"]
        if links[device["link"]] not in first["link"] and known not in links.values():
            links[device["link"]] = known
    for device in second["device"].values():
        device["link"] = links[device["link"]]
    devices = _names(first["device"], second["device"])
    second["link"] = {links[name]: table for name, table in second["link"].items()}
    second["device"] = {devices[name]: table for name, table in second["device"].items()}
    return first, second


def _tables(bench: BenchDescription) -> dict[str, Any]:
    links = {name: {"kind": KIND_OF[type(link)], **link.model_dump(mode="json")} for name, link in bench.links.items()}
    listed = bench.devices
    devices = {
        each.name: {
            "kind": each.kind.name,
            "link": each.link,
            "unit": each.unit,
            "role": " ".join(_places(each, listed)),
            "optional": each.optional,
            **each.settings.model_dump(mode="json"),
        }
        for each in listed
    }
    kept = {"name", "design", "force_limit", "withstands", "watchdog", "pickup", "load_channel"}
    whole = bench.model_dump(mode="json", include=kept)
    return {**whole, "link": links, "device": devices}


def _places(device: Listed, listed: Sequence[Listed]) -> Iterator[str]:
    """The roles that a device fills, with its place among several, because the order of nodes gives their channels."""
    for role in get_args(Role):
        several = filling(role, listed)
        if device in several:
            yield role if len(several) == 1 else f"{role} {several.index(device) + 1}"


def _names(first: Mapping[str, object], second: Mapping[str, object]) -> dict[str, str]:
    """For each name of the second, its name in the first: the same one, or that of an equal entry not yet assigned."""
    found = {name: name for name in second}
    left = {name: table for name, table in first.items() if name not in second}
    for name, table in second.items():
        alike = next((other for other, known in left.items() if known == table), None)
        if name not in first and alike is not None:
            found[name] = alike
            del left[alike]
    return found
