"""Description of a bench: the address of each device, its settings and the bench's limits.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self, get_args

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from palpate.instrument.bench.kinds import (
    KINDS,
    AmplifierSettings,
    DeviceKind,
    IndicatorSettings,
    NoSettings,
    Role,
    check_identities,
    device_kind,
)
from palpate.instrument.bench.serial_line import FASTEST
from palpate.instrument.config import Config, check, read
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Newtons, Seconds
from palpate.instrument.sensor.designs import get_design

Unit = Annotated[int, Field(ge=1, le=247, strict=True)]
NodeId = Annotated[int, Field(ge=1, le=127, strict=True)]
Timeout = Annotated[Seconds, Field(gt=0, le=60)]
ON_TCP, ON_LINE = ("signal_generator", "shaker_amplifier", "sample_changer"), ("strain_indicator", "positioner")
LINE, CAN = "line", "can"  # sections that are links of several devices
NEEDED = ("signal_generator", "shaker_amplifier", LINE, CAN)  # where no other devices are listed
USUAL = (
    "signal_generator",
    "shaker_amplifier",
    LINE,
    CAN,
    "sample_changer",
)  # sections that say where a link is
POSITIONER_UNIT = 2
NAME = re.compile(r"[a-z][a-z0-9_-]{0,39}")
RESERVED = ("all", LINE, CAN)  # that faults strike


class TcpAddress(Config):
    """A Modbus TCP device."""

    host: str = Field(min_length=1)
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    unit: Unit = 1
    timeout: Timeout = 1.0


class TcpLink(Config):
    """Where one or more Modbus units answer on TCP: a device, or a gateway."""

    host: str = Field(min_length=1)
    port: int = Field(default=502, ge=1, le=65535, strict=True)
    timeout: Timeout = 1.0


class Amplifier(AmplifierSettings, TcpAddress):
    """The shaker amplifier."""


class SerialLine(Config):
    """The Modbus RTU line that strain indicator and positioner share."""

    port: str = Field(min_length=1)
    baudrate: int = Field(default=115200, ge=1200, le=FASTEST, strict=True)
    parity: Annotated[str, Field(pattern="^[NEO]$")] = "N"
    stopbits: int = Field(default=1, ge=1, le=2, strict=True)
    timeout: Timeout = 1.0


class RtuAddress(Config):
    """A unit on the serial line."""

    unit: Unit


class Indicator(IndicatorSettings, RtuAddress):
    """The strain indicator."""

    unit: Unit = 1


class CanLink(Config):
    """A CAN bus."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000, strict=True)
    timeout: Timeout = 1.0


class CanBus(Config):
    """The CAN bus and the sensor nodes on it; the first node produces SYNC."""

    interface: str = Field(min_length=1)
    channel: str
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000, strict=True)
    nodes: tuple[NodeId, ...] = Field(min_length=1, max_length=20)
    timeout: Timeout = 1.0

    @field_validator("nodes")
    @classmethod
    def _distinct(cls, nodes: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(nodes)) != len(nodes):
            raise ValueError(f"node ids {list(nodes)} repeat; each node needs its own")
        return nodes


Link = TcpLink | SerialLine | CanLink
LINKS: dict[str, type[Link]] = {"modbus-tcp": TcpLink, "modbus-rtu": SerialLine, "canopen": CanLink}


class _Section(Config):
    """What every `[device.NAME]` says; the rest are settings of its kind."""

    kind: str
    link: str
    unit: Unit | None = None  # on Modbus
    node: NodeId | None = None  # on CANopen
    role: Role | None = None
    optional: bool = False


@dataclass(frozen=True)
class Listed:
    """A device of a bench.

    Attributes:
        name: of its section; a sensor node is called by its place in the list of nodes.
        link: name of the link that it is on.
        unit: or node id, by which it is asked there.
        role: for which it was chosen where several devices could fill it.
        optional: a bench without it can be used as well.
    """

    name: str
    kind: DeviceKind
    link: str
    unit: int
    settings: Any
    role: Role | None = None
    optional: bool = False


