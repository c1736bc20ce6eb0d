"""What shakes the stack: a generator and an amplifier, or one device that is both."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from palpate.drivers.devices.shaker_amplifier import AmplifierState
from palpate.instrument.contracts.signal_generator import LARGEST_PEAK

QUIET = 10.0, 0.0  # Hz, V: a sine of no amplitude


class Guard(Protocol):
    """The device of an exciter that drops the output when nobody feeds its watchdog.

    `owned`: whether it has an owner, who alone feeds it; else any request does.
    """

    name: str
    owned: bool

    def claim(self) -> bool:
        """Become the owner, or stay it. False: another program owns it and is alive."""

    def release(self) -> None:
        """Give it up; its output is off."""

    def feed(self) -> None: ...
    def live(self) -> None:
        """As `feed`, from a thread of its own, and not said again."""

    def get(self, name: str) -> float:
        """Of its "watchdog" the time-out [s]."""


class Exciter(ABC):
    """Drives the stack, and can be switched off.

    A lab's own device that is an exciter alone derives from this beside `ModbusDevice` or `CanopenDevice`.

    Attributes:
        guard: its device that has a watchdog. None: it has none, so that nothing switches it off when this program is
            killed; then the bench file has to say `watchdog = "none"`. The contract of a device with a watchdog has a
            field of that name.
        largest: greatest amplitude of its sine [V].
        unit: of its effort.
    """

    guard: Guard | None = None
    largest: float = LARGEST_PEAK
    unit: str = "A"

    @property
    def members(self) -> tuple[Any, ...]:
        """Its devices, the guard first. They are opened before all other devices of a bench."""
        return (self,)

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
    def check(self) -> object:
        """Look at it. Raises SafetyError: it has tripped, or is about to."""

    @abstractmethod
    def effort(self) -> float:
        """Peak of what it drives with now. Raises as `check`."""

    @abstractmethod
    def effort_limit(self) -> float:
        """Peak above which it trips."""

    def halt(self) -> None:
        """Stop a bench that was left driving; the first of its members alone is open yet."""
        self.rest()

    def quiet(self) -> object:
        """Bring the outputs of its other members to zero; here there are none."""
        return None

    def means(self) -> list[Callable[[], object]]:
        """Each way to switch it off, the safest first."""
        return [self.rest]

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
    """A generator's sine behind an amplifier."""

    def __init__(self, source: Any, amplifier: Any) -> None:
        """Both are devices: `source` has `sine` and `output`; `amplifier` has `enable`, `disable` and `check`.

        An amplifier that has a watchdog is the `Guard`, too.
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
        """Of the output current [A]."""
        return math.sqrt(2) * self.check().current

    def effort_limit(self) -> float:
        """Of the output current [A]."""
        limit: float = self._amplifier.get("current_limit")
        return limit
