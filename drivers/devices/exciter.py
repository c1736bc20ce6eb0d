"""What every exciter is to a bench: it drives the stack, and can be switched off."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from palpate.instrument.contracts.signal_generator import LARGEST_PEAK


class WatchdogGuard(Protocol):
    """The device of an exciter that switches the output off when its watchdog is not fed.

    Attributes:
        name: its name.
        owned: whether only its owner feeds the watchdog; else any request does.
    """

    name: str
    owned: bool

    def claim(self) -> bool:
        """Become or stay the owner. Returns False if another program owns it and is alive."""

    def release(self) -> None:
        """Give the ownership up, which switches the output off."""

    def feed(self) -> None:
        """Feed the watchdog, with a second attempt if it is not confirmed."""

    def live(self) -> None:
        """Feed the watchdog from the heartbeat's thread, with a single attempt."""

    def get(self, name: str) -> float:
        """The value of a field; "watchdog" is the time-out [s]."""


class Exciter(ABC):
    """Drives the stack, and can be switched off.

    The driver of a lab's own single-device exciter inherits from this and from `ModbusDevice` or `CanopenDevice`.

    Attributes:
        guard: its device with a watchdog, whose contract has a field `watchdog`. None: nothing switches the exciter off
            when this program is killed; the bench file must then say `watchdog = "none"`.
        largest: greatest amplitude of its sine [V].
        unit: unit of its effort.
    """

    guard: WatchdogGuard | None = None
    largest: float = LARGEST_PEAK
    unit: str = "A"

    @property
    def members(self) -> tuple[Any, ...]:
        """Its devices, the guard first; a bench opens them before all other devices."""
        return (self,)

    @abstractmethod
    def sine(self, frequency: float, amplitude: float) -> None:
        """Drive with a sine of `frequency` [Hz] and peak `amplitude` [V], with a continuous phase."""

    @abstractmethod
    def drive(self) -> None:
        """Switch the outputs on, at zero amplitude. Raises DeviceError: a fault is latched."""

    @abstractmethod
    def rest(self) -> None:
        """Bring the outputs to zero."""

    @abstractmethod
    def check(self) -> object:
        """Check its state. Raises SafetyError: it has tripped, or is close to its limits."""

    @abstractmethod
    def effort(self) -> float:
        """Present peak of its effort, such as the current, in `unit`. Raises as `check` does."""

    @abstractmethod
    def effort_limit(self) -> float:
        """Peak effort above which it trips, in `unit`."""

    def halt(self) -> None:
        """Stop a bench that was left driving; only the first member is open at this time."""
        self.rest()

    def quiet(self) -> object:
        """Bring the outputs of its other members to zero; by default there are none."""
        return None

    def means(self) -> list[Callable[[], object]]:
        """All ways to switch it off, the safest first."""
        return [self.rest]
