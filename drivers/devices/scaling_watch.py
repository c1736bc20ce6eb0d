"""Scales and units that a device tells by other fields; they must stay as they were when it was identified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from palpate.instrument.contracts.contract import NOTHING, Contract, Value
from palpate.instrument.errors import DeviceError


class ReadableDevice(Protocol):
    """A device that can be asked for a number."""

    name: str
    contract: Contract

    def get(self, name: str) -> float: ...


class ScalingWatch:
    """What a device has told of its scales and units."""

    def __init__(self, device: ReadableDevice) -> None:
        self._device = device
        fields = device.contract.fields
        self._scales = tuple(dict.fromkeys(f.scaling.told_by for f in fields if f.scaling))
        self._units = {f.unit_in: f.unit for f in fields if f.unit_in}
        self._known: dict[str, float] = {}
        self._scaled = {f.name: f.scaling.told_by for f in fields if f.scaling}

    def check(self) -> None:
        """Ask for all of them again. Raises DeviceError: one has changed, or the unit is another than the contract's.

        LinkError: the device does not answer.
        """
        for name in self._scales:
            self.take(name, self._device.get(name))
        for name, unit in self._units.items():
            device = self._device
            found = device.contract.choice(name, device.get(name))
            if found != unit:
                raise DeviceError(
                    f"{device.name}: {name} is {found!r}, the contract reads {unit!r}; set the device to {unit}, or "
                    "use a map for its unit",
                    device=device.name,
                )

    def take(self, name: str, value: float) -> None:
        """Take in what a field reads. Raises DeviceError: it tells a scale, and has changed."""
        if name not in self._scales:
            return
        before = self._known.setdefault(name, value)
        if value != before:
            raise DeviceError(
                f"{self._device.name}: {name} is {value:g}, was {before:g} before, so the scale of its readings has "
                f"changed; set it to {before:g} again, or start anew",
                device=self._device.name,
            )

    def scale(self, name: str) -> float:
        """What the field of a scale reads, as it was when it was asked for first. Raises as `check`."""
        if name not in self._known:
            self.take(name, self._device.get(name))
        return self._known[name]

    def beside(self, name: str) -> Mapping[str, float]:
        """What is needed beside a field's value in order to write it. Raises as `check`."""
        if name not in self._scaled:
            return NOTHING
        told_by = self._scaled[name]
        return {told_by: self.scale(told_by)}

    def encode(self, name: str, value: Value) -> bytes:
        """Wire bytes of a setting. Raises RangeError, and as `check`."""
        contract = self._device.contract
        return contract.encode(name, value, self.beside(name)) if name in self._scaled else contract.encode(name, value)

    def holds(self, name: str, data: bytes, value: Value) -> bool:
        """Whether the bytes of a field hold a setting. Raises as `check`."""
        wanted = self.encode(name, value)
        contract = self._device.contract
        if contract[name].part is None:
            return data == wanted
        return contract.decode(name, data) == contract.decode(name, wanted)
