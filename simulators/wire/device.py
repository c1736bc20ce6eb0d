"""What all simulated Modbus devices share: the settings of their contract, and the refusal of what a device refuses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from palpate.instrument.bench.kinds import DeviceKind, Role
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.sensor.sample import Sample
from palpate.simulators.clock import NEVER, VirtualClock


@dataclass(frozen=True)
class SimulatedPlace:
    """What a simulated device gets from its bench.

    Attributes:
        clock: the bench's clock.
        rig: the physical state of the scene, a `Rig`; untyped, because `simulators/rig` may import the wire.
        unit: Modbus unit id, or CANopen node id.
        serial: serial number: text on Modbus, an integer on CANopen.
        settings: settings of its device kind, from the bench file.
        kind: its device kind.
        find: returns the simulated device that fills a role; call it once all devices exist. Raises
            BenchError: no device fills it.
        samples: samples in the sample changer.
        number: which of the devices that fill its role it is, from 1, if it is a sensor node; 0: it fills none.
    """

    clock: VirtualClock
    rig: Any
    unit: int
    serial: Any
    settings: Any
    kind: DeviceKind
    find: Callable[[Role], Any]
    samples: Sequence[Sample] = ()
    number: int = 0


class Refused(Exception):
    """The device refuses a write, with this Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception code {code}")
        self.code = code


ILLEGAL_VALUE = 3
DEVICE_FAILURE = 4
DEVICE_BUSY = 6


class SimulatedDevice:
    """One device on a Modbus server. Methods are called under the clock's lock."""

    contract: Contract
    readings: ClassVar[tuple[str, ...]] = ()  # names of displayed fields, which the fault `stuck_display` can freeze
    speed = 1.0  # speed of this clock relative to the clients' clock, in whose seconds a watchdog counts
    rig: Any  # that of its place, once it stands on a bench

    @classmethod
    def at(cls, place: SimulatedPlace) -> Self:
        """Make the device for its place on a bench; a device whose constructor takes more arguments overrides this."""
        made = cls(place.clock, place.serial)
        made.rig = place.rig
        return made

    def __init__(self, clock: VirtualClock, serial: str) -> None:
        self.clock = clock
        self.serial = serial
        self.settings = {f.name: float(f.default) for f in self.contract.fields if f.type != "text"}
        clock.add(self)

    def read(self, name: str) -> float:
        """Present physical value of a field, in the contract's unit."""
        return self.settings[name]

    def write(self, values: dict[str, float]) -> None:
        """Store what a client writes, which has been checked against the contract's limits. Raises Refused."""
        self.settings.update(values)

    def turn(self, values: dict[str, float]) -> None:
        """Store what somebody sets at the front panel. Raises Refused."""
        self.write(values)

    def read_text(self, name: str) -> str:
        """Present content of a text field."""
        raise NotImplementedError

    def write_text(self, name: str, text: str) -> None:
        """Store a text that a client writes. Raises Refused."""
        raise NotImplementedError

    def reset(self) -> None:
        """Return to the state after power-on."""
        self.turn({f.name: float(f.default) for f in self.contract.fields if f.access == "rw"})

    def out_of_range(self) -> None:
        """Called after a write was refused because a value lies outside the contract's limits."""

    def requested(self) -> None:
        """Called when a request of any kind has come in."""

    def next_event_ns(self) -> int:
        return NEVER

    def advance(self, start_ns: int, end_ns: int) -> None:
        pass
