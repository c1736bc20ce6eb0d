"""Puts the faults of a bench into its devices and links, and takes them away again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from palpate.instrument.bench.links import CAN, LINE
from palpate.instrument.errors import ConfigError, UsageError
from palpate.simulators.clock import NEVER
from palpate.simulators.faults.can import CanFault, FaultyBus, FilmFault
from palpate.simulators.faults.device import DeviceFault, Faulty, IndicatorFault, device
from palpate.simulators.faults.fault import MOST, WHEN, Fault, Trigger, parse_fault, places
from palpate.simulators.faults.modbus import FaultyLink, NoisyLine, RtuFault, TcpFault
from palpate.simulators.wire.device import SimulatedDevice

# Time-out by the wall clock of a link with faults. While it is waited for, the bench's clock stands. If a busy machine
# answered later than this, it would count as a fault that the scene does not have.
TIMEOUT: Any = "2 s"
FOREVER = "1000000000.0 s"  # duration of a fault that is given by hand, until it is cleared
ALL = "all"


def timeouts(faults: Iterable[Fault]) -> dict[str, Any]:
    """Time-outs of the links whose bytes or frames have faults, by their names."""
    links = {TcpFault: "", RtuFault: LINE, CanFault: CAN}
    return {
        name or fault.on: TIMEOUT for fault in faults for family, name in links.items() if isinstance(fault, family)
    }


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """A fault of a bench, with the count of its strikes; for a device's fault also the event on the clock."""

    fault: Fault
    trigger: Trigger
    happening: _Happening | None = None

    def summary(self) -> str:
        """Text for people: where it is, what it is, its parameters, and whether it has struck."""
        own = self.fault.model_dump(mode="json", exclude={"kind", "on"}, exclude_defaults=True)
        if own.get("lasts") == FOREVER:
            own["lasts"] = "until it is cleared"
        if self.fault.at is not None:
            own["at"] = f"{self.fault.at:.9g} s"
        words = [f"{name}={value}" for name, value in own.items() if value is not None]
        struck = self.happening.begun if self.happening else self.trigger.struck
        often = "once" if struck == 1 else f"{struck} times"
        return f"{' '.join([self.fault.on, self.fault.kind, *words])}: has struck {often}"


class Injection:
    """The faults of one bench."""

    def __init__(self, sim: Faulty) -> None:
        self._sim = sim
        self.given: list[Given] = []
        self._numbers = 0
        self._links: dict[str, tuple[FaultyLink, list[tuple[TcpFault, Trigger]]]] = {}
        self._line: list[tuple[RtuFault, Trigger]] | None = None
        self._bus: list[tuple[CanFault, Trigger]] | None = None

    def give(self, fault: Fault) -> None:
        """Give the bench a fault from now on. Raises ConfigError: the bench has no such device."""
        if fault.on not in (LINE, CAN):
            device(self._sim, fault.on)
        trigger = Trigger(fault, self._numbers, self._sim.scene.seed)
        self._numbers += 1
        happening = None
        if isinstance(fault, TcpFault):
            self._of_link(fault.on).append((fault, trigger))
        elif isinstance(fault, RtuFault):
            self._of_line().append((fault, trigger))
        elif isinstance(fault, CanFault):
            self._of_bus().append((fault, trigger))
        elif isinstance(fault, DeviceFault):
            with self._sim.clock.lock:
                happening = _Happening(self._sim, fault, trigger)
        self.given.append(Given(fault, trigger, happening))

    def give_by_hand(self, table: Mapping[str, Any]) -> None:
        """Give the bench a fault from a table as in scenes. Without a time it begins now and lasts until it is cleared.

        Raises ConfigError: the table is wrong, or the bench has this fault already, or one that cannot be told from it.
        """
        now = {"at": f"{self._sim.clock.now_ns()} ns", "lasts": FOREVER}
        timed = dict(table) if any(key in table for key in WHEN) else {**now, **table}
        fault = parse_fault(timed, places(self._sim.scene.nodes, self._sim.scene.devices), "fault")
        if len(self.given) >= MOST:
            raise ConfigError(f"fault: there are {MOST} already; clear some")
        for other in self.given:
            if other.fault.on == fault.on and (other.fault.kind == fault.kind or _in_one_place(other.fault, fault)):
                raise ConfigError(f"fault: {fault.on} has {other.fault.kind} already; clear that first")
        self.give(fault)

    def clear(self, on: str, kind: str = "") -> list[Given]:
        """Take away a fault, all faults of a device or link (no kind), or `all` faults, and return them.

        Raises UsageError: there is none.
        """
        found = [g for g in self.given if on in (ALL, g.fault.on) and kind in ("", g.fault.kind)]
        if not found:
            there = ", ".join(f"{g.fault.on} {g.fault.kind}" for g in self.given)
            why = f"there is no such fault; there are: {there}" if there else "no fault is given"
            raise UsageError(f"clear {f'{on} {kind}'.strip()!r}: {why}")
        for each in found:
            self._take(each)
        return found

    def _take(self, given: Given) -> None:
        self.given.remove(given)
        fault = given.fault
        entry: Any = (fault, given.trigger)
        with self._sim.clock.lock:
            if given.happening is not None:
                given.happening.end()
            elif isinstance(fault, TcpFault):
                link, faults = self._links[fault.on]
                faults.remove(entry)
                if fault.then == "refused":
                    link.listen_again()
            else:
                for others in (self._line, self._bus):
                    if others is not None and entry in others:
                        others.remove(entry)

    def _of_link(self, name: str) -> list[tuple[TcpFault, Trigger]]:
        if name not in self._links:
            faults: list[tuple[TcpFault, Trigger]] = []
            self._links[name] = FaultyLink(self._sim.clock, faults), faults
            self._sim.servers.put_between(device(self._sim, name), self._links[name][0])
        return self._links[name][1]

    def _of_line(self) -> list[tuple[RtuFault, Trigger]]:
        if self._line is None:
            self._line = []
            self._sim.servers.make_noisy(NoisyLine(self._sim.clock, self._line, self._sim.line_units))
        return self._line

    def _of_bus(self) -> list[tuple[CanFault, Trigger]]:
        if self._bus is None:
            faults = self._bus = []
            nodes = self._sim.bus_nodes
            with self._sim.clock.lock:
                self._sim.can.send_by(lambda send: FaultyBus(self._sim.clock, faults, send, nodes).send)
        return self._bus


