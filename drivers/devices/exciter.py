"""The exciter, which shakes the stack: a generator with an amplifier, or one device that is both."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from palpate.drivers.devices.shaker_amplifier import AmplifierState
from palpate.instrument.contracts.signal_generator import LARGEST_PEAK

QUIET = 10.0, 0.0  # Hz, V: a sine with no amplitude


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


class Amplified(Exciter):
    """An exciter of a generator and an amplifier."""

    def __init__(self, source: Any, amplifier: Any) -> None:
        """Make an exciter of two devices.

        Args:
            source: the generator, with `sine` and `output`.
            amplifier: the amplifier, with `enable`, `disable` and `check`. With a watchdog it is the `WatchdogGuard`,
                too.
        """
        self._source, self._amplifier = source, amplifier
        self.guard = amplifier if amplifier.contract.has("watchdog") else None

    @property
    def members(self) -> tuple[Any, ...]:
        return self._amplifier, self._source

    def sine(self, frequency: float, amplitude: float) -> None:
        self._source.sine(frequency, amplitude)

    def drive(self) -> None:
        self._source.sine(*QUIET)
        self._amplifier.enable()
        self._source.output(True)

    def rest(self) -> None:
        self._source.sine(*QUIET)
        self._source.output(False)
        self._amplifier.disable()

    def halt(self) -> None:
        self._amplifier.disable()

    def quiet(self) -> None:
        self._source.output(False)
        self._source.sine(*QUIET)

    def means(self) -> list[Callable[[], object]]:
        return [self._amplifier.disable, lambda: self._source.output(False), lambda: self._source.sine(*QUIET)]

    def check(self) -> AmplifierState:
        state: AmplifierState = self._amplifier.check()
        return state

    def effort(self) -> float:
        """Peak of the output current [A]."""
        return math.sqrt(2) * self.check().current

    def effort_limit(self) -> float:
        """Peak output current at which the amplifier trips [A]."""
        limit: float = self._amplifier.get("current_limit")
        return limit
