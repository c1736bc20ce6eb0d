"""The base of all drivers: it repeats reads that failed, and leaves a broken device alone."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeVar

from palpate.drivers.clock import Clock
from palpate.drivers.devices.commands import carry_out
from palpate.drivers.devices.scaling_watch import ScalingWatch
from palpate.drivers.devices.wear import Wear
from palpate.instrument.contracts.contract import NOTHING, Contract, Value
from palpate.instrument.errors import BenchError, DeviceError, IdentityError, UsageError

if TYPE_CHECKING:
    from palpate.drivers.links.can import CanLink
    from palpate.drivers.links.modbus import ModbusLink
    from palpate.instrument.bench.kinds import DeviceKind

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class DevicePlace:
    """What a driver gets from its bench.

    Attributes:
        link: the link of the device.
        unit: its Modbus unit id, or its CANopen node id.
        settings: the settings of its kind, from its section of the bench file.
        clock: the bench's clock.
        kind: its device kind; None: that of the driver's own contract.
        inventory: its label, which stands for the serial number of a device that tells none; "" otherwise.
    """

    link: Any
    unit: int
    settings: Any
    clock: Clock
    kind: DeviceKind | None = None
    inventory: str = ""


class Device:
    """One device of a bench.

    A read changes nothing, so it is tried up to `read_attempts` times until the answer is valid; `noticed` is called
    with each failure. A write is sent once.

    A driver for one map has a class attribute `contract`. One for many maps has none: it gets that of its place's kind.
    """

    contract: Contract
    link: ModbusLink | CanLink
    kind: DeviceKind | None = None
    inventory = ""
    orders: frozenset[str] = frozenset()  # fields that make the device do something

    @classmethod
    def at(cls, place: DevicePlace) -> Self:
        """Make the driver of a device, not connected yet; one whose constructor takes more arguments overrides this."""
        driver: Any = cls
        return cls._fitted(driver(place.link, place.unit, place.clock, *cls._own(place)), place)

    def __init__(self, where: str, clock: Clock, contract: Contract | None = None) -> None:
        """Make a driver, not connected yet.

        Args:
            where: its place, for people.
            clock: the bench's clock.
            contract: None: that of the class.
        """
        if contract is not None:
            self.contract = contract
        self.name = f"{self.contract.title} {where}"
        self.clock = clock
        self.orders = self.orders | {command.field for command in self.contract.commands}
        self._settings: dict[str, Value] = {}  # those that were written, by name
        self._scales = ScalingWatch(self)
        self._wear = Wear(self.name, self.contract, clock)
        self.serial = ""
        self.simulated = False
        self.broken = ""  # why it is no longer used; empty: it is used
        self.read_attempts = 1
        self.noticed: Callable[[str], object] = lambda _incident: None
        self.afterwards: Callable[[], object] = lambda: None  # called after each request

    @classmethod
    def _fitted(cls, made: Self, place: DevicePlace) -> Self:
        """A driver with what its place says of it."""
        made.kind, made.inventory = place.kind, place.inventory
        return made

    @classmethod
    def _own(cls, place: DevicePlace) -> tuple[Contract, ...]:
        """The contract of its place's kind, if the class has none. Raises UsageError: there is neither."""
        if hasattr(cls, "contract"):
            return ()
        if place.kind is None:
            raise UsageError(f"{cls.__name__} has no contract of its own; give its place a kind")
        return (place.kind.contract,)

    def get(self, name: str) -> float:
        """Physical value of a field, in the contract's unit; NaN: it has no reading. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def get_many(self, *names: str) -> list[float]:
        """Physical values of several fields, as `get`."""
        return [self.get(name) for name in names]

    def held(self, name: str) -> float:
        """Value of a field, which may be outside the limits. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def get_text(self, name: str) -> str:
        """Content of a text field. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def give(self, /, **values: Value) -> None:
        """Write fields, once: in one request on Modbus, in which they must stand together; one by one on CANopen.

        Raises RangeError, UsageError before anything is sent; LinkError, DeviceError.
        """
        raise NotImplementedError

    def command(self, name: str) -> None:
        """Give an order of the contract, and wait until it is done; see `palpate.drivers.devices.commands`."""
        carry_out(self, name)

    def identify(self) -> None:
        """Check that the contract's device answers, and the same one as before. Raises IdentityError, LinkError."""
        raise NotImplementedError

    def connect(self) -> None:
        """Get ready to use the device; its link is open. Raises as `identify` does."""
        self.identify()

    def set_up(self, settings: Any, watchdog: float) -> None:
        """Write the settings of its section, and the bench's watchdog time-out [s]. Raises LinkError, DeviceError."""

    def check_section(self, settings: Any, frequency: float) -> None:
        """Check by its section of the bench file alone that it can work with a load of a frequency [Hz].

        It is called before the device is opened. Raises RangeError, ConfigError: it cannot, or the section lacks a key.
        """

    def check_frequency(self, frequency: float) -> None:
        """Check that it can work with a load of this frequency [Hz], before anything moves. Raises RangeError."""

    def sick(self) -> str:
        """Why it cannot be used although it answers and holds its settings; empty: it can be used."""
        return ""

    def differences(self) -> list[str]:
        """The settings that it no longer holds, as texts for people. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def restore(self) -> None:
        """Write lost settings again. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def notices(self) -> list[str]:
        """Its reports since the last call, as texts for people."""
        return []

    def _same(self, serial: str) -> str:
        """Check that a serial number is the same as before, and return it. Raises IdentityError: it is another one."""
        if self.serial not in ("", serial):
            raise IdentityError(
                f"{self.name}: has serial number {serial or 'none'}, had {self.serial} before; put the first one back, "
                "or run again"
            )
        return serial

    def _value(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> float:
        """Physical value of a field from its bytes. Raises DeviceError: it is outside the limits, or no choice."""
        value = self._decoded(name, data, beside)
        if fault := self.contract.misread(name, value):
            raise DeviceError(
                f"{self.name}: reads {fault}; not used. Set it within its limits, or look at its firmware"
            )
        return value

    def _decoded(self, name: str, data: bytes, beside: Mapping[str, float] = NOTHING) -> float:
        """Physical value of a field from its bytes, within its limits or not. Raises DeviceError: there is none."""
        try:
            return self.contract.decode(name, data, beside)
        except KeyError:
            raise DeviceError(
                f"{self.name}: tells a scale of {name} that the contract does not know ({dict(beside)}); not used. "
                "Check the map of this device"
            ) from None
        except (ValueError, struct.error) as error:
            raise DeviceError(f"{self.name}: {name} cannot be used: {error}. Check the map of this device") from None

    def _asked(self, question: Callable[[], T]) -> T:
        for attempt in range(1, self.read_attempts + 1):
            try:
                return self._told(question)
            except BenchError as error:
                if self.broken or attempt == self.read_attempts:
                    raise
                self.noticed(f"{error}; asked again")
        raise AssertionError("it is asked once or more")

    def _told(self, order: Callable[[], T]) -> T:
        """The result of a request; an error gets the device's name."""
        try:
            if self.broken:
                raise DeviceError(f"{self.broken}; it is not used any more in this run")
            answer = order()
        except BenchError as error:
            error.device = self.name
            raise
        self.afterwards()
        return answer
