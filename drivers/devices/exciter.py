"""What shakes the stack: a generator and an amplifier, or one device that is both."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from palpate.drivers.devices.device import Device
from palpate.drivers.devices.shaker_amplifier import AmplifierState
from palpate.instrument.contracts.signal_generator import LARGEST_PEAK

QUIET = 10.0, 0.0  # Hz, V: a sine of no amplitude


class Guard(Protocol):
    """The device of an exciter that drops the output when nobody feeds its watchdog."""

    name: str
    owned: bool

    def claim(self) -> bool:
        """Become the owner, or stay it. False: another program owns it and is alive."""

    def release(self) -> None: ...
    def feed(self) -> None: ...
    def live(self) -> None:
        """As `feed`, from a thread of its own, and not said again."""

    def check(self) -> Any:
        """Look at it. Raises SafetyError: it has tripped, or is about to."""

    def enable(self) -> None: ...
    def disable(self) -> None: ...
    def get(self, name: str) -> float:
        """Of its "watchdog" the time-out [s]."""


class Exciter(ABC):
    """Drives the stack, and can be switched off by more than one means.

    Attributes:
        guard: its device that has the watchdog.
        members: its devices, the guard first, which is opened before all other devices of a bench.
        largest: greatest amplitude of its sine [V].
        unit: of its effort.
    """

    guard: Guard
    members: tuple[Device, ...]
    largest: float = LARGEST_PEAK
    unit: str = "A"

    @abstractmethod
    def sine(self, frequency: float, amplitude: float) -> None:
        """Drive with a sine of `frequency` Hz and peak `amplitude` V; the phase runs on."""

    @abstractmethod
    def drive(self) -> None:
        """Switch the outputs on, at zero amplitude. Raises DeviceError: a fault is latched."""

    @abstractmethod
    def rest(self) -> None:
        """Bring the outputs to zero."""

    @abstractmethod
    def quiet(self) -> None:
        """Bring the outputs of all members but the guard to zero."""

    @abstractmethod
    def means(self) -> list[Callable[[], object]]:
        """Each way to switch it off, the safest first."""

    @abstractmethod
    def check(self) -> object:
        """Look at it. Raises SafetyError: it has tripped, or is about to."""

    @abstractmethod
    def effort(self) -> float:
        """Peak of what it drives with now. Raises as `check`."""

    @abstractmethod
    def effort_limit(self) -> float:
        """Peak above which it trips."""

    def switch_off(self) -> list[str]:
        """Switch off by every means there is; returns what failed."""
        failures = []
        for step in self.means():
            try:
                step()
            except Exception as failure:  # of a defect too: the next means must still be tried
                failures.append(str(failure))
        return failures


class Amplified(Exciter):
    """A generator's sine behind an amplifier, which is the guard."""

    def __init__(self, source: Any, amplifier: Any) -> None:
        """`source` has `sine` and `output`, `amplifier` is a `Guard`; both are devices."""
        self._source, self.guard = source, amplifier
        self.members = (amplifier, source)

    def sine(self, frequency: float, amplitude: float) -> None:
        self._source.sine(frequency, amplitude)

    def drive(self) -> None:
        self._source.sine(*QUIET)
        self.guard.enable()
        self._source.output(True)

    def rest(self) -> None:
        self._source.sine(*QUIET)
        self._source.output(False)
        self.guard.disable()

    def quiet(self) -> None:
        self._source.output(False)
        self._source.sine(*QUIET)

    def means(self) -> list[Callable[[], object]]:
        return [self.guard.disable, lambda: self._source.output(False), lambda: self._source.sine(*QUIET)]

    def check(self) -> AmplifierState:
        state: AmplifierState = self.guard.check()
        return state

    def effort(self) -> float:
        """Of the output current [A]."""
        return math.sqrt(2) * self.check().current

    def effort_limit(self) -> float:
        """Of the output current [A]."""
        return self.guard.get("current_limit")
