"""What a piecewise linear system does from one change of its settings to the next.

A mode is a linear system with guards: outputs that stay at or above zero while it lasts. Where a guard fails the
next mode begins with the state that the last one left. Inside a mode everything is known in closed form, and so
is the guarantee that a guard never fails; only where it may fail is its first failure looked for.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from simulators.lti import HERTZ, SECOND, Floats, Periodic, Rows, StateSpace, Steady, Times, Trace

LOOKS = 64  # at a guard in each period of the drive, and at first in each decade of time
DECADES = 9  # of nanoseconds in which a transient is looked at before the drive alone is
NEVER = 2**63 - 1
LONGEST = 100 * SECOND  # that stands for the period of a drive of 0 Hz
KEPT_NS = 12 * SECOND  # how far back stretches are kept: the indicator looks back 10 s at most


@dataclass(frozen=True, eq=False)
class Guard:
    """What stays at or above zero, and what follows when it does not.

    entry: from state (s,) and inputs (m,) at the end to the state that the following mode begins with; None: the same.
    """

    row: Rows
    following: Callable[[], Mode]
    entry: Callable[[Floats, Floats], Floats] | None = None


@dataclass(frozen=True, eq=False)
class Mode:
    """A linear system from all inputs to all outputs, as long as its guards hold; `touch` tells it from the others."""

    touch: Any
    system: StateSpace
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stay in one mode from `start_ns`, from a state (s,), up to `end_ns`, when a guard failed."""

    start_ns: int
    end_ns: int
    mode: Mode
    steady: Steady
    state: Floats
    failed: Guard | None


class Path:
    """The stretches since a change, found as far as someone looks; what is found does not depend on who looks when.

    Args:
        inputs: (m,) periodic functions of time that start at the change.
        mode: at the change.
        state: (s,) at the change.
    """

    def __init__(self, inputs: tuple[Periodic, ...], mode: Mode, start_ns: int, state: Floats) -> None:
        self._inputs = inputs
        self._steady: dict[int, Steady] = {}
        self._modes: list[Mode] = []
        self.start_ns = start_ns
        self._stretches = [self._stay(mode, start_ns, state)]

    def outputs(self, time_ns: Times, rows: slice) -> Floats:
        """Some of the outputs (rows, n) at times from the change on, in ascending order."""

        def of(stay: Stretch, times: Times) -> Floats:
            system = stay.steady.system
            return stay.steady.trace((system.c[rows], system.d[rows]), stay.start_ns, stay.state).at(times)

        return self._collect(time_ns, of)

    def rates(self, time_ns: Times, rows: slice) -> Floats:
        """Rates of some of the outputs (rows, n) [1/s] at times from the change on, in ascending order."""

        def of(stay: Stretch, times: Times) -> Floats:
            system = stay.mode.system
            # Of the inputs, the first alone changes; the last is its rate.
            direct = np.outer(system.d[rows, 0], [0.0] * (len(self._inputs) - 1) + [1.0])
            row = (system.c[rows] @ system.a, system.c[rows] @ system.b + direct)
            return stay.steady.trace(row, stay.start_ns, stay.state).at(times)

        return self._collect(time_ns, of)

    def states(self, time_ns: Times) -> Floats:
        """State (s, n) at times from the change on, in ascending order."""
        return self._collect(time_ns, lambda s, t: s.steady.state(s.start_ns, s.state, t))

    def mode_at(self, time_ns: int) -> Mode:
        """The mode at a time from the change on."""
        self._extend(time_ns)
        return next(s.mode for s in reversed(self._stretches) if s.start_ns <= time_ns)

    def modes_until(self, time_ns: int) -> list[Mode]:
        """Modes of the kept stretches up to a time, one after the other."""
        self._extend(time_ns)
        return [s.mode for s in self._stretches if s.start_ns <= time_ns]

    def _collect(self, time_ns: Times, of: Callable[[Stretch, Times], Floats]) -> Floats:
        self._extend(int(time_ns[-1]))
        starts = np.array([s.start_ns for s in self._stretches])
        index = np.maximum(np.searchsorted(starts, time_ns, side="right") - 1, 0)
        pieces = []
        for number in np.unique(index):
            pieces.append(of(self._stretches[number], time_ns[index == number]))
        return np.concatenate(pieces, axis=1)

    def _extend(self, until_ns: int) -> None:
        while self._stretches[-1].end_ns <= until_ns:
            last = self._stretches[-1]
            state = last.steady.state(last.start_ns, last.state, np.array([last.end_ns]))[:, 0]
            assert last.failed is not None
            if last.failed.entry is not None:
                inputs = np.array([each.at(np.array([last.end_ns]))[0] for each in self._inputs])
                state = last.failed.entry(state, inputs)
            self._stretches.append(self._stay(last.failed.following(), last.end_ns, state))
        while len(self._stretches) > 1 and self._stretches[1].start_ns < until_ns - KEPT_NS:
            self._stretches.pop(0)

    def _stay(self, mode: Mode, start_ns: int, state: Floats) -> Stretch:
        if id(mode) not in self._steady:
            self._steady[id(mode)] = mode.system.drive(self._inputs)
            self._modes.append(mode)  # keeps the identity alive
        steady = self._steady[id(mode)]
        end_ns, failed = self._first_failure(mode, steady, start_ns, state)
        return Stretch(start_ns, end_ns, mode, steady, state, failed)

    def _first_failure(self, mode: Mode, steady: Steady, start_ns: int, state: Floats) -> tuple[int, Guard | None]:
        """When the first guard fails, and which."""
        first: tuple[int, Guard | None] = (NEVER, None)
        now = np.array([start_ns])
        for guard in mode.guards:
            trace = steady.trace(guard.row, start_ns, state)
            if trace.at(now)[0, 0] < 0:
                return start_ns, guard
            if trace.least() >= 0:
                continue
            end_ns = _search(trace, steady.inputs[0], first[0])
            if end_ns < first[0]:
                first = (end_ns, guard)
        return first


