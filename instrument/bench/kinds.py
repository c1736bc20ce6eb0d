"""Device kinds that a bench file may list: palpate's own, those of its maps, then those of installed packages.

A package adds a kind by an entry point of the group `palpate.devices`:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pydantic import Field

from palpate.instrument.additions import additions, check_ours, find, unusable
from palpate.instrument.bench.kind import DeviceKind, LinkKind, NoSettings, Role
from palpate.instrument.bench.mapped import kind_of
from palpate.instrument.config import Config
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.maps.map_file import read_map, shipped, shipped_map
from palpate.instrument.contracts.sample_changer import TRAVEL
from palpate.instrument.errors import ConfigError
from palpate.instrument.quantity import Amperes, Volts

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
    """One of palpate's own kinds, whose driver and simulator lie in modules with the name of its contract."""
    driver = f"palpate.drivers.devices.{contract}:{driver}"
    simulator = f"palpate.simulators.devices.{contract}:{simulator}"
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
    known: dict[tuple[str, ...], str] = {}
    maps: dict[str, DeviceKind] = {}
    for kind in kinds:
        other = maps.setdefault(kind.name, kind)
        if other.contract != kind.contract or other.digests != kind.digests:
            files = " and ".join(str(each.map.file) for each in (other, kind) if each.map)
            raise ConfigError(f"{files}: device.name: both are {kind.name!r}, and are not alike; give one another name")
        identity = kind.contract.identity
        alike = (kind.contract.bus, identity.vendor, identity.product)
        if known.setdefault(alike, kind.name) != kind.name:
            raise ConfigError(
                f"kinds of device {known[alike]!r} and {kind.name!r} both identify themselves as {identity.vendor} "
                f"{identity.product}; give one another product in its contract"
            )
