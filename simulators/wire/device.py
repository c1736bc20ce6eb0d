"""What all simulated Modbus devices share: settings by the contract, and refusing what a device refuses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from palpate.instrument.bench.kinds import Role
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock


@dataclass(frozen=True)
class Place:
    """Where a simulated device stands.

    Attributes:
        rig: the scene's state, a `Rig` (`simulators/rig/rig.py`), which stands above the wire.
        unit: or node id, by which it is asked.
        serial: number that it tells; text on Modbus, an integer on CANopen.
        settings: of its kind.
        find: gives the simulated device that fills a role, once all are there.
        samples: that a sample changer holds.
    """

    clock: VirtualClock
    rig: Any
    unit: int
    serial: Any
    settings: Any
    find: Callable[[Role], Any]
    samples: Sequence[Sample] = ()


class Refused(Exception):
    """The device answers a write with this Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception code {code}")
        self.code = code


ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4
DEVICE_BUSY = 6


class SimulatedDevice:
    """One device on a Modbus server. Methods are called under the clock's lock."""

    contract: ClassVar[Contract]
    readings: ClassVar[tuple[str, ...]] = ()  # fields of its display, which may be stuck

    @classmethod
    def at(cls, place: Place) -> Self:
        """The device of a simulated bench; one that takes more than clock and serial number says so itself."""
        return cls(place.clock, place.serial)

    def __init__(self, clock: VirtualClock, serial: str) -> None:
        self.clock = clock
        self.serial = serial
        self.settings = {f.name: float(f.default) for f in self.contract.fields if f.type != "text"}
        clock.add(self)

    def read(self, name: str) -> float:
        """Physical value of a field now."""
        return self.settings[name]

    def write(self, values: dict[str, float]) -> None:
        """Take what a client writes, already checked against the contract's limits. Raises Refused."""
        self.settings.update(values)

    def turn(self, values: dict[str, float]) -> None:
        """Take what somebody sets at the front panel. Raises Refused."""
        self.write(values)

    def read_text(self, name: str) -> str:
        """What a text field says now."""
        raise NotImplementedError

    def write_text(self, name: str, text: str) -> None:
        """Take a text, already checked as in `write`. Raises Refused."""
        raise NotImplementedError

    def reset(self) -> None:
        """As after power-on."""
        self.turn({f.name: float(f.default) for f in self.contract.fields if f.access == "rw"})

    def out_of_range(self) -> None:
        """A write was refused because a value lies outside the contract's limits."""

    def requested(self) -> None:
        """A request of any kind has come in."""

    def next_event_ns(self) -> int:
        return NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        pass
