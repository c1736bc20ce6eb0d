"""Puts the faults of a scene where they belong, and nothing anywhere else."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from simulators.clock import NEVER, VirtualClock
from simulators.faults.can import CanFault, FaultyBus, Send
from simulators.faults.device import DeviceFault, device, node
from simulators.faults.fault import NODE, Fault, Trigger
from simulators.faults.relay import Relay
from simulators.faults.rtu import NoisyLine, RtuFault
from simulators.faults.tcp import TcpFault
from simulators.scene import Scene

if TYPE_CHECKING:
    from simulators.bench import SimulatedBench

# Of the wall, of a link that has faults. A time-out is waited for, and the bench's clock stands; an answer that a busy
# machine is so late with would count as a fault that the scene does not have.
TIMEOUT: Any = "2 s"
F = TypeVar("F", bound=Fault)


class Injection:
    """The faults of one bench, each with its count of transactions."""

    def __init__(self, scene: Scene, clock: VirtualClock) -> None:
        self._clock = clock
        self._all = [(fault, Trigger(fault, number, scene.seed)) for number, fault in enumerate(scene.faults)]

    def _of(self, family: type[F], places: tuple[str, ...] = ()) -> list[tuple[F, Trigger]]:
        return [(f, trigger) for f, trigger in self._all if isinstance(f, family) and (not places or f.on in places)]

    def relays(self) -> dict[str, Relay]:
        """For the connections that have faults, by their devices."""
        names = dict.fromkeys(fault.on for fault, _ in self._of(TcpFault))
        return {name: Relay(self._clock, self._of(TcpFault, (name,))) for name in names}

    def line(self, units: dict[int, str]) -> NoisyLine | None:
        """For the serial line, where it has faults; `units` are its devices' names."""
        faults = self._of(RtuFault)
        return NoisyLine(self._clock, faults, units) if faults else None

    def bus(self, send: Send) -> Send:
        """What sends in place of `send`."""
        faults = self._of(CanFault)
        return FaultyBus(self._clock, faults, send).send if faults else send

    def timeouts(self) -> dict[str, Any]:
        """Of the links whose bytes or frames have faults, by their names."""
        names = [fault.on for fault, _ in self._of(TcpFault)]
        names += [name for name, family in (("line", RtuFault), ("can", CanFault)) if self._of(family)]
        return dict.fromkeys(names, TIMEOUT)

    def into(self, sim: SimulatedBench) -> None:
        """Let the devices of a bench have theirs."""
        for fault, trigger in self._of(DeviceFault):
            happening = _Happening(sim, fault, trigger)
            sim.clock.add(happening)
            if fault.at is None:
                happening.count_requests()


class _Happening:
    """A device's fault on the virtual clock: at its time, or at a request to its device."""

    def __init__(self, sim: SimulatedBench, fault: DeviceFault, trigger: Trigger) -> None:
        self._sim = sim
        self._fault = fault
        self._trigger = trigger
        self._begin_ns = NEVER if fault.at is None else round(fault.at * 1e9)
        self._end_ns = NEVER

    def next_event_ns(self) -> int:
        return max(min(self._begin_ns, self._end_ns), self._sim.clock.now_ns() + 1)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._begin_ns:
            self._begin()
        if end_ns >= self._end_ns:
            self._end_ns = NEVER
            self._fault.end(self._sim)

    def count_requests(self) -> None:
        if self._fault.on.startswith(NODE):
            found = node(self._sim, self._fault.on)
            found.read = self._counted(found.read)  # type: ignore[method-assign]
        else:
            other = device(self._sim, self._fault.on)
            other.requested = self._counted(other.requested)  # type: ignore[method-assign]

    def _counted(self, request: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: object) -> Any:
            if self._trigger.strikes(self._sim.clock.now_ns()) and self._end_ns == NEVER:
                self._begin()
            return request(*args)

        return counted

    def _begin(self) -> None:
        self._begin_ns = NEVER
        if self._fault.lasts_ns:
            self._end_ns = self._sim.clock.now_ns() + self._fault.lasts_ns
        self._fault.begin(self._sim)
