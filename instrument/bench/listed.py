"""The devices that a bench file lists: each with its kind, its link and its address on the link."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from palpate.instrument.bench.kinds import DeviceKind, Role, device_kind, kind_in_file
from palpate.instrument.bench.links import CAN, LINE, LINKS, CanBus, Link, TcpLink
from palpate.instrument.config import Config, check
from palpate.instrument.contracts.declaration import ITSELF
from palpate.instrument.contracts.pdo import KEPT, LARGEST, OF_A_NODE
from palpate.instrument.errors import ConfigError, UnknownName

NodeId = Annotated[int, Field(ge=1, le=127, strict=True)]
NAME = re.compile(r"[a-z][a-z0-9_-]{0,39}")
OF_LINK = ("baudrate", "parity", "stopbits", "bitrate")  # settings that all devices on a link share
RESERVED = ("all", LINE, CAN)  # names that faults use for links, and for all


class _DeviceSection(Config):
    """The keys of every `[device.NAME]` table; its other keys are settings of its kind."""

    kind: str | None = None
    map: str | None = None  # path of a map file, instead of a kind
    link: str
    unit: Annotated[int, Field(ge=0, le=255, strict=True)] | None = None  # on Modbus
    node: NodeId | None = None  # on CANopen
    role: Role | None = None
    optional: bool = False
    inventory: str = ""  # its label, if it tells no serial number; needed if it tells nothing by which it is known
    confirmed: bool = False  # that the labelled device is there, so that nobody is asked
    set_to_link: bool = False  # that it was set to the link's baud rate and parity, or bit rate


@dataclass(frozen=True)
class Listed:
    """A device of a bench.

    Attributes:
        name: name of its section; a sensor node is named by its place in the list of nodes.
        kind: its device kind.
        link: name of its link.
        unit: its Modbus unit id, or its CANopen node id.
        settings: settings of its kind.
        role: the role that the file gives it; None: it fills any role of its kind.
        optional: whether the bench can be used without it.
        inventory: its label, if it tells no serial number.
        confirmed: whether nobody has to confirm that it is the labelled one.
        set_to_link: whether it no longer has the baud rate and parity, or the bit rate, with which it left the factory.
    """

    name: str
    kind: DeviceKind
    link: str
    unit: int
    settings: Any
    role: Role | None = None
    optional: bool = False
    inventory: str = ""
    confirmed: bool = False
    set_to_link: bool = False

    @property
    def unknowable(self) -> bool:
        """Whether it tells nothing by which it is known."""
        return self.kind.contract.known_by == "nothing"

    @property
    def section(self) -> dict[str, Any]:
        """The keys of its section, without the settings of its kind."""
        place = {"link": self.link, "node" if self.kind.contract.bus == "canopen" else "unit": self.unit}
        said = {key: getattr(self, key) for key in ("role", "optional", "inventory", "confirmed", "set_to_link")}
        return {**self.kind.key, **place, **{key: value for key, value in said.items() if value}}


def filling(role: Role, devices: Sequence[Listed]) -> list[Listed]:
    """The devices that fill a role: those to which the file gives it or, without any, all whose kind has it."""
    able = [each for each in devices if role in each.kind.roles and each.role in (None, role)]
    return [each for each in able if each.role == role] or able


def check_name(name: str, where: str) -> None:
    """Raises ConfigError: the name is not allowed for a device."""
    if not NAME.fullmatch(name) or name in RESERVED:
        raise ConfigError(
            f"{where}: {name!r} is no name of a device: give small letters, digits, _ and -, such as oven_2"
        )


def listed(name: str, table: dict[str, Any], links: Mapping[str, Link]) -> Listed:
    """The device of a `[device.NAME]` table. Raises ConfigError, UnknownName: the table is wrong."""
    where = f"device.{name}"
    check_name(name, where)
    own = {key: table.pop(key) for key in _DeviceSection.model_fields if key in table}
    section = check(own, _DeviceSection, where)
    try:
        kind = _kind(section, where)
        if section.link not in links:
            raise UnknownName("link", section.link, links)
        check_role(kind, section.role)
    except (ConfigError, UnknownName) as error:
        raise ConfigError(f"{where}: {error}") from None
    link = links[section.link]
    if not any(isinstance(link, LINKS[each]) for each in kind.links):
        raise ConfigError(
            f"{where}: link: a {kind.name} needs a link of kind {' or '.join(kind.links)}; {section.link!r} is of "
            "another kind"
        )
    key, other = ("node", "unit") if isinstance(link, CanBus) else ("unit", "node")
    if getattr(section, key) is None or getattr(section, other) is not None:
        raise ConfigError(
            f"{where}: a device on link {section.link} needs a {key} and must have no {other}; give {key} = NUMBER"
        )
    unit: int = getattr(section, key)
    _check_unit(where, kind, link, unit)
    _check_inventory(where, kind, section)
    settings = check(table, kind.settings, where, _DeviceSection.model_fields)
    return Listed(
        name, kind, section.link, unit, settings, section.role, section.optional, section.inventory, section.confirmed,
        section.set_to_link,
    )  # fmt: skip


def check_role(kind: DeviceKind, role: Role | None) -> None:
    """Raises ConfigError, UnknownName: a device of a kind cannot fill this role."""
    if role is not None and role in kind.cannot:
        raise ConfigError(
            f"role: a {kind.name} cannot be the {role}: {kind.cannot[role]}; it serves as {' or '.join(kind.roles)} "
            "alone"
        )
    if role is not None and role not in kind.roles:
        raise UnknownName(f"role of a {kind.name}", role, kind.roles)


def _check_unit(where: str, kind: DeviceKind, link: Link, unit: int) -> None:
    """Raises ConfigError: such a device cannot answer at this unit id."""
    if isinstance(link, CanBus) or can_be_asked(kind, isinstance(link, TcpLink), unit):
        return
    low, high = kind.contract.manners.units
    itself = ", and on TCP at 0 or 255, which are the device at the address itself" if isinstance(link, TcpLink) else ""
    raise ConfigError(f"{where}: unit = {unit}: a {kind.name} answers at {low} to {high}{itself or ' alone'}")


def can_be_asked(kind: DeviceKind, on_tcp: bool, unit: int) -> bool:
    """Whether a device of a kind can answer at this unit id."""
    low, high = kind.contract.manners.units
    return low <= unit <= high or (on_tcp and unit in ITSELF)


def _check_inventory(where: str, kind: DeviceKind, section: _DeviceSection) -> None:
    """Raises ConfigError: a label is missing, or is given for a device that tells its serial number."""
    unknown = kind.contract.known_by == "nothing"
    if unknown and not section.inventory.strip():
        raise ConfigError(
            f'{where}: a {kind.name} tells nothing by which it is known; write inventory = "LABEL", as it is labelled'
        )
    if not unknown and section.confirmed:
        raise ConfigError(f"{where}: a {kind.name} is known by what it tells; leave confirmed out")
    if not unknown and section.inventory and kind.contract.tells_serial:
        raise ConfigError(f"{where}: a {kind.name} tells its serial number; leave inventory out")


def beside(file: Path, data: dict[str, Any]) -> dict[str, Any]:
    """The content of a bench or scene file, in which the paths of map files no longer depend on its folder.

    Raises ConfigError: a path leaves the folder by `..`.
    """
    for name, table in (devices if isinstance(devices := data.get("device"), dict) else {}).items():
        if not isinstance(table, dict) or not isinstance(path := table.get("map"), str):
            continue
        if ".." in Path(path).parts:
            raise ConfigError(
                f"{file}: device.{name}: map: {path!r} leaves the folder of this file; put the map beside it, or give "
                "its whole path"
            )
        table["map"] = str(file.absolute().parent / path)
    return data


def _kind(section: _DeviceSection, where: str) -> DeviceKind:
    """Raises ConfigError, UnknownName."""
    if (section.kind is None) == (section.map is None):
        raise ConfigError(f'{where}: kind: give a device kind, as kind = "flintec-dad-141", or map = "FILE.toml"')
    return device_kind(section.kind) if section.kind is not None else kind_in_file(Path(str(section.map)))


def check_places(links: Mapping[str, Link], devices: Sequence[Listed]) -> None:
    """Raises ConfigError: two devices have the same name or address, two links are one line, or one has no device."""
    by_place: dict[tuple[str, int], str] = {}
    _check_alone(links)
    names: set[str] = set()
    for each in devices:
        if each.name in names:
            raise ConfigError(f"device.{each.name}: the bench has a device of that name; give another")
        place = (each.link, each.unit)
        if place in by_place:
            raise ConfigError(
                f"{by_place[place]} and {each.name} both have the address {each.unit} on {each.link}; correct one"
            )
        names.add(each.name)
        by_place[place] = each.name
    for name, link in links.items():
        _check_factory(name, [each for each in devices if each.link == name])
        if isinstance(link, CanBus):
            _check_identifiers(name, [each for each in devices if each.link == name])
    if idle := [name for name in links if name not in {each.link for each in devices}]:
        raise ConfigError(f"link.{idle[0]}: no device is on it; leave it out, or list one")


def _check_factory(link: str, devices: Sequence[Listed]) -> None:
    """Raises ConfigError: two devices on a link leave the factory with settings that one link cannot have."""
    known: dict[str, tuple[str, object]] = {}
    for each in devices:
        line = None if each.kind.map is None or each.set_to_link else each.kind.map.line
        for key in OF_LINK:
            value = getattr(line, key, None)
            if value is None:
                continue
            other, before = known.setdefault(key, (each.name, value))
            if value != before:
                raise ConfigError(
                    f"link.{link}: {other} has {key} = {before!r} and {each.name} has {key} = {value!r} as they leave "
                    "the factory, but a link has one: set a device to the link's and write set_to_link = true in its "
                    "section, or give it a link of its own"
                )


def _check_alone(links: Mapping[str, Link]) -> None:
    """Raises ConfigError: two links have the same address, which can take one connection at a time."""
    first: dict[tuple[object, ...], str] = {}
    for name, link in links.items():
        place: tuple[object, ...]
        if isinstance(link, TcpLink):
            place = "TCP address", link.host.lower(), link.port
        elif isinstance(link, CanBus):
            place = "CAN bus", link.interface, link.channel
        else:
            place = "serial line", link.port
        if (other := first.setdefault(place, name)) != name:
            raise ConfigError(
                f"link.{name}: {other} is the same {place[0]}; write one [link.NAME] for both, with all devices on it"
            )


def _check_identifiers(link: str, nodes: Sequence[Listed]) -> None:
    """Raises ConfigError: two messages on a CAN bus have one identifier (COB-ID), or one that is kept for others."""
    known: dict[int, str] = {}
    for each in nodes:
        contract = each.kind.contract
        own = [(f"{what} of {each.name}", base + each.unit) for what, base in OF_A_NODE.items()]
        try:
            data = [
                (f"PDO {pdo.name} of {each.name}", pdo.cob_id(each.unit))
                for pdo in (*contract.pdos, *contract.receives)
            ]
        except ConfigError as error:
            raise ConfigError(f"{each.name} on {link}: {error}") from None
        for what, identifier in (*own, *data):
            if identifier in known:
                raise ConfigError(
                    f"{known[identifier]} and {what} have the same identifier 0x{identifier:X} on {link}; give one "
                    "device another node id, or the PDO of its contract another base"
                )
            known[identifier] = what
        for what, identifier in data:
            if identifier > LARGEST or any(identifier in kept for kept in KEPT):
                raise ConfigError(
                    f"{what} has the identifier 0x{identifier:X} on {link}, which is kept for other messages; give the "
                    "PDO of its contract another base"
                )
