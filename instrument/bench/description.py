"""Description of a bench: the address of each device, its settings and the bench's limits.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeVar, get_args

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from palpate.instrument.bench.kinds import KINDS, DeviceKind, Role, check_identities, device_kind, kind_in_file
from palpate.instrument.bench.links import CAN, KIND_OF, LINE, LINKS, CanBus, Link, TcpLink, link_of
from palpate.instrument.config import Config, Name, check, parse_data, read_data
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.declaration import ITSELF, KEPT, LARGEST, OF_A_NODE
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Newtons, Seconds, VoltsPerRootHertz, counted, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design

if TYPE_CHECKING:
    from palpate.instrument.contracts.contract import Contract


# --- what is read beside each point --------------------------------------------------------------------

# [beside.room]                 # in a bench or scene file
# device = "thermometer"        # its section: [device.thermometer]
# field = "temperature"         # of the device's contract
# unit = "degC"                 # that of the contract, so that no other is taken for it
# u = 0.3                       # standard uncertainty of a reading, in that unit
# low = 18.0
# high = 28.0
# outside = "invalidate"        # the point is not used; "mark" (the default) only marks it
# every = "60 s"                # a reading serves all points of so long a time; without it each point has its own


COLUMNS = "beside_"  # begins the names of values in records
KEY = re.compile(r"[a-z][a-z0-9_]{0,39}")
Number = Annotated[float, Field(strict=True)]


class Beside(Config):
    """A `[beside.NAME]` table; its numbers are in `unit`."""

    device: Name
    field: Name
    unit: str = ""
    u: Number | None = Field(default=None, ge=0)
    low: Number | None = None
    high: Number | None = None
    outside: Literal["mark", "invalidate"] = "mark"
    every: Seconds | None = Field(default=None, gt=0)

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low = {self.low:g} is not below high = {self.high:g}; exchange them")
        if self.outside == "invalidate" and self.low is None and self.high is None:
            raise ValueError('outside = "invalidate" needs a limit; give low, high or both')
        return self

    def column(self, name: str) -> str:
        """Name of the value in records, as beside_room_degC; that of its standard uncertainty has _u behind it."""
        unit = re.sub(r"[^A-Za-z0-9]+", "_", self.unit).strip("_")
        return COLUMNS + "_".join(part for part in (name, unit) if part)

    def columns(self, name: str) -> list[str]:
        """The names of all its values in records."""
        own = self.column(name)
        return [own] if self.u is None else [own, f"{own}_u"]

    def limits(self) -> str:
        """The limits for people."""
        unit = f" {self.unit}" if self.unit else ""
        if self.low is None:
            return f"at most {self.high:g}{unit}"
        return f"at least {self.low:g}{unit}" if self.high is None else f"{self.low:g} to {self.high:g}{unit}"

    def holds(self, value: float) -> bool:
        """Whether a value is within the limits."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)


def check_beside(asked: Mapping[str, Beside], contracts: Mapping[str, Contract]) -> None:
    """Check what is asked for beside each point against the contracts of a bench's devices, by their names.

    Raises ConfigError: a name cannot be one, there is no such device, field or unit, or two would have one column.
    """
    owners: dict[str, str] = {}
    for name, given in asked.items():
        where = f"beside.{name}"
        if not KEY.fullmatch(name):
            raise ConfigError(f"{where}: {name!r} is no name; give small letters, digits and _, such as room_2")
        try:
            if given.device not in contracts:
                raise UnknownName("device of this bench", given.device, contracts)
            _check_field(given, contracts[given.device])
        except (ConfigError, UnknownName) as error:
            raise ConfigError(f"{where}: {error}") from None
        for column in given.columns(name):
            if (other := owners.setdefault(column, name)) != name:
                raise ConfigError(f"{where}: it has the column {column} of beside.{other}, too; give it another name")


