"""Device kinds that a bench file may list: palpate's own, then those of installed packages.

A package adds a kind by an entry point of the group `palpate.devices`:

[project.entry-points."palpate.devices"]
acme-oven = "acme_oven:KIND"
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from palpate.instrument.additions import additions, check_ours, find, unusable
from palpate.instrument.config import Config
from palpate.instrument.contracts import CONTRACTS
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.sensor_node import CHANNELS
from palpate.instrument.errors import ConfigError
from palpate.instrument.quantity import Amperes, Volts

GROUP, WHAT = "palpate.devices", "kind of device"
LinkKind = Literal["modbus-tcp", "modbus-rtu", "canopen"]

Role = Literal[
    "source", "amplifier", "exciter", "load_indicator", "positioner", "sensor_node", "sample_changer", "chamber",
    "probe_stage",
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

    @property
    def name(self) -> str:
        return self.contract.name


class AmplifierSettings(Config):
    """Settings of the shaker amplifier; `watchdog_fed_by`: who feeds its watchdog, only its owner or any request."""

    watchdog_fed_by: Literal["owner", "any request"] = "owner"
    gain: float = Field(default=2.0, ge=0, le=20, strict=True)  # V/V [A]
    current_limit: Amperes = Field(default=5.0, ge=0.1, le=6)  # peak [A]


class IndicatorSettings(Config):
    """Settings of the strain indicator."""

    gage_factor: float = Field(default=8.98, ge=0.5, le=20, strict=True)  # [T]
    full_scale: Volts = Field(default=0.2, ge=0.01, le=30)  # reading above which overload is flagged [A]


def _own(contract: str, link: LinkKind, classes: str, role: Role, settings: type[Config] = NoSettings) -> DeviceKind:
    """One of palpate's own kinds, whose driver and simulator have the same class name."""
    driver, simulator = (f"palpate.{layer}.devices.{contract}:{classes}" for layer in ("drivers", "simulators"))
    return DeviceKind(CONTRACTS[contract], (link,), driver, simulator, settings, (role,))


KINDS: dict[str, DeviceKind] = {
    kind.name: kind
    for kind in (
        replace(
            _own("signal_generator", "modbus-tcp", "SignalGenerator", "source"),
            frequency_step=CONTRACTS["signal_generator"]["frequency"].scale,
        ),
        _own("shaker_amplifier", "modbus-tcp", "ShakerAmplifier", "amplifier", AmplifierSettings),
        _own("strain_indicator", "modbus-rtu", "StrainIndicator", "load_indicator", IndicatorSettings),
        replace(
            _own("positioner", "modbus-rtu", "Positioner", "positioner"),
            travel=CONTRACTS["positioner"]["target"].maximum,
        ),
        _own("sensor_node", "canopen", "SensorNode", "sensor_node"),
        _own("sample_changer", "modbus-tcp", "SampleChanger", "sample_changer"),
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
    found, kind = find(GROUP, WHAT, name, KINDS)
    if not isinstance(kind, DeviceKind) or kind.name != name:
        raise unusable(found, WHAT, f"is no DeviceKind whose contract is called {name!r}")
    check_identities([*KINDS.values(), kind])
    return kind


def all_kinds() -> list[DeviceKind]:
    """All kinds: palpate's own, then those of installed packages by name.

    Raises ConfigError: a kind cannot be used, or two kinds have the same name or the same identity.
    """
    check_ours(GROUP, WHAT, KINDS)
    found = [*KINDS.values(), *(device_kind(name) for name in additions(GROUP))]
    check_identities(found)
    return found


def check_identities(kinds: Iterable[DeviceKind]) -> None:
    """Raises ConfigError: two kinds have the same identity on the wire, so that no driver can tell them apart."""
    known: dict[tuple[str, ...], str] = {}
    for kind in kinds:
        identity = kind.contract.identity
        alike = (kind.contract.bus, identity.vendor, identity.product)
        if known.setdefault(alike, kind.name) != kind.name:
            raise ConfigError(
                f"kinds of device {known[alike]!r} and {kind.name!r} both identify themselves as {identity.vendor} "
                f"{identity.product}; give one another product in its contract"
            )