class BenchDescription(Config):
    """A whole bench file: the sections of the usual devices, and of any others `[link.NAME]` and `[device.NAME]`."""

    name: str
    design: str = "single"
    force_limit: Newtons = Field(default=10.0, gt=0)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)
    # of the load: what a film's moving cable adds to its force in step with the drive, at most; 0: nothing is known
    pickup: float = Field(default=0.0, ge=0, le=0.5, strict=True)
    signal_generator: TcpAddress | None = None
    shaker_amplifier: Amplifier | None = None
    line: SerialLine | None = None
    strain_indicator: Indicator | None = None  # with a line, both of its devices are there
    positioner: RtuAddress | None = None
    can: CanBus | None = None
    sample_changer: TcpAddress | None = None  # without one a person mounts the samples
    link: dict[str, dict[str, Any]] | None = None
    device: dict[str, dict[str, Any]] | None = None

    @field_validator("design")
    @classmethod
    def _known(cls, design: str) -> str:
        try:
            return get_design(design).name
        except UnknownName as error:
            raise ValueError(str(error)) from None

    @model_validator(mode="before")
    @classmethod
    def _completed(cls, data: Any) -> Any:
        if not isinstance(data, dict) or data.get("line") is None:
            return data
        return {"strain_indicator": {}, "positioner": {"unit": POSITIONER_UNIT}} | data

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Raises ValueError."""
        try:
            missing = [name for name in NEEDED if getattr(self, name) is None] if self.device is None else []
            problems = [f"{name}: is missing" for name in missing]
            if self.line is None:
                problems += [f"line: is missing, which {name} is on" for name in ON_LINE if getattr(self, name)]
            if problems:
                raise ConfigError("\n".join(problems))
            _check_places(self.links, self.devices)
            check_identities(each.kind for each in self.devices)
            for role in get_args(Role):
                if role != "sensor_node" and len(several := self.filling(role)) > 1:
                    names = " and ".join(each.name for each in several)
                    raise ConfigError(f'{names} can each be the {role}; write role = "{role}" below one of them')
        except (ConfigError, UnknownName) as error:
            raise ValueError(str(error)) from None
        return self

    @model_serializer(mode="wrap")
    def _written(self, usual: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A bench of the usual devices as it was written before there were others."""
        data: dict[str, Any] = usual(self)
        return {key: value for key, value in data.items() if value is not None or key not in ("link", "device")}

    @property
    def links(self) -> dict[str, Link]:
        """The links by name, each usual one by that of its section."""
        found: dict[str, Link] = {}
        for name in USUAL:
            place = getattr(self, name)
            if place is not None:
                model = LINKS["canopen" if name == CAN else "modbus-rtu" if name == LINE else "modbus-tcp"]
                found[name] = model.model_construct(**{key: getattr(place, key) for key in model.model_fields})
        for name, table in (self.link or {}).items():
            if name in found:
                raise ConfigError(f"link.{name}: [{name}] is a link of that name; give another")
            found[name] = _link(dict(table), f"link.{name}")
        return found

    @property
    def devices(self) -> list[Listed]:
        """The devices: the usual kinds in the order of `KINDS`, then the others in that of the file."""
        found = [
            Listed(name, KINDS[name], LINE if name in ON_LINE else name, place.unit, _settings(KINDS[name], place))
            for name in (*ON_TCP, *ON_LINE)
            if (place := getattr(self, name)) is not None
        ]
        node = KINDS["sensor_node"]
        for number, node_id in enumerate(self.can.nodes if self.can is not None else (), 1):
            found.append(Listed(f"{node.name}_{number}", node, CAN, node_id, NoSettings()))
        for name, table in (self.device or {}).items():
            found.append(_listed(name, dict(table), self.links))
        order = list(KINDS)
        return sorted(found, key=lambda each: order.index(each.kind.name) if each.kind.name in order else len(order))

    @property
    def contracts(self) -> list[Contract]:
        """Contracts of the devices whose kinds are of other packages, by name."""
        kinds = {each.kind.name: each.kind for each in self.devices if each.kind.name not in KINDS}
        return [kinds[name].contract for name in sorted(kinds)]

    def filling(self, role: Role) -> list[Listed]:
        """The devices that fill a role: those that say so, or else all whose kind can."""
        able = [each for each in self.devices if role in each.kind.roles and each.role in (None, role)]
        return [each for each in able if each.role == role] or able

    def moved(self, places: Mapping[str, Mapping[str, Any]]) -> Self:
        """The same bench with other addresses of links, by their names."""
        sections = {
            name: getattr(self, name).model_copy(update=place) for name, place in places.items() if name in USUAL
        }
        tables = {name: {**table, **places.get(name, {})} for name, table in (self.link or {}).items()}
        return self.model_copy(update={**sections, "link": tables or None})

    def to_toml(self) -> str:
        """The bench file that reads back as this description."""
        import tomli_w

        data: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return tomli_w.dumps(data)


