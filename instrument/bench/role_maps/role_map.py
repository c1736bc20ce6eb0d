"""The base of the models of a map's `[role.ROLE]` tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Contract

Maker = Annotated[str, Field(pattern="^[a-z][a-z0-9_]*:[A-Z][A-Za-z0-9]*$")]


class RoleMap(Config):
    """A table `[role.ROLE]`: which fields and commands of the map serve the role.

    A subclass has a key for each need of its role. The generic driver and simulator find the checked table at
    `DeviceKind.serves[ROLE]`.

    Attributes:
        driver: "module:Class" of a driver of the device's own in `palpate.drivers.mapped.makers`; None: the generic
            one of the role.
    """

    generic_driver: ClassVar[str]  # "module:Class", a `palpate.drivers.devices.device.Device`
    generic_simulator: ClassVar[str | None] = None  # "module:Class"; None: simulated benches cannot have it
    settings: ClassVar[type[Config] | None] = None  # keys of its section in a bench file; None: it has none

    driver: Maker | None = None

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        raise NotImplementedError

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        """Attributes of `DeviceKind` that follow from the map: `channels`, `frequency_step`, `travel`, `cannot`."""
        return {}