def _check_field(given: Beside, contract: Contract) -> None:
    readable = {field.name: field for field in contract.fields if field.access != "wo" and field.type != "text"}
    if given.field not in readable:
        raise UnknownName(f"field of {given.device} that can be read", given.field, readable)
    if (unit := readable[given.field].unit) != given.unit:
        declared = f"has the unit {unit}" if unit else "has no unit"
        raise ConfigError(
            f"unit: {given.field} of {given.device} {declared}, not {given.unit!r}; write unit = {unit!r}"
        )


# --- patience with a silent device ---------------------------------------------------------------------


READ_ATTEMPTS = 2  # attempts of a read on a bench that records incidents; else 1
WAITS = 2  # time-outs that an attempt can last: after a failed one, the link must first fall silent
PATIENCE = 20.0  # s that the driving thread may spend on a silent device, on computing, or on the disk
LONGEST = PATIENCE / (READ_ATTEMPTS * WAITS)  # s, longest time-out of a link


def longest(link: Link, guards: bool, watchdog: float) -> float:
    """The longest time-out that a link can have [s].

    Args:
        link: the link.
        guards: whether the device with the watchdog is on it.
        watchdog: time-out of the watchdog [s].
    """
    if guards and not isinstance(link, CanBus):  # what feeds a watchdog on Modbus waits for its turn on the link
        return min(watchdog / READ_ATTEMPTS, LONGEST)
    return LONGEST


def impatient(link: Link, guard: str, watchdog: float, *, guards: bool) -> str:
    """What is wrong with the time-out of a link, with the remedy; empty: nothing. `guard` has the watchdog."""
    most = longest(link, guards, watchdog)
    if link.timeout <= most:
        return ""
    waited = (READ_ATTEMPTS if most < LONGEST else READ_ATTEMPTS * WAITS) * link.timeout
    why = (
        f"and the watchdog of {guard} ({show(watchdog, 's')}) is not fed meanwhile"
        if most < LONGEST
        else f"and after {show(PATIENCE, 's')} this program counts as hanging, so that the watchdog of {guard} acts"
    )
    return (
        f"timeout = {show(link.timeout, 's')}: a device that falls silent is waited for {show(waited, 's')}, {why}; "
        f'write timeout = "{show(most, "s")}" or less'
    )


# --- The devices that a bench file lists: each with its kind, its link and its address on the link -----

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
        settings = {key: getattr(self, key) for key in ("role", "optional", "inventory", "confirmed", "set_to_link")}
        return {**self.kind.key, **place, **{key: value for key, value in settings.items() if value}}


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


def placed(file: Path, data: dict[str, Any]) -> dict[str, Any]:
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
    first: dict[str, tuple[str, object]] = {}
    for each in devices:
        line = None if each.kind.map is None or each.set_to_link else each.kind.map.line
        for key in OF_LINK:
            value = getattr(line, key, None)
            if value is None:
                continue
            other, before = first.setdefault(key, (each.name, value))
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
    users: dict[int, str] = {}
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
            if identifier in users:
                raise ConfigError(
                    f"{users[identifier]} and {what} have the same identifier 0x{identifier:X} on {link}; give one "
                    "device another node id, or the PDO of its contract another base"
                )
            users[identifier] = what
        for what, identifier in data:
            if identifier > LARGEST or any(identifier in kept for kept in KEPT):
                raise ConfigError(
                    f"{what} has the identifier 0x{identifier:X} on {link}, which is kept for other messages; give the "
                    "PDO of its contract another base"
                )


# -------------------------------------------------------------------------------------------------------
# The form of bench files before `[link.NAME]` and `[device.NAME]`, in which older runs and logs were recorded

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


# --- the description -----------------------------------------------------------------------------------

T = TypeVar("T")
LoadChannel = Annotated[int, Field(ge=1, le=1000, strict=True)]
NO_WATCHDOG = "none"
STOOD = 20.0  # N [A]; the load cell gives the indicator's 200 mV at 19 N, and the thesis loads nothing above 7.3 N
DRIVING: tuple[Role, ...] = ("exciter", "source", "amplifier")


