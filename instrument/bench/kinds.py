"""Device kinds that a bench file may list: palpate's own, those of its maps, then those of installed packages.

A package adds a kind by an entry point of the group `palpate.devices`:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import Field, create_model

from palpate.instrument.additions import additions, check_ours, find, unusable
from palpate.instrument.bench.role_maps import ROLE_MAPS, RoleMap
from palpate.instrument.config import Config, check
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.maps.golden_frames import prove
from palpate.instrument.contracts.maps.map_file import SHIPPED, DeviceMap, read_map, shipped, shipped_map
from palpate.instrument.contracts.own import CHANNELS, TRAVEL
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Amperes, Volts

# --- A kind of device: all that a bench needs in order to use such a device ----------------------------

T = TypeVar("T", bound=RoleMap)

LinkKind = Literal["modbus-tcp", "modbus-rtu", "canopen"]

Role = Literal[
    "source", "amplifier", "exciter", "load_indicator", "positioner", "sensor_node", "sample_changer", "chamber",
    "probe_stage", "bias",
]  # fmt: skip


class NoSettings(Config):
    """The settings of a kind that has none."""


@dataclass(frozen=True)
class DeviceKind:
    """A kind of device: all that a bench needs in order to use such a device.

    Attributes:
        contract: its registers or objects; the kind has the contract's name.
        links: kinds of links over which it can be reached, the usual one first.
        driver: "module:Class" of its driver, a `palpate.drivers.devices.device.Device`.
        simulator: "module:Class" of its simulator; None: simulated benches cannot have it.
        settings: keys of its section in a bench file, in addition to its address.
        roles: roles in which procedures can use it; see `palpate.drivers.roles`.
        channels: number of its channels, if it is a sensor node.
        frequency_step: step to which it rounds its frequency, if it makes the sine [Hz]; None: no setting is checked.
        travel: lowest position to which it may go, if it is a positioner [m]; None: only its driver knows.
        exchange: time in which it mounts a sample, if it is a sample changer [s]; None: it is not known.
        map: the map file that describes it; None: its package does.
        serves: for each of its roles, what of its map serves it.
        cannot: for a role that somebody could think it fills, the reason why it does not.
    """

    contract: Contract
    links: tuple[LinkKind, ...]
    driver: str
    simulator: str | None = None
    settings: type[Config] = NoSettings
    roles: tuple[Role, ...] = ()
    channels: int = CHANNELS
    frequency_step: float | None = None
    travel: float | None = None
    exchange: float | None = None
    map: DeviceMap | None = None
    serves: Mapping[str, RoleMap] = field(default_factory=dict)
    cannot: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.contract.name

    def table(self, role: type[T]) -> T:
        """What of its map serves a role, by the type of the role's table. Raises ConfigError: its map has none."""
        for each in self.serves.values():
            if isinstance(each, role):
                return each
        raise ConfigError(f"{self.name}: its map has no {role.__name__}; name a map with a table of this role")

    @property
    def digests(self) -> tuple[str, ...]:
        """SHA-256 of its map file, if it has one."""
        return () if self.map is None else (self.map.sha256,)

    @property
    def key(self) -> dict[str, str]:
        """The key by which a section of a bench file names it: `kind`, or `map` and the path of a laboratory's map."""
        shipped = self.map is None or self.map.file.parent == SHIPPED
        return {"kind": self.name} if shipped else {"map": str(self.map and self.map.file)}


# --- Device kinds made from map files, without a line of Python ----------------------------------------

# driver and simulator of a map without a role, whose fields a laboratory's own procedure reads and writes
PLAIN: dict[str, tuple[str, str | None]] = {
    "modbus": ("palpate.drivers.devices.modbus_device:ModbusDevice", None),
    "canopen": ("palpate.drivers.devices.canopen_device:CanopenDevice", None),
}


@cache
def kind_of(found: DeviceMap) -> DeviceKind:
    """The device kind that a map describes.

    Raises ConfigError: one of its frames does not fit, or the table of a role is wrong.
    """
    if problems := prove(found.contract, found.frames).problems:
        raise ConfigError("\n".join(f"{found.file}: {problem}" for problem in problems))
    served = serves(found)
    first = next(iter(served.values()), None)
    driver, simulator = PLAIN[found.contract.bus]
    if first is not None:
        driver, simulator = first.generic_driver, first.generic_simulator
    limits = {key: value for each in served.values() for key, value in each.limits(found.contract).items()}
    settings = [each.settings for each in served.values() if each.settings is not None]
    return DeviceKind(
        found.contract,
        found.links,
        driver,
        simulator,
        settings[0] if len(settings) == 1 else create_model("Settings", __base__=(*settings, NoSettings)),
        tuple(served),  # type: ignore[arg-type]  # the keys of ROLE_MAPS are roles
        **limits,
        map=found,
        serves=served,
    )


def serves(found: DeviceMap) -> dict[str, RoleMap]:
    """The checked table of each role of a map. Raises ConfigError."""
    found_for: dict[str, RoleMap] = {}
    for role, table in found.roles.items():
        where = f"{found.file}: role.{role}"
        if role not in ROLE_MAPS:
            raise ConfigError(f"{where}: {UnknownName('role of a map', role, ROLE_MAPS)}")
        found_for[role] = check(dict(table), ROLE_MAPS[role], where)
        if problems := found_for[role].wrong(found.contract):
            raise ConfigError("\n".join(f"{where}: {problem}" for problem in problems))
    return found_for


# --- all kinds by name ---------------------------------------------------------------------------------

