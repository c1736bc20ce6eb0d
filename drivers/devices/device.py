"""What the drivers of all devices share: how a question is asked again, and that a broken device is left alone."""

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

READ_ATTEMPTS = 2  # on a bench that is attended; else 1
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Place:
    """Where a device of a bench is: its link and number there, the settings of its section, the clock to wait with."""

    link: Any
    unit: int
    settings: Any
    clock: Clock


class Device:
    """One device of a bench.

    A question changes nothing, so it is asked `read_attempts` times until an answer is valid; `noticed` is told of
    those that were not. An order is given once.
    """

    contract: ClassVar[Contract]
    link: ModbusLink | CanLink

    @classmethod
    def at(cls, place: Place) -> Self:
        """The driver of a device of a bench, not connected yet."""
        raise NotImplementedError

    def __init__(self, name: str) -> None:
        self.name = name
        self.serial = ""
        self.simulated = False
        self.broken = ""  # why it is not to be used any more
        self.read_attempts = 1
        self.noticed: Callable[[str], object] = lambda _incident: None
        self.afterwards: Callable[[], object] = lambda: None  # called when it has been asked or told something

    def identify(self) -> None:
        """Check that it is the device of the contract, and the same as before. Raises IdentityError, LinkError."""
        raise NotImplementedError

    def connect(self) -> None:
        """Get ready to use it, its link being open. Raises as `identify`."""
        self.identify()

    def set_up(self, settings: Any, watchdog: float) -> None:
        """Put the settings of its section into it; `watchdog` s is the bench's. Raises LinkError, DeviceError."""

    def sick(self) -> str:
        """Why it cannot be used though it answers and holds its settings; empty: it can."""
        return ""

    def differences(self) -> list[str]:
        """What it no longer holds as it was written. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def restore(self) -> None:
        """Write again what differs. Raises LinkError, DeviceError."""
        raise NotImplementedError

    def notices(self) -> list[str]:
        """What it has told of itself since the last call."""
        return []

    def _same(self, serial: str) -> str:
        """A serial number that is the one of before, if there was one. Raises IdentityError."""
        if self.serial not in ("", serial):
            raise IdentityError(
                f"{self.name}: has serial number {serial or 'none'}, had {self.serial} before; put the first one back, "
                "or run again"
            )
        return serial

    def _value(self, name: str, data: bytes) -> float:
        """Physical value of a field that was read. Raises DeviceError: outside its limits, or none of its choices."""
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
        """What the order gives; an error of it knows the device."""
        try:
            if self.broken:
                raise DeviceError(f"{self.broken}; it is not used any more in this run")
            answer = order()
        except BenchError as error:
            error.device = self.name
            raise
        self.afterwards()
        return answer