def _search(trace: Trace, drive: Periodic, before_ns: int) -> int:
    """The first nanosecond after the start at which a trace is below zero, or NEVER before `before_ns`."""

    def value(time_ns: Times) -> Floats:
        seen: Floats = trace.at(time_ns)[0]
        return seen

    period = round(SECOND * HERTZ / drive.frequency) if drive.frequency else LONGEST
    looks = LOOKS * int(drive.order.max(initial=1))
    cycle = trace.start_ns + np.arange(1, looks + 1, dtype=np.int64) * period // looks
    # A transient that could still hide a failure of the settled guard, or cause one, is looked through.
    margin = max(float(trace.settled(cycle).min()), 0.0)
    grid = np.concatenate([[trace.start_ns], cycle])
    if trace.fading:
        early = np.geomspace(1, period, DECADES * LOOKS).astype(np.int64)
        grid = np.unique(np.concatenate([grid, trace.start_ns + early]))
    while grid[0] < before_ns:
        found = _first_below(value, grid, trace.swing(2) + trace.transient(int(grid[0]), 2))
        if found is not None:
            return found
        if margin > 0 and trace.transient(int(grid[-1])) <= margin:
            return NEVER
        cycle = cycle + period
        grid = np.concatenate([grid[-1:], cycle])
    return NEVER


def _first_below(value: Callable[[Times], Floats], grid: Times, bend: float) -> int | None:
    """The first integer time after grid[0] at which `value` is below zero, dips between the looks included.

    bend: bound of its second derivative: a dip is no deeper below the look beside it than half of it times the
    distance squared.
    """
    seen = value(grid)
    step = 1e-9 * np.diff(grid)
    depth = bend / 2 * np.maximum(step[:-1], step[1:]) ** 2
    middle = seen[1:-1]
    dips = (middle < seen[:-2]) & (middle <= seen[2:]) & (middle >= 0) & (middle < depth)
    for k in np.flatnonzero((seen[1:] < 0) | np.append(dips, False)) + 1:
        if seen[k] < 0:
            return _bisect(value, int(grid[k - 1]), int(grid[k]))
        lowest = _lowest(value, int(grid[k - 1]), int(grid[k + 1]))
        if value(np.array([lowest]))[0] < 0:
            return _bisect(value, int(grid[k - 1]), lowest)
    return None


def _bisect(value: Callable[[Times], Floats], above: int, below: int) -> int:
    """The first integer time in ]above, below] where `value` is below zero, for one crossing between them."""
    while below - above > 1:
        points = np.unique(np.linspace(above, below, 17).astype(np.int64))[1:-1]
        under = np.flatnonzero(value(points) < 0)
        if len(under):
            below = int(points[under[0]])
            if under[0] > 0:
                above = int(points[under[0] - 1])
        else:
            above = int(points[-1])
    return below


def _lowest(value: Callable[[Times], Floats], low: int, high: int) -> int:
    """An integer time near the lowest value between two times, for one dip between them."""
    while high - low > 16:
        points = np.linspace(low, high, 9).astype(np.int64)
        k = int(np.argmin(value(points)))
        low, high = int(points[max(k - 1, 0)]), int(points[min(k + 1, 8)])
    points = np.arange(low, high + 1)
    return int(points[np.argmin(value(points))])
