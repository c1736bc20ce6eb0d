"""Kinds of devices that a bench may list: those of this package, then those of packages that are installed beside it.

A package adds a kind by an entry point of the group `palpate.devices`:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"
"""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Any, Literal

from pydantic import Field

from palpate.instrument.config import Config
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Amperes, Volts

GROUP = "palpate.devices"
LinkKind = Literal["modbus-tcp", "modbus-rtu", "canopen"]

Role = Literal[
    "source", "amplifier", "exciter", "load_indicator", "positioner", "sensor_node", "sample_changer", "chamber",
    "probe_stage",
]  # fmt: skip


class NoSettings(Config):
    """A kind without settings of its own."""


@dataclass(frozen=True)
class DeviceKind:
    """What the bench has to know of a device, whoever wrote it.

    Attributes:
        contract: its registers or objects; the kind has the contract's name.
        links: over which it can be reached, the usual one first.
        driver: "module:Class" of a `palpate.drivers.devices.device.Device`.
        simulator: "module:Class" of what stands in for it; None: no simulated bench can have it.
        settings: what its section in a bench file may say beside where it is.
        roles: what procedures can use it as; see `palpate.drivers.roles`.
    """

    contract: Contract
    links: tuple[LinkKind, ...]
    driver: str
    simulator: str | None = None
    settings: type[Config] = NoSettings
    roles: tuple[Role, ...] = ()

    @property
    def name(self) -> str:
        return self.contract.name


class AmplifierSettings(Config):
    """Settings of the shaker amplifier, and what feeds its watchdog: its owner alone, or any request of anybody."""

    watchdog_fed_by: Literal["owner", "any request"] = "owner"
    gain: float = Field(default=2.0, ge=0, le=20, strict=True)  # V/V [A]
    current_limit: Amperes = Field(default=5.0, ge=0.1, le=6)  # peak [A]


class IndicatorSettings(Config):
    """Settings of the strain indicator."""

    gage_factor: float = Field(default=8.98, ge=0.5, le=20, strict=True)  # [T]
    full_scale: Volts = Field(default=0.2, ge=0.01, le=30)  # reading above which overload is flagged [A]


def _own(contract: str, link: LinkKind, classes: str, role: Role, settings: type[Config] = NoSettings) -> DeviceKind:
    """A kind of this package: its driver and its simulator are called the same."""
    driver, simulator = (f"palpate.{layer}.devices.{contract}:{classes}" for layer in ("drivers", "simulators"))
    return DeviceKind(CONTRACTS[contract], (link,), driver, simulator, settings, (role,))


KINDS: dict[str, DeviceKind] = {
    kind.name: kind
    for kind in (
        _own("signal_generator", "modbus-tcp", "SignalGenerator", "source"),
        _own("shaker_amplifier", "modbus-tcp", "ShakerAmplifier", "amplifier", AmplifierSettings),
        _own("strain_indicator", "modbus-rtu", "StrainIndicator", "load_indicator", IndicatorSettings),
        _own("positioner", "modbus-rtu", "Positioner", "positioner"),
        _own("sensor_node", "canopen", "SensorNode", "sensor_node"),
        _own("sample_changer", "modbus-tcp", "SampleChanger", "sample_changer"),
    )
}


def device_kind(name: str) -> DeviceKind:
    """A kind by its name.

    Raises:
        UnknownName: there is none of that name. ConfigError: an installed package's kinds cannot be used.
    """
    if name in KINDS:
        return KINDS[name]
    outside = outside_kinds()
    if name not in outside:
        raise UnknownName("kind of device", name, (*KINDS, *outside))
    return outside[name]


def all_kinds() -> list[DeviceKind]:
    """This package's kinds, then those of installed packages, by name. Raises ConfigError as `device_kind`."""
    return [*KINDS.values(), *outside_kinds().values()]


@cache
def outside_kinds() -> Mapping[str, DeviceKind]:
    """Kinds of installed packages by name, in the order of names.

    Raises ConfigError: one cannot be loaded or is no kind, a name stands twice, or two identify themselves alike, so
    that a driver could not tell which of them answers.
    """
    entries = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    twice = [name for name, count in Counter([*KINDS, *(entry.name for entry in entries)]).items() if count > 1]
    if twice:
        raise ConfigError(f"kind of device {twice[0]!r}: two packages have it; uninstall one, or give it another name")
    found = {entry.name: _loaded(entry.name, entry.value) for entry in entries}
    known: dict[tuple[str, ...], str] = {}
    for kind in (*KINDS.values(), *found.values()):
        identity = kind.contract.identity
        alike = (kind.contract.bus, identity.vendor, identity.product)
        if alike in known:
            raise ConfigError(
                f"kinds of device {known[alike]!r} and {kind.name!r} both identify themselves as {identity.vendor} "
                f"{identity.product}; give one another product in its contract"
            )
        known[alike] = kind.name
    return found


def _loaded(name: str, value: str) -> DeviceKind:
    where = f"kind of device {name!r} ({value})"
    try:
        kind = load(value)
    except Exception as error:  # whatever a package does when it is imported
        raise ConfigError(f"{where}: cannot be loaded: {error}; mend its package, or uninstall it") from error
    if not isinstance(kind, DeviceKind) or kind.name != name:
        raise ConfigError(f"{where}: is no DeviceKind whose contract is called {name!r}; mend its package")
    return kind


def load(reference: str) -> Any:
    """What stands at "module:name". Raises ImportError, AttributeError."""
    module, _, name = reference.partition(":")
    return getattr(importlib.import_module(module), name)
