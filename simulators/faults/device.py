"""Faults of a device itself: it loses its settings, trips, or somebody changes a setting."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from palpate.instrument.contracts import CONTRACTS, sensor_node
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.simulators.faults.fault import MODBUS, NODE, Fault
from palpate.simulators.wire.device import SimulatedDevice

if TYPE_CHECKING:
    from palpate.simulators.bench import SimulatedBench
    from palpate.simulators.devices.sensor_node import SensorNode


class DeviceFault(Fault):
    """A fault that begins and ends under the clock's lock."""

    def begin(self, sim: SimulatedBench) -> None:
        """Let the fault begin."""
        raise NotImplementedError

    def end(self, sim: SimulatedBench) -> None:
        """Let the fault end, if it lasts."""


class PowerCycle(DeviceFault):
    """The device restarts with its factory settings."""

    targets: ClassVar[tuple[str, ...]] = MODBUS

    def begin(self, sim: SimulatedBench) -> None:
        device(sim, self.on).reset()


class _Trip(DeviceFault):
    targets: ClassVar[tuple[str, ...]] = ("shaker_amplifier",)
    latches: ClassVar[str]

    def begin(self, sim: SimulatedBench) -> None:
        sim.amplifier.trip(self.latches)


class OverCurrent(_Trip):
    latches: ClassVar[str] = "over_current"


class OverTemperature(_Trip):
    latches: ClassVar[str] = "over_temperature"


class LatchedFault(_Trip):
    """The amplifier's supply trips, and the fault is latched."""

    latches: ClassVar[str] = "supply"


class FrontPanel(DeviceFault):
    """Somebody changes a setting at the device's panel: `setting` to `value`, in the contract's unit."""

    targets: ClassVar[tuple[str, ...]] = (*MODBUS, NODE)
    setting: str
    value: float

    def problem(self) -> str:
        contract = sensor_node.CONTRACT if self.on.startswith(NODE) else CONTRACTS[self.on]
        settings = [field.name for field in contract.fields if field.access == "rw"]
        if self.setting not in settings:
            return str(UnknownName(f"setting of the {contract.title}", self.setting, settings))
        if not contract.allows(self.setting, self.value):
            return f"value: {self.value:g} is not allowed: {contract.described(self.setting, self.value)}"
        return ""

    def begin(self, sim: SimulatedBench) -> None:
        if self.on.startswith(NODE):
            found = node(sim, self.on)
            found.write(sensor_node.CONTRACT[self.setting], self.value)
        else:
            device(sim, self.on).turn({self.setting: self.value})


def device(sim: SimulatedBench, name: str) -> SimulatedDevice:
    """Modbus device of the bench by its name in a scene. Raises ConfigError: the bench has no sample changer."""
    devices = (sim.generator, sim.amplifier, sim.changer, sim.indicator, sim.positioner)
    found = dict(zip(MODBUS, devices, strict=True))[name]
    if found is None:
        raise ConfigError(
            f"fault: this bench has no {name}, so nothing of it can fail; palpate serve --samples 1-6 gives it one"
        )
    return found


def node(sim: SimulatedBench, name: str) -> SensorNode:
    """A node of the bench by its name in a scene."""
    return sim.nodes[int(name.removeprefix(NODE)) - 1]
