"""Description of a bench: the address of each device, its settings and the bench's limits.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self, get_args

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from palpate.instrument.bench.kinds import KINDS, DeviceKind, NoSettings, Role, check_identities
from palpate.instrument.bench.links import LINKS, Link, SerialLine, link_of
from palpate.instrument.bench.listed import Listed, beside, check_places, filling, listed
from palpate.instrument.bench.usual import (
    CAN,
    LINE,
    LINKING,
    NEEDED,
    ON_LINE,
    ON_TCP,
    POSITIONER_UNIT,
    Amplifier,
    CanBus,
    Indicator,
    RtuAddress,
    TcpAddress,
)
from palpate.instrument.config import Config, check, read_data
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Newtons, Seconds, VoltsPerRootHertz
from palpate.instrument.sensor.designs import get_design

NO_WATCHDOG = "none"
DRIVING: tuple[Role, ...] = ("exciter", "source", "amplifier")


class BenchDescription(Config):
    """A whole bench file: the sections of the usual devices, and of any others `[link.NAME]` and `[device.NAME]`."""

    file: ClassVar[str] = "bench"

    name: str
    design: str = "single"
    force_limit: Newtons = Field(default=10.0, gt=0)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)  # infinite ("none" in the file): the exciter has no watchdog
    # greatest force that a film's moving cable adds in step with the drive, as a share of the load; 0: unknown
    pickup: float = Field(default=0.0, ge=0, le=0.5, strict=True)
    # amplitude density of the films' noise near the drive, by which dwells are planned; None: the usual one is assumed
    noise: VoltsPerRootHertz | None = Field(default=None, gt=0, le=0.1)
    signal_generator: TcpAddress | None = None
    shaker_amplifier: Amplifier | None = None
    line: SerialLine | None = None
    strain_indicator: Indicator | None = None  # present, like the positioner, if there is a line
    positioner: RtuAddress | None = None
    can: CanBus | None = None
    sample_changer: TcpAddress | None = None  # None: a person mounts the samples
    simulated: bool = False  # whether it is simulated although no device on it says so, as twins of makers' devices
    link: dict[str, dict[str, Any]] | None = None
    device: dict[str, dict[str, Any]] | None = None

    @field_validator("design")
    @classmethod
    def _known(cls, design: str) -> str:
        try:
            return get_design(design).name
        except (ConfigError, UnknownName) as error:
            raise ValueError(str(error)) from None

    @field_validator("watchdog", mode="wrap")
    @classmethod
    def _or_none(cls, watchdog: Any, seconds: ValidatorFunctionWrapHandler) -> Any:
        return math.inf if watchdog == NO_WATCHDOG else seconds(watchdog)

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
            devices = self.devices
            check_places(self.links, devices)
            check_identities(each.kind for each in devices)
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
        driving = exciter or (source and amplifier and [*amplifier, *source])
        if not driving:
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

    @model_serializer(mode="wrap")
    def _written(self, usual: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out empty tables, so that a bench of the usual devices is written in the older form."""
        data: dict[str, Any] = usual(self)
        if self.unguarded:
            data["watchdog"] = NO_WATCHDOG
        if not self.simulated:
            data.pop("simulated", None)  # `comparison` leaves it out
        return {key: value for key, value in data.items() if value is not None or key not in ("link", "device")}

    @property
    def unguarded(self) -> bool:
        """Whether no watchdog switches the exciter off when this program is killed."""
        return math.isinf(self.watchdog)

    @property
    def links(self) -> dict[str, Link]:
        """The links by name; a usual link has the name of its section."""
        found: dict[str, Link] = {}
        for name, kind in LINKING.items():
            place = getattr(self, name)
            if place is not None:
                model = LINKS[kind]
                found[name] = model.model_construct(**{key: getattr(place, key) for key in model.model_fields})
        for name, table in (self.link or {}).items():
            if name in found:
                raise ConfigError(f"link.{name}: [{name}] is a link of that name; give another")
            found[name] = link_of(dict(table), f"link.{name}")
        return found

    @property
    def devices(self) -> list[Listed]:
        """The devices: the usual kinds in the order of `KINDS`, then the others in the order of the file."""
        found = [
            Listed(name, KINDS[name], LINE if name in ON_LINE else name, place.unit, _settings(KINDS[name], place))
            for name in (*ON_TCP, *ON_LINE)
            if (place := getattr(self, name)) is not None
        ]
        node = KINDS["sensor_node"]
        for number, node_id in enumerate(self.can.nodes if self.can is not None else (), 1):
            found.append(Listed(f"{node.name}_{number}", node, CAN, node_id, NoSettings()))
        links = self.links
        problems = []
        for name, table in (self.device or {}).items():
            try:
                found.append(listed(name, dict(table), links))
            except (ConfigError, UnknownName) as error:
                problems.append(str(error))
        if problems:
            raise ConfigError("\n".join(problems))
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
        tables = {name: {**table, **places.get(name, {})} for name, table in (self.link or {}).items()}
        sections = {
            name: getattr(self, name).model_copy(update=place) for name, place in places.items() if name not in tables
        }
        return self.model_copy(update={**sections, "link": tables or None})

    def to_toml(self) -> str:
        """The bench file that reads back as this description."""
        import tomli_w

        data: dict[str, Any] = self.model_dump(mode="json", exclude_none=True)
        return tomli_w.dumps(data)


def _settings(kind: DeviceKind, place: Config) -> Config:
    """The settings of a kind, from its checked section."""
    return kind.settings.model_construct(**{name: getattr(place, name) for name in kind.settings.model_fields})


def read_bench(path: Path) -> BenchDescription:
    """Read a bench file. Raises ConfigError."""
    return check(beside(path, read_data(path)), BenchDescription, str(path))
