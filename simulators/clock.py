"""The clock of a simulated bench: a wait moves the scene on and returns at once."""

from __future__ import annotations

import math
import threading
from contextlib import AbstractContextManager
from typing import Any, Protocol

NEVER = 2**63 - 1


class Simulated(Protocol):
    """Something that lives on the virtual clock."""

    def next_event_ns(self) -> int:
        """When something happens to it by itself next, or NEVER."""

    def advance(self, start_ns: int, end_ns: int) -> None:
        """Live through (start, end]; nothing else in the scene changes meanwhile, except at `end`."""


class VirtualClock:
    """Integer nanoseconds since the bench was opened.

    Everything simulated changes under `lock` only: in a wait, in the waiting thread, or in a request, in a
    server's thread. Between two events all advance in one step, in the order in which they were added, so
    the result does not depend on how a wait is cut into pieces.
    """

    goes_on = False  # for whoever waits on it; a served one is moved on by the pacer

    def __init__(self) -> None:
        self.lock: AbstractContextManager[Any] = threading.RLock()
        self._now = 0
        self._simulated: list[Simulated] = []

    def add(self, simulated: Simulated) -> None:
        self._simulated.append(simulated)

    def remove(self, simulated: Simulated) -> None:
        """It lives no more on this clock; called under the lock."""
        self._simulated = [other for other in self._simulated if other is not simulated]

    def now_ns(self) -> int:
        return self._now

    def wait(self, duration: float) -> None:
        """Let `duration` s pass. Raises ValueError for a negative or not finite one."""
        if not (math.isfinite(duration) and duration >= 0):
            raise ValueError(f"cannot wait {duration} s; a wait is finite and not negative")
        with self.lock:
            target = self._now + round(duration * 1e9)
            while self._now < target:
                step = min([target, *(s.next_event_ns() for s in self._simulated)])
                start, self._now = self._now, step
                for simulated in self._simulated:
                    simulated.advance(start, step)