class BenchDescription(Config):
    """A whole bench file: its limits, its links `[link.NAME]`, and the devices `[device.NAME]` on them."""

    file: ClassVar[str] = "bench"

    name: str = Field(description='the name of the bench, as name = "corner bench"')
    design: str = "single"
    force_limit: Newtons = Field(default=10.0, gt=0)
    # force that its load cell, sensor and samples stand, where they stand more than `STOOD`; None: not known
    withstands: Newtons | None = Field(default=None, gt=STOOD, le=1000)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)  # infinite ("none" in the file): the exciter has no watchdog
    # greatest force that a film's moving cable adds in step with the drive, as a share of the load; 0: unknown
    pickup: float = Field(default=0.0, ge=0, le=0.5, strict=True)
    # amplitude density of the films' noise near the drive, by which dwells are planned; None: the usual one is assumed
    noise: VoltsPerRootHertz | None = Field(default=None, gt=0, le=0.1)
    # free channel of the nodes, counted as films' channels, that samples the load indicator's output; None: none does
    load_channel: LoadChannel | None = None
    scene: str | None = Field(default=None, min_length=1)  # identity of the scene that simulates it; palpate writes it
    simulated: bool = False  # whether it is simulated although no device on it says so, as twins of makers' devices
    link: dict[str, dict[str, Any]] = Field(description="a section [link.NAME] for each connection")
    device: dict[str, dict[str, Any]] = Field(description="a section [device.NAME] for each device")
    beside: dict[str, Beside] = Field(default_factory=dict)  # what is read beside each point

    @field_validator("design")
    @classmethod
    def _known_design(cls, design: str) -> str:
        try:
            return get_design(design).name
        except (ConfigError, UnknownName) as error:
            raise ValueError(str(error)) from None

    @field_validator("watchdog", mode="wrap")
    @classmethod
    def _or_none(cls, watchdog: Any, seconds: ValidatorFunctionWrapHandler) -> Any:
        return math.inf if watchdog == NO_WATCHDOG else seconds(watchdog)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Raises ValueError."""
        try:
            devices = self.devices
            check_places(self.links, devices)
            check_identities(each.kind for each in devices)
            check_beside(self.beside, {each.name: each.kind.contract for each in devices})
            if self.load_channel is not None:
                nodes, indicators = (
                    [each.kind for each in self.filling(role)] for role in ("sensor_node", "load_indicator")
                )
                check_load_channel(self.load_channel, get_design(self.design), nodes, indicators)
            for role in get_args(Role):
                if role != "sensor_node" and len(several := filling(role, devices)) > 1:
                    names = " and ".join(each.name for each in several)
                    raise ConfigError(f'{names} can each be the {role}; write role = "{role}" below one of them')
            self._check_exciter(devices)
        except (ConfigError, UnknownName) as error:
            raise ValueError(str(error)) from None
        return self

    def _check_exciter(self, devices: Sequence[Listed]) -> None:
        """Raises ConfigError: two exciters are listed, or the exciter has no watchdog and the file does not say so."""
        exciter, source, amplifier = (filling(role, devices) for role in DRIVING)
        if exciter and source and amplifier:
            raise ConfigError(
                f"{exciter[0].name} drives, and {source[0].name} with {amplifier[0].name} as well; a bench has one "
                "exciter: leave the others out"
            )
        if not (driving := _driving(devices)):
            return
        for each in driving:
            if each.optional:
                raise ConfigError(
                    f"device.{each.name}: optional: what drives cannot be left out; write optional = false"
                )
        each = driving[0]
        if each.kind.contract.has("watchdog"):
            if self.unguarded:
                raise ConfigError(f'watchdog: {each.name} has one; write its time, such as "2 s"')
        elif not self.unguarded:
            raise ConfigError(
                f"watchdog: {each.name} has none, so that nothing switches it off when this program is killed or a "
                f'cable is cut; if that cannot be helped, write watchdog = "{NO_WATCHDOG}" at the top of the bench file'
            )

    def unsafe(self) -> list[str]:
        """What a bench must not be used with, each with its key and remedy: a force limit, and time-outs of links."""
        stood = self.withstands or STOOD
        strong = (
            f"force_limit: {show(self.force_limit, 'N')} is more than load cell, sensor and samples are known to stand "
            f'({show(stood, "N")}); give less, or write what those of this bench stand: withstands = "FORCE" at the top'
        )
        return [
            *([strong] if self.force_limit > stood else []),
            *(
                f"link.{name}: {wrong}"
                for name, link, guard in self._guarded()
                if (wrong := impatient(link, guard.name, self.watchdog, guards=guard.link == name))
            ),
        ]

    def patient(self) -> Self:
        """The same bench with time-outs that are short enough for the watchdog."""
        driving = {each.link for each in _driving(self.devices)}  # so that one gateway can take their place
        fit = {
            name: min(link.timeout, longest(link, name in driving, self.watchdog)) for name, link, _ in self._guarded()
        }
        return self.moved({name: {"timeout": f"{timeout} s"} for name, timeout in fit.items()})

    def _guarded(self) -> list[tuple[str, Link, Listed]]:
        """The links of a bench whose exciter has a watchdog, by name, each with the device that has it."""
        driving = [] if self.unguarded else _driving(self.devices)
        return [(name, link, driving[0]) for name, link in self.links.items()] if driving else []

    @model_serializer(mode="wrap")
    def _written(self, usual: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Write each link and device with all its keys, so that a record also has those that the file leaves out."""
        data: dict[str, Any] = usual(self)
        if self.unguarded:
            data["watchdog"] = NO_WATCHDOG
        if not self.simulated:
            data.pop("simulated", None)  # `compared` leaves it out
        for key in ("withstands", "load_channel"):
            if getattr(self, key) is None:
                data.pop(key, None)
        if not self.beside:
            data.pop("beside", None)
        if "link" in data:
            links = {name: {"kind": KIND_OF[type(link)], **_dump(link)} for name, link in self.links.items()}
            devices = {each.name: {**each.section, **_dump(each.settings)} for each in self.devices}
            data |= {"link": links, "device": devices}
        return data

    @property
    def unguarded(self) -> bool:
        """Whether no watchdog switches the exciter off when this program is killed."""
        return math.isinf(self.watchdog)

    @property
    def links(self) -> dict[str, Link]:
        """The links by name."""
        return _each(self.link, lambda name, table: link_of(table, f"link.{name}"))

    @property
    def devices(self) -> list[Listed]:
        """The devices: palpate's own kinds in the order of `KINDS`, then the others in the order of the file."""
        links = self.links
        found = _each(self.device, lambda name, table: listed(name, table, links)).values()
        order = list(KINDS)
        return sorted(found, key=lambda each: order.index(each.kind.name) if each.kind.name in order else len(order))

    @property
    def contracts(self) -> list[Contract]:
        """Contracts of the devices whose kinds come from other packages, sorted by name."""
        kinds = {each.kind.name: each.kind for each in self.devices if each.kind.name not in KINDS}
        return [kinds[name].contract for name in sorted(kinds)]

    @property
    def maps(self) -> dict[str, str]:
        """SHA-256 of the map file of each kind that is described by one, by kind."""
        return {each.kind.name: each.kind.map.sha256 for each in self.devices if each.kind.map is not None}

    def filling(self, role: Role) -> list[Listed]:
        """The devices that fill a role: those to which the file gives it or, without any, all whose kind has it."""
        return filling(role, self.devices)

    def kind_in(self, role: Role) -> DeviceKind | None:
        """Kind of the first device that fills a role; None: there is none."""
        return next((each.kind for each in self.filling(role)), None)

    def moved(self, places: Mapping[str, Mapping[str, Any]]) -> Self:
        """The same bench with other addresses of its links, by link name."""
        links = {name: {**table, **places.get(name, {})} for name, table in self.link.items()}
        return self.model_copy(update={"link": links})

    def to_toml(self) -> str:
        """The bench file that reads back as this description."""
        import tomli_w

        data: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return tomli_w.dumps(data)


