"""Faults of a sensor node and the films on it."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from palpate.simulators.faults.device import DeviceFault, Faulty, device
from palpate.simulators.faults.places import Samples, Struck, Target

HARDWARE = 0x5000  # emergency code for device hardware, CiA 301
BEYOND = 1e3  # V, above every range


class NodeReboot(DeviceFault):
    """The node restarts, announces itself and waits to be started; its settings are lost."""

    targets: ClassVar[tuple[Target, ...]] = ("canopen",)

    def begin(self, sim: Faulty) -> None:
        sim.can.reboot(device(sim, self.on))


class Emergency(DeviceFault):
    """The node sends an emergency message with a `code`."""

    targets: ClassVar[tuple[Target, ...]] = ("canopen",)
    code: int = Field(default=HARDWARE, ge=0, le=0xFFFF, strict=True)

    def begin(self, sim: Faulty) -> None:
        device(sim, self.on).emergency(self.code)


class FilmFault(DeviceFault):
    """A voltage is added to the output of the charge amplifier of a `channel`."""

    targets: ClassVar[tuple[Target, ...]] = ("sensor_node", Samples)
    channel: int = Field(default=1, ge=1, strict=True)

    def problem(self, place: Struck) -> str:
        most = place.kind.channels if place.kind is not None else 0
        return f"channel: {self.channel} is too large; {place.name} has {most}" if self.channel > most else ""

    def begin(self, sim: Faulty) -> None:
        found, start = device(sim, self.on), sim.clock.now_ns()
        sample = found.sample

        def faulty(time_ns: Any, volts: Any, period_ns: int) -> Any:
            row = np.arange(len(volts))[:, np.newaxis] == self.channel - 1
            return sample(time_ns, volts + row * self.added(1e-9 * (time_ns - start)), period_ns)

        found.sample = faulty

    def end(self, sim: Faulty) -> None:
        vars(device(sim, self.on)).pop("sample", None)

    def added(self, seconds: Any) -> Any:
        """Added voltage [V] at `seconds` (n,) after the fault began."""
        raise NotImplementedError


class SaturatedFilm(FilmFault):
    """The film's voltage exceeds every input range."""

    def added(self, seconds: Any) -> Any:
        return BEYOND


class FilmDrift(FilmFault):
    """The output drifts by `rate` V in a second."""

    rate: float = Field(default=1e-3, ge=-1e6, le=1e6, strict=True)

    def added(self, seconds: Any) -> Any:
        return self.rate * seconds