def _in_one_place(one: Fault, other: Fault) -> bool:
    """Whether the end of one fault would also end the other."""
    return any(isinstance(one, family) and isinstance(other, family) for family in (IndicatorFault, FilmFault))


class _Happening:
    """A device's fault on the virtual clock. It begins at its time or at a request to its device."""

    def __init__(self, sim: Faulty, fault: DeviceFault, trigger: Trigger) -> None:
        self._sim = sim
        self._fault = fault
        self._trigger = trigger
        self.begun = 0  # number of times that it began
        self._over = False
        self._begin_ns = NEVER if fault.at is None else round(fault.at * 1e9)
        self._end_ns = NEVER
        sim.clock.add(self)
        if fault.at is None:
            self._count_requests()
        elif 0 < sim.clock.now_ns() >= self._begin_ns:  # it is given by hand; a scene's faults are there from the start
            self._begin()

    def next_event_ns(self) -> int:
        return max(min(self._begin_ns, self._end_ns), self._sim.clock.now_ns() + 1)

    def advance(self, start_ns: int, end_ns: int) -> None:
        if end_ns >= self._begin_ns:
            self._begin()
        if end_ns >= self._end_ns:
            self._end_ns = NEVER
            self._fault.end(self._sim)

    def end(self) -> None:
        """End the fault for good; called under the clock's lock."""
        self._over = True
        self._sim.clock.remove(self)
        if self.begun:
            self._fault.end(self._sim)

    def _count_requests(self) -> None:
        found = device(self._sim, self._fault.on)
        if isinstance(found, SimulatedDevice):
            found.requested = self._counted(found.requested)  # type: ignore[method-assign]
        else:
            found.read = self._counted(found.read)

    def _counted(self, request: Callable[..., Any]) -> Callable[..., Any]:
        def counted(*args: object) -> Any:
            if not self._over and self._trigger.strikes(self._sim.clock.now_ns()) and self._end_ns == NEVER:
                self._begin()
            return request(*args)

        return counted

    def _begin(self) -> None:
        self._begin_ns = NEVER
        self.begun += 1
        if self._fault.lasts_ns:
            self._end_ns = self._sim.clock.now_ns() + self._fault.lasts_ns
        self._fault.begin(self._sim)