def check_load_channel(
    channel: int, design: Design, nodes: Sequence[DeviceKind], indicators: Sequence[DeviceKind]
) -> None:
    """Check the channel that samples the load indicator's analogue output, by the kinds of nodes and indicators.

    Raises ConfigError: it carries a film, no node has it, or there is no load indicator.
    """
    if not indicators:
        raise ConfigError("load_channel: the bench has no load indicator, whose output it samples; leave it out")
    channels = nodes[0].channels if nodes else 0
    films = {film.channel: film.name for film in design.films}
    free = ", ".join(str(each) for each in range(1, len(nodes) * channels + 1) if each not in films)
    remedy = f"give a free one: {free}" if free else "none is free; add a sensor node"
    if channel in films:
        raise ConfigError(f"load_channel: channel {channel} carries film {films[channel]!r}; {remedy}")
    if channel > len(nodes) * channels:
        has = f"{counted(len(nodes), 'sensor node')}" + (f" of {channels} channels" if nodes else "")
        raise ConfigError(f"load_channel: the bench has no channel {channel}, but {has}; {remedy}")


def _driving(devices: Sequence[Listed]) -> list[Listed]:
    """The devices that drive, first the one that can have a watchdog; empty: none does."""
    exciter, source, amplifier = (filling(role, devices) for role in DRIVING)
    return exciter or ([*amplifier, *source] if source and amplifier else [])