def check_name(name: str, where: str) -> None:
    """Raises ConfigError: a device cannot be called so."""
    if not NAME.fullmatch(name) or name in RESERVED:
        raise ConfigError(
            f"{where}: {name!r} is no name of a device: give small letters, digits, _ and -, such as oven_2"
        )


def _link(table: dict[str, Any], where: str) -> Link:
    kind = table.pop("kind", None)
    if kind not in LINKS:
        raise ConfigError(f"{where}: kind: {kind!r} is no kind of link; valid: {', '.join(LINKS)}")
    return check(table, LINKS[kind], where)


def _settings(kind: DeviceKind, place: Config) -> Config:
    """What a section says for its kind; it is checked already."""
    return kind.settings.model_construct(**{name: getattr(place, name) for name in kind.settings.model_fields})


def _listed(name: str, table: dict[str, Any], links: Mapping[str, Link]) -> Listed:
    """A `[device.NAME]`, checked. Raises ConfigError, UnknownName."""
    where = f"device.{name}"
    check_name(name, where)
    own = {key: table.pop(key) for key in _Section.model_fields if key in table}
    section = check(own, _Section, where)
    try:
        kind = device_kind(section.kind)
        if section.link not in links:
            raise UnknownName("link", section.link, links)
        if section.role is not None and section.role not in kind.roles:
            raise UnknownName(f"role of a {kind.name}", section.role, kind.roles)
    except UnknownName as error:
        raise ConfigError(f"{where}: {error}") from None
    link = links[section.link]
    if not any(isinstance(link, LINKS[each]) for each in kind.links):
        raise ConfigError(
            f"{where}: link: a {kind.name} is reached over {' or '.join(kind.links)}, {section.link} is another"
        )
    key, other = ("node", "unit") if isinstance(link, CanLink) else ("unit", "node")
    if getattr(section, key) is None or getattr(section, other) is not None:
        raise ConfigError(f"{where}: on link {section.link} a device has a {key}, and no {other}; give {key} = NUMBER")
    unit: int = getattr(section, key)
    settings = check(table, kind.settings, where)
    return Listed(name, kind, section.link, unit, settings, section.role, section.optional)


def _check_places(links: Mapping[str, Link], devices: Sequence[Listed]) -> None:
    """Raises ConfigError: two devices have one name or one place, or a link has none."""
    by_place: dict[tuple[str, int], str] = {}
    names: set[str] = set()
    for each in devices:
        if each.name in names:
            raise ConfigError(f"device.{each.name}: the bench has a device of that name; give another")
        place = (each.link, each.unit)
        if place in by_place:
            raise ConfigError(
                f"{by_place[place]} and {each.name} are both number {each.unit} on {each.link}; correct one"
            )
        names.add(each.name)
        by_place[place] = each.name
    if idle := [name for name in links if name not in {each.link for each in devices}]:
        raise ConfigError(f"link.{idle[0]}: no device is on it; leave it out, or list one")


def read_bench(path: Path) -> BenchDescription:
    """Read a bench file. Raises ConfigError."""
    return read(path, BenchDescription)
