"""A source that holds one value, such as a direct voltage or current, until it is told another."""

from __future__ import annotations

from typing import Self

from palpate.drivers.devices.device import DevicePlace
from palpate.drivers.devices.either_bus import EitherBus
from palpate.instrument.bench.role_maps import BiasMap

NONE = 0.0


class MappedBias(EitherBus):
    """A source of a maker, by its map's table `[role.bias]`.

    It has no watchdog: nothing but this program switches it off.

    Attributes:
        holding: whether it was told to hold a value, and not told to stop.
    """

    _map: BiasMap
    holding = False

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        made = super().at(place)
        if place.kind is not None:
            made._map = place.kind.table(BiasMap)
        return made

    def hold(self, level: float) -> None:
        """Hold a value, in the unit of its field. Raises RangeError before anything is sent; LinkError, DeviceError."""
        self.contract.raw(self._map.level, level)
        self.holding = True
        if self._map.ready:
            self.command(self._map.ready)
        for name, value in self._map.set_up.items():
            self.give(**{name: value})
        self.give(**{self._map.level: level})
        if self._map.on:
            self.command(self._map.on)

    def level(self) -> float:
        """The value at its output, or the one that it was told if it measures none. Raises LinkError, DeviceError."""
        return self.get(self._map.actual or self._map.level)

    def off(self) -> None:
        """Switch it off. Raises LinkError, DeviceError."""
        if self._map.off:
            self.command(self._map.off)
        if self.holding or not self._map.off:
            self.give(**{self._map.level: NONE})
        self.holding = False
