"""Description of a bench: the address of each device, its settings and the bench's limits.

A simulated bench differs from a real one only in the addresses of this description.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar, get_args

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_serializer,
    model_validator,
)

from palpate.instrument.bench.kinds import KINDS, DeviceKind, Role, check_identities
from palpate.instrument.bench.links import KIND_OF, Link, link_of
from palpate.instrument.bench.listed import Listed, beside, check_places, filling, listed
from palpate.instrument.bench.older_form import older_sections, renewed
from palpate.instrument.bench.patience import impatient, longest
from palpate.instrument.config import Config, check, parse_data, read_data
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Newtons, Seconds, VoltsPerRootHertz, show
from palpate.instrument.sensor.designs import get_design

T = TypeVar("T")
NO_WATCHDOG = "none"
STOOD = 20.0  # N [A]; the load cell gives the indicator's 200 mV at 19 N, and the thesis loads nothing above 7.3 N
DRIVING: tuple[Role, ...] = ("exciter", "source", "amplifier")


class BenchDescription(Config):
    """A whole bench file: its limits, its links `[link.NAME]`, and the devices `[device.NAME]` on them."""

    file: ClassVar[str] = "bench"

    name: str
    design: str = "single"
    force_limit: Newtons = Field(default=10.0, gt=0)
    # force that its load cell, sensor and samples stand, where they stand more than `STOOD`; None: not known
    withstands: Newtons | None = Field(default=None, gt=STOOD, le=1000)
    watchdog: Seconds = Field(default=2.0, ge=0.1, le=60)  # infinite ("none" in the file): the exciter has no watchdog
    # greatest force that a film's moving cable adds in step with the drive, as a share of the load; 0: unknown
    pickup: float = Field(default=0.0, ge=0, le=0.5, strict=True)
    # amplitude density of the films' noise near the drive, by which dwells are planned; None: the usual one is assumed
    noise: VoltsPerRootHertz | None = Field(default=None, gt=0, le=0.1)
    scene: str | None = Field(default=None, min_length=1)  # identity of the scene that simulates it; palpate writes it
    simulated: bool = False  # whether it is simulated although no device on it says so, as twins of makers' devices
    link: dict[str, dict[str, Any]]
    device: dict[str, dict[str, Any]]

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

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Raises ValueError."""
        try:
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
            data.pop("simulated", None)  # `comparison` leaves it out
        if self.withstands is None:
            data.pop("withstands", None)
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
    bench = check(beside(path, data), BenchDescription, str(path))
    if problems := bench.unsafe():
        raise ConfigError("\n".join(f"{path}: {problem}" for problem in problems))
    return bench


def recorded_bench(text: str, where: str) -> BenchDescription:
    """The bench of a run or log, which may be in the older form. Raises ConfigError as `read_bench`, with `where`."""
    return check(renewed(parse_data(text.encode(), where)), BenchDescription, where)
