"""A kind of device: all that a bench needs in order to use such a device."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeVar

from palpate.instrument.bench.role_maps.role_map import RoleMap
from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.contracts.maps.map_file import SHIPPED, DeviceMap
from palpate.instrument.contracts.sensor_node import CHANNELS
from palpate.instrument.errors import ConfigError

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
