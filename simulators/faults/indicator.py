"""Faults of a load cell and its indicator, ours or a maker's: they change what the indicator reads while they last."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

from pydantic import Field

from palpate.instrument.bench.role_maps.load_indicator import NOT, LoadIndicatorMap
from palpate.instrument.contracts import strain_indicator
from palpate.simulators.faults.device import DeviceFault, Faulty, device
from palpate.simulators.faults.places import INDICATOR, Reads, Target, TellsTrouble, Weighs, WeighsFloat

Read = Callable[[str], float]
BITS = strain_indicator.CONTRACT["status"].bits
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
        said = list(role.faults)[self.place]
        bit: int = 1 << found.contract[role.status].bits[said.removeprefix(NOT)]
        read: Read = found.read

        def seen(name: str) -> float:
            if name != role.status:
                return read(name)
            return int(read(name)) & ~bit if said.startswith(NOT) else int(read(name)) | bit

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
