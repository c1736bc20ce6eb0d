"""The common base of all faults: where they strike, and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

from pydantic import Field

from palpate.instrument.additions import load
from palpate.instrument.bench.kinds import KINDS, DeviceKind
from palpate.instrument.bench.links import CAN, LINE
from palpate.instrument.bench.role_maps import LoadIndicatorMap
from palpate.instrument.config import check
from palpate.instrument.contracts.contract import sdo
from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.quantity import Seconds
from palpate.simulators.faults import FAULTS, fault_class
from palpate.simulators.guests import Guest, replaced
from palpate.simulators.numbers import Numbers
from palpate.simulators.randomness import Stream

# -------------------------------------------------------------------------------------------------------
# Where faults strike: the links and devices of a simulated bench, and what a device must be able to do


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


# --- the base of all faults ----------------------------------------------------------------------------

MOST = 100  # faults in a scene
LONGEST = 1e9  # s, three decades; far beyond, whole nanoseconds are no numbers of a clock any more
WHEN = ("at", "transaction", "probability")


class Fault(Numbers):
    """A `[[fault]]` of a scene.

    Attributes:
        on: device or link that has the fault.
        at: bench time at which it strikes; or
        transaction: number, from 1, of the request (on CAN: the frame) that it strikes; or
        probability: probability of striking a request, by the scene's seed.
        lasts: how long it goes on; 0: it strikes once, and a changed device stays changed.
    """

    targets: ClassVar[tuple[Target, ...]]

    kind: str
    on: str
    at: Seconds | None = Field(default=None, ge=0, le=LONGEST)
    transaction: int | None = Field(default=None, ge=1, strict=True)
    probability: float | None = Field(default=None, gt=0, le=1, strict=True)
    lasts: Seconds = Field(default=0.0, ge=0, le=LONGEST)

    def problem(self, place: Struck) -> str:
        """What is wrong with the combination of its parameters at this place; empty: nothing."""
        return ""

    @property
    def lasts_ns(self) -> int:
        return round(self.lasts * 1e9)


class Trigger:
    """Decides when a fault strikes, by its transactions: the same for the same scene and seed."""

    def __init__(self, fault: Fault, number: int, seed: int) -> None:
        from scipy.special import ndtri

        self._fault = fault
        self._stream = Stream(seed, "fault", number)
        self._threshold = float(ndtri(fault.probability)) if fault.probability is not None else None
        self._count = 0
        self.struck = 0  # number of struck transactions
        self._until_ns: int | None = None

    def strikes(self, now_ns: int) -> bool:
        """Whether the transaction that begins now is struck; to be asked once for each transaction."""
        self._count += 1
        struck = self._until_ns is not None and now_ns < self._until_ns
        if not struck and self._begins(now_ns):
            self._until_ns = now_ns + self._fault.lasts_ns
            struck = True
        self.struck += struck
        return struck

    def _begins(self, now_ns: int) -> bool:
        if self._threshold is not None:
            return bool(self._stream.normal(self._count - 1, 1)[0] < self._threshold)
        if self._fault.at is not None:
            return self._until_ns is None and now_ns >= round(self._fault.at * 1e9)
        return self._count == self._fault.transaction


def parse_faults(given: Sequence[Mapping[str, Any]], standing: Sequence[Struck], where: str) -> tuple[Fault, ...]:
    """Read and check the faults of a scene file.

    Raises:
        ConfigError: a kind, device or key is unknown, or there is not exactly one time. The message names the file, the
            number of the fault and the key.
    """
    if len(given) > MOST:
        raise ConfigError(f"{where}: fault: {len(given)} faults are more than {MOST}; leave some out")
    return tuple(
        parse_fault(dict(table), standing, f"{where}: fault {number}") for number, table in enumerate(given, 1)
    )


def parse_fault(table: dict[str, Any], standing: Sequence[Struck], where: str) -> Fault:
    """Read and check one fault; `where` names it in messages. Raises ConfigError as `parse_faults` does."""
    kind = table.get("kind")
    if not isinstance(kind, str):
        raise ConfigError(f"{where}: kind: is missing or no text; valid: {', '.join(FAULTS)}")
    try:
        fault: Fault = check(table, fault_class(kind), where)
        valid = struck(fault.targets, standing)
        if fault.on not in valid:
            raise UnknownName(f"place of a {kind}", fault.on, valid)
    except UnknownName as error:
        raise ConfigError(f"{where}: {error}") from None
    times = [name for name in WHEN if getattr(fault, name) is not None]
    if len(times) != 1:
        given_times = " and ".join(times) or "none"
        raise ConfigError(f"{where}: {given_times} given of {', '.join(WHEN)}: exactly one says when it strikes")
    if problem := fault.problem(valid[fault.on]):
        raise ConfigError(f"{where}: {problem}")
    return fault
