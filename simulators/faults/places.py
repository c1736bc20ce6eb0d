"""Where faults strike: the links and devices of a simulated bench, and what a device must be able to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from palpate.instrument.additions import load
from palpate.instrument.bench.kinds import KINDS, DeviceKind
from palpate.instrument.bench.links import CAN, LINE
from palpate.instrument.bench.role_maps.load_indicator import LoadIndicatorMap
from palpate.instrument.contracts.contract import sdo
from palpate.simulators.guests import Guest, replaced


@runtime_checkable
class Trips(Protocol):
    """A device that switches itself off."""

    def trip(self, fault: str) -> None: ...


class HasSettings(Protocol):
    """A device whose contract has something that can be set."""


class Beats(Protocol):
    """A CANopen node whose contract has a heartbeat, which it may lack."""


class Reads(Protocol):
    """A device with a display that can be stuck."""

    readings: tuple[str, ...]


class Weighs(Protocol):
    """A maker's load indicator; `contract` and `kind` are those of its map."""


class WeighsFloat(Protocol):
    """A maker's load indicator whose reading is a float, which can be none."""


class TellsTrouble(Protocol):
    """A maker's load indicator with bits that say that there is no load to read."""


class Samples(Protocol):
    """A maker's sensor node."""


INDICATOR, NODE = "load_indicator", "sensor_node"
HEARTBEAT_TIME = sdo(0x1017)  # CiA 301
Target = (
    str | type[Trips] | type[HasSettings] | type[Beats] | type[Reads] | type[Weighs] | type[WeighsFloat]
    | type[TellsTrouble] | type[Samples]
)  # fmt: skip


@dataclass(frozen=True)
class Struck:
    """A place by the name that `on` of a fault gives it; `kind`: of a device, None: it is a link."""

    name: str
    kind: DeviceKind | None = None

    def has(self, target: Target) -> bool:
        """Whether this target is here: a place, a kind, a kind of link, or what a device can do."""
        if self.kind is None or isinstance(target, str):
            return target == self.name or (self.kind is not None and target in (self.kind.name, self.kind.links[0]))
        if target is Beats:
            return any(field.address == HEARTBEAT_TIME for field in self.kind.contract.fields)
        if target is HasSettings:
            return any(field.access == "rw" and field.type != "text" for field in self.kind.contract.fields)
        if target is Samples:
            return NODE in self.kind.serves
        if target in (Weighs, WeighsFloat, TellsTrouble):
            return self._weighs(target)
        simulator = load(self.kind.simulator or "", f"simulator of {self.name}")
        return bool(getattr(simulator, "readings", ())) if target is Reads else issubclass(simulator, Trips)

    def _weighs(self, target: Target) -> bool:
        assert self.kind is not None
        role = self.kind.serves.get(INDICATOR)
        if not isinstance(role, LoadIndicatorMap):
            return False
        if target is WeighsFloat:
            return self.kind.contract[role.reading].type.startswith("float")
        return target is Weighs or bool(role.faults)


def places(nodes: int, guests: Sequence[Guest] = ()) -> list[Struck]:
    """All places of a bench with so many sensor nodes; it may turn out to have no sample changer."""
    gone = replaced(guests)
    own = [Struck(name, kind) for name, kind in KINDS.items() if name not in gone]
    usual = [each for link in ("modbus-tcp", "modbus-rtu") for each in own if each.kind and each.kind.links[0] == link]
    nodes = 0 if NODE in gone else nodes
    sensors = [Struck(f"{NODE}_{number}", KINDS[NODE]) for number in range(1, nodes + 1)]
    added = [Struck(each.name, each.kind) for each in guests]
    linked = {each.kind.links[0] for each in (*usual, *sensors, *added) if each.kind}
    links = [Struck(name) for name, kind in ((LINE, "modbus-rtu"), (CAN, "canopen")) if kind in linked]
    return [*usual, *links, *sensors, *added]


def struck(targets: Sequence[Target], standing: Sequence[Struck]) -> dict[str, Struck]:
    """The places where a fault with these targets can strike, by name, in the order of the targets."""
    return {place.name: place for target in targets for place in standing if place.has(target)}
