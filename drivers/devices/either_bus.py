"""The base of drivers that speak in fields and commands of a map only, so that they serve Modbus and CANopen alike."""

from __future__ import annotations

from functools import cache
from typing import Any, Self

from palpate.drivers.devices.canopen_device import CanopenDevice
from palpate.drivers.devices.device import Device, DevicePlace
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.errors import UsageError

BASES: dict[str, type[Device]] = {"modbus": ModbusDevice, "canopen": CanopenDevice}


class EitherBus(Device):
    """A driver whose contract, and with it its bus, comes from its place.

    A subclass uses `get`, `get_many`, `get_text`, `give` and `command`; `self.kind` has what its map says of a role.
    """

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        """Make the driver on the bus of its contract. Raises UsageError: the place has no kind."""
        if issubclass(cls, tuple(BASES.values())):
            return super().at(place)
        if place.kind is None:
            raise UsageError(f"{cls.__name__} has no contract of its own; give its place a kind")
        driver: Any = cls
        made: Self = _joined(driver, place.kind.contract.bus).at(place)
        return made


@cache
def _joined(driver: Any, bus: str) -> Any:
    return type(driver.__name__, (driver, BASES[bus]), {"__doc__": driver.__doc__, "__module__": driver.__module__})