def _each(tables: Mapping[str, Mapping[str, Any]], made: Callable[[str, dict[str, Any]], T]) -> dict[str, T]:
    """What is made of each table, by its name. Raises ConfigError: all that is wrong, a line for each."""
    found: dict[str, T] = {}
    problems = []
    for name, table in tables.items():
        try:
            found[name] = made(name, dict(table))
        except (ConfigError, UnknownName) as error:
            problems.append(str(error))
    if problems:
        raise ConfigError("\n".join(problems))
    return found


def _dump(table: Config) -> dict[str, Any]:
    return table.model_dump(mode="json", exclude_none=True)


def read_bench(path: Path) -> BenchDescription:
    """Read a bench file. Raises ConfigError: it is wrong, or in the older form; then the message has its new text."""
    data = read_data(path)
    if older := older_sections(data):
        import tomli_w

        raise ConfigError(
            f"{path}: has older sections: {', '.join(older)}; each link and each device has a section of its "
            f"own now. Write instead (comments are left out):\n\n{tomli_w.dumps(renewed(data))}"
        )
    bench = check(placed(path, data), BenchDescription, str(path))
    if problems := bench.unsafe():
        raise ConfigError("\n".join(f"{path}: {problem}" for problem in problems))
    return bench


def recorded_bench(text: str, where: str) -> BenchDescription:
    """The bench of a run or log, which may be in the older form. Raises ConfigError as `read_bench`, with `where`."""
    return check(renewed(parse_data(text.encode(), where)), BenchDescription, where)


# --- comparison of two bench files ---------------------------------------------------------------------


Tables = dict[str, dict[str, Any]]


def compared(before: BenchDescription, now: BenchDescription) -> tuple[dict[str, Any], dict[str, Any]]:
    """Two benches as tables that are equal where the benches are.

    If a link or a device has different names in the two files, both tables use the name of the first file.
    """
    first, second = _tables(before), _tables(now)
    links = _names(first["link"], second["link"])
    for name, device in second["device"].items():  # a changed link is recognised by the devices on it
        its_link = first["device"].get(name, device)["link"]
        if links[device["link"]] not in first["link"] and its_link not in links.values():
            links[device["link"]] = its_link
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
        alike = next((other for other, table_of_other in left.items() if table_of_other == table), None)
        if name not in first and alike is not None:
            found[name] = alike
            del left[alike]
    return found
