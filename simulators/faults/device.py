"""Faults of a device itself: it loses its settings, trips, or somebody changes a setting."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

from palpate.instrument.errors import ConfigError, UnknownName
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults.fault import Fault
from palpate.simulators.faults.places import HasSettings, Struck, Target, Trips
from palpate.simulators.wire.device import SimulatedDevice


class Faulty(Protocol):
    """The simulated bench, as its faults see it.

    Attributes:
        devices: the simulated devices, by name.
        can: the CAN segment.
        servers: the servers of the Modbus devices.
        line_units: names of the devices on the serial line, by unit id.
        bus_nodes: names of the devices on the CAN bus, by node id.
    """

    clock: VirtualClock
    devices: dict[str, Any]
    scene: Any
    can: Any
    servers: Any

    @property
    def line_units(self) -> dict[int, str]: ...
    @property
    def bus_nodes(self) -> dict[int, str]: ...


class DeviceFault(Fault):
    """A fault that begins and ends under the clock's lock."""

    def begin(self, sim: Faulty) -> None:
        """Let the fault begin."""
        raise NotImplementedError

    def end(self, sim: Faulty) -> None:
        """Let the fault end, if it lasts."""


class PowerCycle(DeviceFault):
    """The device restarts with its factory settings."""

    targets: ClassVar[tuple[Target, ...]] = ("modbus-tcp", "modbus-rtu")

    def begin(self, sim: Faulty) -> None:
        device(sim, self.on).reset()


class _Trip(DeviceFault):
    targets: ClassVar[tuple[Target, ...]] = (Trips,)
    latches: ClassVar[str]

    def begin(self, sim: Faulty) -> None:
        device(sim, self.on).trip(self.latches)


class OverCurrent(_Trip):
    """The amplifier trips on too much current."""

    latches: ClassVar[str] = "over_current"


class OverTemperature(_Trip):
    """The amplifier trips on too high a temperature."""

    latches: ClassVar[str] = "over_temperature"


class LatchedFault(_Trip):
    """The amplifier's supply trips, and the fault is latched."""

    latches: ClassVar[str] = "supply"


class FrontPanel(DeviceFault):
    """Somebody changes a setting at the device's panel: `setting` to `value`, in the contract's unit."""

    targets: ClassVar[tuple[Target, ...]] = (HasSettings,)
    setting: str
    value: float

    def problem(self, place: Struck) -> str:
        if place.kind is None:
            return "it is no device"
        contract = place.kind.contract
        settings = [field.name for field in contract.fields if field.access == "rw"]
        if self.setting not in settings:
            return str(UnknownName(f"setting of the {contract.title}", self.setting, settings))
        if not contract.allows(self.setting, self.value):
            return f"value: {self.value:g} is not allowed: {contract.described(self.setting, self.value)}"
        return ""

    def begin(self, sim: Faulty) -> None:
        found = device(sim, self.on)
        if isinstance(found, SimulatedDevice):
            found.turn({self.setting: self.value})
        else:
            found.write(found.contract[self.setting], self.value)


def device(sim: Faulty, name: str) -> Any:
    """Device of the bench by its name in a scene. Raises ConfigError: the bench has no sample changer."""
    if name not in sim.devices:
        raise ConfigError(
            f"fault: this bench has no {name}, so nothing of it can fail; palpate serve --samples 1-6 gives it one"
        )
    return sim.devices[name]
