"""Faults of load cell and strain indicator, which change the indicator's registers while they last."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

from pydantic import Field

from palpate.instrument.contracts import strain_indicator
from palpate.simulators.faults.device import DeviceFault, Faulty, device
from palpate.simulators.faults.places import Reads, Target

Read = Callable[[str], float]
BITS = strain_indicator.CONTRACT["status"].bits
NO_READING = 0x7FFF_FFFF


class IndicatorFault(DeviceFault):
    """A fault that replaces readings of the strain indicator while it lasts."""

    targets: ClassVar[tuple[Target, ...]] = ("strain_indicator",)

    def begin(self, sim: Faulty) -> None:
        found = device(sim, self.on)
        found.read = self.instead(found.read, sim.clock.now_ns)

    def end(self, sim: Faulty) -> None:
        vars(device(sim, self.on)).pop("read", None)

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        """Function that is read in place of `read`."""
        raise NotImplementedError


class StuckReading(IndicatorFault):
    """The display is no longer updated."""

    targets: ClassVar[tuple[Target, ...]] = (Reads,)

    def begin(self, sim: Faulty) -> None:
        found = device(sim, self.on)
        read, stuck = found.read, {name: found.read(name) for name in found.readings}
        found.read = lambda name: stuck[name] if name in stuck else read(name)


class BridgeOpen(IndicatorFault):
    """The load cell's bridge is open, so that there is no reading."""

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        open_ = {"reading": NO_READING, "reading_float": math.nan}

        def seen(name: str) -> float:
            if name == "status":
                return int(read(name)) | 1 << BITS["bridge_open"]
            return open_[name] if name in open_ else read(name)

        return seen


class Overload(IndicatorFault):
    """The status says that the reading exceeds the full scale."""

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        return lambda name: int(read(name)) | 1 << BITS["overload"] if name == "status" else read(name)


class NotANumber(IndicatorFault):
    """The reading as a float is NaN, and the status does not say why."""

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        return lambda name: math.nan if name == "reading_float" else read(name)


class ZeroDrift(IndicatorFault):
    """The zero of the bridge drifts by `rate` mV in a second."""

    rate: float = Field(default=0.5)

    def instead(self, read: Read, now_ns: Callable[[], int]) -> Read:
        start = now_ns()

        def seen(name: str) -> float:
            drift = self.rate * 1e-9 * (now_ns() - start)
            if name == "reading_float":
                return read(name) + drift
            return round(read(name) + drift * 10.0 ** read("decimals")) if name == "reading" else read(name)

        return seen
