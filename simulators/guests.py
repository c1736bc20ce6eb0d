"""Additional devices of a scene: sections `[device.NAME]` whose kind comes from an installed package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate.instrument.bench.description import check_name, check_role
from palpate.instrument.bench.kinds import KINDS, DeviceKind, Role, device_kind, kind_in_file
from palpate.instrument.config import Config, check
from palpate.instrument.errors import ConfigError, UnknownName

CHANGER = "sample_changer"
OF_BENCH_FILES = ("link", "unit", "node", "inventory", "confirmed", "set_to_link")


class _GuestSection(Config):
    """The keys of every `[device.NAME]` table; its other keys are settings of its kind."""

    kind: str | None = None
    map: str | None = None
    role: Role | None = None
    optional: bool = False


@dataclass(frozen=True)
class Guest:
    """An additional device of a scene.

    Attributes:
        name: its name.
        kind: its device kind.
        settings: the checked settings of its kind.
        table: all keys of its section but `kind` and `map`.
    """

    name: str
    kind: DeviceKind
    settings: Config
    table: Mapping[str, Any]


def replaced(found: Sequence[Guest]) -> tuple[str, ...]:
    """Names of the usual devices that a bench with these guests does not have.

    A guest to which the scene gives a role stands in for the usual device of that role; a guest that drives stands in
    for generator and amplifier in any case, because a bench has one exciter.
    """
    given: set[Role] = {guest.table["role"] for guest in found if guest.table.get("role")}
    if "exciter" in given or any("exciter" in guest.kind.roles for guest in found):
        given |= {"source", "amplifier"}
    return tuple(name for name, kind in KINDS.items() if given & {*kind.roles})


def kind_in(role: Role, found: Sequence[Guest]) -> DeviceKind | None:
    """Kind of the device that fills a role on a simulated bench with these guests; None: there is none.

    A guest to which the scene gives the role comes first, then the usual device, then a guest whose kind has the role.
    A sample changer is no usual device: only a served bench may have one.
    """
    given = [guest.kind for guest in found if guest.table.get("role") == role]
    usual = [kind for name, kind in KINDS.items() if name not in (CHANGER, *replaced(found))]
    return next((kind for kind in (*given, *usual, *(guest.kind for guest in found)) if role in kind.roles), None)


def guests(tables: Mapping[str, Mapping[str, Any]], where: str) -> tuple[Guest, ...]:
    """The additional devices of a scene file, checked. Raises ConfigError, which names file, section and key."""
    return tuple(_guest(name, dict(table), f"{where}: device.{name}") for name, table in tables.items())


def _guest(name: str, table: dict[str, Any], where: str) -> Guest:
    check_name(name, where)
    if given := [key for key in OF_BENCH_FILES if key in table]:
        raise ConfigError(
            f"{where}: {', '.join(given)}: a simulated bench gives its devices links, addresses and labels itself; "
            "leave this out of the scene, it belongs in a bench file"
        )
    own = {key: table[key] for key in _GuestSection.model_fields if key in table}
    section = check(own, _GuestSection, where)
    kind, file = table.pop("kind", None), table.pop("map", None)
    if (kind is None) == (file is None):
        raise ConfigError(f'{where}: kind: give a device kind, as kind = "acme-oven", or map = "FILE.toml"')
    if kind in KINDS or name.startswith(tuple(KINDS)):
        raise ConfigError(
            f"{where}: the simulated bench has a device of this kind or name already; list only additional devices, "
            "and give them other names"
        )
    try:
        found = device_kind(kind) if kind is not None else kind_in_file(Path(str(file)))
        check_role(found, section.role)
    except (ConfigError, UnknownName) as error:
        raise ConfigError(f"{where}: {error}") from None
    if found.simulator is None:
        raise ConfigError(f"{where}: kind: {found.name} has no simulator; leave the device out of the scene")
    settings = check(
        {key: value for key, value in table.items() if key not in own},
        found.settings,
        where,
        _GuestSection.model_fields,
    )
    return Guest(name, found, settings, table)
