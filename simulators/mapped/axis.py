"""A simulated axis: it speeds up, goes at a constant speed, and slows down."""

from __future__ import annotations

import math

from palpate.simulators.clock import NEVER


class Axis:
    """Position of an axis over time [step]; times are those of the bench's clock [ns]."""

    def __init__(self) -> None:
        self._from = self._to = 0.0
        self._begun_ns = 0
        self._speed = self._up = self._down = math.inf
        self.ends_ns = NEVER

    @property
    def moving(self) -> bool:
        return self.ends_ns != NEVER

    @property
    def goal(self) -> float:
        return self._to

    def put(self, position: float) -> None:
        """Stand at a position, which counts differently from now on."""
        self._from = self._to = position
        self.ends_ns = NEVER

    def go(self, now_ns: int, goal: float, speed: float, up: float, down: float) -> None:
        """Go to `goal` at a speed [step/s], with these accelerations [step/s²]."""
        self._from, self._to, self._begun_ns = self.at(now_ns), goal, now_ns
        distance = abs(self._to - self._from)
        peak = math.sqrt(2 * distance / (1 / up + 1 / down)) if up < math.inf or down < math.inf else math.inf
        self._speed, self._up, self._down = min(speed, peak), up, down
        self.ends_ns = now_ns + round(1e9 * self._duration()) if distance else NEVER

    def _duration(self) -> float:
        v, distance = self._speed, abs(self._to - self._from)
        return distance / v + v / 2 * (1 / self._up + 1 / self._down)

    def at(self, now_ns: int) -> float:
        """Position at a time [step]."""
        if not self.moving:
            return self._to
        passed = 1e-9 * (now_ns - self._begun_ns)
        v, distance, whole = self._speed, abs(self._to - self._from), self._duration()
        if passed >= whole:
            return self._to
        if passed < v / self._up:
            gone = self._up * passed**2 / 2
        elif whole - passed < v / self._down:
            gone = distance - self._down * (whole - passed) ** 2 / 2
        else:
            gone = v * (passed - v / self._up / 2)
        return self._from + math.copysign(gone, self._to - self._from)

    def stop(self, now_ns: int) -> None:
        """Stop where it is."""
        self.put(round(self.at(now_ns)))

    def arrive(self) -> None:
        """Stand at the goal."""
        self.put(self._to)
