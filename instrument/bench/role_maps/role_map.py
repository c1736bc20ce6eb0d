"""The base of the models of a map's `[role.ROLE]` tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from palpate.instrument.config import Config
from palpate.instrument.contracts.contract import Contract


class RoleMap(Config):
    """A table `[role.ROLE]`: which fields and commands of the map serve the role.

    A subclass has a key for each need of its role. The generic driver and simulator find the checked table at
    `DeviceKind.table`.
    """

    generic_driver: ClassVar[str]  # "module:Class", a `palpate.drivers.devices.device.Device`
    generic_simulator: ClassVar[str | None] = None  # "module:Class"; None: simulated benches cannot have it
    settings: ClassVar[type[Config] | None] = None  # keys of its section in a bench file; None: it has none

    def wrong(self, contract: Contract) -> list[str]:
        """What the contract lacks that this table names, each with key, value and what is valid; empty: it fits."""
        raise NotImplementedError

    def limits(self, contract: Contract) -> Mapping[str, Any]:
        """Attributes of `DeviceKind` that follow from the map: `channels`, `frequency_step`, `travel`, `cannot`."""
        return {}
