"""The base of all drivers: it repeats reads that failed, and leaves a broken device alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

from palpate.drivers.clock import Clock
from palpate.instrument.contracts.contract import Contract
from palpate.instrument.errors import BenchError, DeviceError, IdentityError

if TYPE_CHECKING:
    from palpate.drivers.links.can import CanLink
    from palpate.drivers.links.modbus import ModbusLink

READ_ATTEMPTS = 2  # attempts of a read on a bench that records incidents; else 1
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Place:
    """What a driver gets from its bench.

    Attributes:
        link: the link of the device.
        unit: its Modbus unit id, or its CANopen node id.
        settings: the settings of its kind, from its section of the bench file.
        clock: the bench's clock.
    """

    link: Any
    unit: int
    settings: Any
    clock: Clock


class Device:
    """One device of a bench.

    A read changes nothing, so it is tried up to `read_attempts` times until the answer is valid; `noticed` is called
    with each failure. A write is sent once.
    """

    contract: ClassVar[Contract]
    link: ModbusLink | CanLink

    @classmethod
    def at(cls, place: Place) -> Self:
        """Make the driver of a device, not connected yet."""
        raise NotImplementedError

    def __init__(self, name: str) -> None:
        self.name = name
        self.serial = ""
        self.simulated = False
        self.broken = ""  # why it is no longer used; empty: it is used
        self.read_attempts = 1
        self.noticed: Callable[[str], object] = lambda _incident: None
        self.afterwards: Callable[[], object] = lambda: None  # called after each request

    def identify(self) -> None:
        """Check that the contract's device answers, and the same one as before. Raises IdentityError, LinkError."""
        raise NotImplementedError

    def connect(self) -> None:
        """Get ready to use the device; its link is open. Raises as `identify` does."""
        self.identify()

    def set_up(self, settings: Any, watchdog: float) -> None:
        """Write the settings of its section, and the bench's watchdog time-out [s]. Raises LinkError, DeviceError."""

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

    def _value(self, name: str, data: bytes) -> float:
        """Physical value of a field from its bytes. Raises DeviceError: it is outside the limits, or no choice."""
        value = self.contract.decode(name, data)
        if fault := self.contract.misread(name, value):
            raise DeviceError(
                f"{self.name}: reads {fault}; not used. Set it within its limits, or look at its firmware"
            )
        return value

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
