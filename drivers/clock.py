"""The bench's clock. Every wait of palpate goes through one; this is the only file that may sleep."""

from __future__ import annotations

import time
from typing import Protocol

from palpate.instrument.bench.links import Stepper


class Clock(Protocol):
    """A clock for waits in bench time."""

    def now_ns(self) -> int:
        """Time since the bench was opened, in integer nanoseconds."""

    def wait(self, duration: float) -> None:
        """Return when `duration` seconds of bench time have passed."""


class BenchClock(Clock, Protocol):
    """The clock with which a bench is opened.

    Attributes:
        goes_on: whether time passes even if nobody waits.
        stepper: steps the other end of all links; None: it answers by itself, as real devices do.
    """

    @property
    def goes_on(self) -> bool: ...
    @property
    def stepper(self) -> Stepper | None: ...


class WallClock:
    """The clock of a real bench, which starts at `begun` [ns]: 0, or the time of a resumed run."""

    goes_on = True
    stepper: Stepper | None = None

    def __init__(self, begun: int = 0) -> None:
        self._start = time.monotonic_ns() - begun

    def now_ns(self) -> int:
        return time.monotonic_ns() - self._start

    def wait(self, duration: float) -> None:
        time.sleep(max(0.0, duration))
