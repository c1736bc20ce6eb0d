"""Faults of a device itself: it loses its settings, trips, or somebody changes a setting."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar, Protocol

from pydantic import Field

from palpate.instrument.bench.role_maps import NOT, LoadIndicatorMap
from palpate.instrument.contracts.own import STRAIN_INDICATOR
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.simulators.clock import VirtualClock
from palpate.simulators.faults.fault import (
    INDICATOR,
    Fault,
    HasSettings,
    Reads,
    Struck,
    Target,
    TellsTrouble,
    Trips,
    Weighs,
    WeighsFloat,
)
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


# -------------------------------------------------------------------------------------------------------
# Faults of a load cell and its indicator, ours or a maker's: they change what the indicator reads while they
# last

Read = Callable[[str], float]
BITS = STRAIN_INDICATOR["status"].bits
NO_READING = 0x7FFF_FFFF


class IndicatorFault(DeviceFault):
    """A fault that replaces readings of an indicator while it lasts."""

    targets: ClassVar[tuple[Target, ...]] = ("strain_indicator",)

    def begin(self, sim: Faulty) -> None:
        found = device(sim, self.on)
        role = found.kind.serves[INDICATOR] if hasattr(found, "kind") else None
        if role is None:
            found.read = self.instead(found.read, sim.clock.now_ns)
        else:
            self.strike(found, role, sim.clock.now_ns())

    def end(self, sim: Faulty) -> None:
        for name in ("read", "added_mV"):
            vars(device(sim, self.on)).pop(name, None)

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        """Function that is read in place of `read` of our own indicator."""
        raise NotImplementedError

    def strike(self, found: Any, role: LoadIndicatorMap, now_ns: int) -> None:
        """Let the fault begin at the twin of a maker's indicator."""
        raise NotImplementedError


class StuckReading(IndicatorFault):
    """The display is no longer updated."""

    targets: ClassVar[tuple[Target, ...]] = (Reads,)

    def begin(self, sim: Faulty) -> None:
        found = device(sim, self.on)
        read, stuck = found.read, {name: found.read(name) for name in found.readings}
        found.read = lambda name: stuck[name] if name in stuck else read(name)


class _Told(IndicatorFault):
    """The status says what is wrong; that of a maker's device by one of the bits that its map calls faults."""

    targets: ClassVar[tuple[Target, ...]] = ("strain_indicator", TellsTrouble)
    place: ClassVar[int]  # among these bits

    def strike(self, found: Any, role: LoadIndicatorMap, now_ns: int) -> None:
        bit_name = list(role.faults)[self.place]
        bit: int = 1 << found.contract[role.status].bits[bit_name.removeprefix(NOT)]
        read: Read = found.read

        def seen(name: str) -> float:
            if name != role.status:
                return read(name)
            return int(read(name)) & ~bit if bit_name.startswith(NOT) else int(read(name)) | bit

        found.read = seen


class BridgeOpen(_Told):
    """The load cell's bridge is open, so that there is no reading. A maker's device tells the first of its faults."""

    place: ClassVar[int] = 0

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        open_ = {"reading": NO_READING, "reading_float": math.nan}

        def seen(name: str) -> float:
            if name == "status":
                return int(read(name)) | 1 << BITS["bridge_open"]
            return open_[name] if name in open_ else read(name)

        return seen


class Overload(_Told):
    """The status says that the reading exceeds the full scale. A maker's device tells the last of its faults."""

    place: ClassVar[int] = -1

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        return lambda name: int(read(name)) | 1 << BITS["overload"] if name == "status" else read(name)


class NotANumber(IndicatorFault):
    """The reading as a float is NaN, and the status does not say why."""

    targets: ClassVar[tuple[Target, ...]] = ("strain_indicator", WeighsFloat)

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        return lambda name: math.nan if name == "reading_float" else read(name)

    def strike(self, found: Any, role: LoadIndicatorMap, now_ns: int) -> None:
        read = found.read
        found.read = lambda name: math.nan if name in found.readings else read(name)


class ZeroDrift(IndicatorFault):
    """The zero of the bridge drifts by `rate` mV in a second."""

    targets: ClassVar[tuple[Target, ...]] = ("strain_indicator", Weighs)
    rate: float = Field(default=0.5, ge=-1e6, le=1e6, strict=True)

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        start = now_ns()

        def seen(name: str) -> float:
            drift = self.rate * 1e-9 * (now_ns() - start)
            if name == "reading_float":
                return read(name) + drift
            return round(read(name) + drift * 10.0 ** read("decimals")) if name == "reading" else read(name)

        return seen

    def strike(self, found: Any, role: LoadIndicatorMap, now_ns: int) -> None:
        found.added_mV = lambda time_ns: self.rate * 1e-9 * max(time_ns - now_ns, 0)