__all__ = [
    "GROUP", "KINDS", "WHAT", "DeviceKind", "LinkKind", "NoSettings", "Role", "all_kinds", "check_identities",
    "device_kind", "frequency_step", "kind_in_file",
]  # fmt: skip
GROUP, WHAT = "palpate.devices", "kind of device"


class AmplifierSettings(Config):
    """Settings of the shaker amplifier; `watchdog_fed_by`: who feeds its watchdog, only its owner or any request."""

    watchdog_fed_by: Literal["owner", "any request"] = "owner"
    gain: float = Field(default=2.0, ge=0, le=20, strict=True)  # V/V [A]
    current_limit: Amperes = Field(default=5.0, ge=0.1, le=6)  # peak [A]


class IndicatorSettings(Config):
    """Settings of the strain indicator."""

    gage_factor: float = Field(default=8.98, ge=0.5, le=20, strict=True)  # [T]
    full_scale: Volts = Field(default=0.2, ge=0.01, le=30)  # reading above which overload is flagged [A]


def _own(
    contract: str, link: LinkKind, driver: str, simulator: str, role: Role, settings: type[Config] = NoSettings
) -> DeviceKind:
    """One of palpate's own kinds: a source and an amplifier are an exciter together, and lie in one module."""
    module = "exciter" if role in ("source", "amplifier") else role
    driver = f"palpate.drivers.devices.{module}:{driver}"
    simulator = f"palpate.simulators.devices.{module}:{simulator}"
    return DeviceKind(CONTRACTS[contract], (link,), driver, simulator, settings, (role,))


KINDS: dict[str, DeviceKind] = {
    kind.name: kind
    for kind in (
        replace(
            _own("signal_generator", "modbus-tcp", "SignalGenerator", "SimulatedSignalGenerator", "source"),
            frequency_step=CONTRACTS["signal_generator"]["frequency"].scale,
        ),
        _own(
            "shaker_amplifier",
            "modbus-tcp",
            "ShakerAmplifier",
            "SimulatedShakerAmplifier",
            "amplifier",
            AmplifierSettings,
        ),
        _own(
            "strain_indicator",
            "modbus-rtu",
            "StrainIndicator",
            "SimulatedStrainIndicator",
            "load_indicator",
            IndicatorSettings,
        ),
        replace(
            _own("positioner", "modbus-rtu", "MicroPositioner", "SimulatedPositioner", "positioner"),
            travel=CONTRACTS["positioner"]["target"].maximum,
        ),
        _own("sensor_node", "canopen", "CanopenSensorNode", "SimulatedSensorNode", "sensor_node"),
        replace(
            _own("sample_changer", "modbus-tcp", "ModbusSampleChanger", "SimulatedSampleChanger", "sample_changer"),
            exchange=TRAVEL / float(CONTRACTS["sample_changer"]["speed"].default),
        ),
    )
}


def device_kind(name: str) -> DeviceKind:
    """A device kind by its name.

    Raises:
        UnknownName: there is no kind of that name.
        ConfigError: the package that adds it cannot be used.
    """
    if name in KINDS:
        return KINDS[name]
    if (own := shipped_map(name)) is not None:
        return kind_of(own)
    found, kind = find(GROUP, WHAT, name, (*KINDS, *shipped()))
    if not isinstance(kind, DeviceKind) or kind.name != name:
        raise unusable(found, WHAT, f"is no DeviceKind whose contract is called {name!r}")
    check_identities([*KINDS.values(), kind])
    return kind


def kind_in_file(path: Path) -> DeviceKind:
    """The kind of a laboratory's map file.

    Raises ConfigError: the map is wrong, one of its frames does not fit, or it has the name of one of palpate's kinds.
    """
    found = read_map(path)
    if found.name in KINDS:
        raise ConfigError(f"{path}: device.name: {found.name!r} is a kind of palpate's own; give another name")
    return kind_of(found)


def all_kinds() -> list[DeviceKind]:
    """All kinds: palpate's own, those of its maps by name, then those of installed packages by name.

    Raises ConfigError: a kind cannot be used, or two kinds have the same name or the same identity.
    """
    check_ours(GROUP, WHAT, (*KINDS, *shipped()))
    found = [*KINDS.values(), *(device_kind(name) for name in (*shipped(), *additions(GROUP)))]
    check_identities(found)
    return found


def frequency_step(kind_in: Callable[[Role], DeviceKind | None]) -> float | None:
    """Step to which a bench rounds the frequency of a load [Hz]; None: its kinds do not say.

    `kind_in` gives the kind that fills a role.
    """
    source = kind_in("exciter") or kind_in("source")
    return source.frequency_step if source else None


def check_identities(kinds: Iterable[DeviceKind]) -> None:
    """Raises ConfigError: two kinds have the same identity on the wire, or two maps have the same name."""
    first: dict[tuple[str, ...], str] = {}
    maps: dict[str, DeviceKind] = {}
    for kind in kinds:
        other = maps.setdefault(kind.name, kind)
        if other.contract != kind.contract or other.digests != kind.digests:
            files = " and ".join(str(each.map.file) for each in (other, kind) if each.map)
            raise ConfigError(f"{files}: device.name: both are {kind.name!r}, and are not alike; give one another name")
        identity = kind.contract.identity
        alike = (kind.contract.bus, identity.vendor, identity.product)
        if first.setdefault(alike, kind.name) != kind.name:
            raise ConfigError(
                f"kinds of device {first[alike]!r} and {kind.name!r} both identify themselves as {identity.vendor} "
                f"{identity.product}; give one another product in its contract"
            )
