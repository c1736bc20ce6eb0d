"""The bench's clock. Every wait of palpate goes through one; this is the only file that may sleep."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A clock for waits in bench time."""

    def now_ns(self) -> int:
        """Time since the bench was opened, in integer nanoseconds."""

    def wait(self, duration: float) -> None:
        """Return when `duration` seconds of bench time have passed."""


class BenchClock(Clock, Protocol):
    """The clock with which a bench is opened. `goes_on`: whether time passes even if nobody waits."""

    @property
    def goes_on(self) -> bool: ...


class WallClock:
    """The clock of a real bench, which starts at `begun` [ns]: 0, or the time of a resumed run."""

    goes_on = True

    def __init__(self, begun: int = 0) -> None:
        self._start = time.monotonic_ns() - begun

    def now_ns(self) -> int:
        return time.monotonic_ns() - self._start

    def wait(self, duration: float) -> None:
        time.sleep(max(0.0, duration))
