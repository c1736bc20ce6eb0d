"""Bench time from point to point, in a run that has a time to keep."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate.drivers.clock import Clock


class Laps:
    """Bench time from point to point; a run that resumes adds up what its points took."""

    def __init__(self, clock: Clock, timed: bool) -> None:
        """Begin; `timed`: whether the run has a time to keep."""
        self._clock = clock
        self._began_ns = clock.now_ns() if timed else None

    def seconds(self) -> float | None:
        """Bench time since it was asked before, or since the beginning [s]; None: there is no time to keep."""
        if self._began_ns is None:
            return None
        began_ns, self._began_ns = self._began_ns, self._clock.now_ns()
        return 1e-9 * (self._began_ns - began_ns)
