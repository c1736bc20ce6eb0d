"""Transitions that recur: what a piecewise linear system does in every period once its guards see the same again.

Behind what the guards see there can be slow states that only listen, such as amplifiers. They need not have settled:
from one period to the next they change by the same linear map, whose powers are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from simulators.lti import Floats, Periodic, StateSpace

if TYPE_CHECKING:
    from simulators.path import Mode, Stretch

REPEATED = 1e-13  # of the largest that each state has been: so close it is the same one period later
KEPT = 200  # periods whose stretches are kept


@dataclass(frozen=True, eq=False)
class Section:
    """A moment at which the drive has repeated, in the stretch that holds it."""

    time_ns: int
    stay: Stretch

    def state(self) -> Floats:
        """(s,)."""
        return self.stay.moment(self.time_ns)


class Cycle:
    """What recurs from a section on.

    Args:
        stays: of one period, the first and the last cut at its ends.
        state: (s,) at the beginning of the recurrence.
        listeners: the states that no guard sees. gain: how they are by themselves. lag: how far they are, where the
            recurrence begins, from where they will settle.
    """

    def __init__(
        self,
        start_ns: int,
        period_ns: int,
        stays: Sequence[Stretch],
        inputs: tuple[Periodic, ...],
        state: Floats,
        listeners: list[int],
        alone: StateSpace,
        lag: Floats,
    ) -> None:
        self.start_ns = start_ns
        self._period, self._stays, self._inputs = period_ns, stays, inputs
        self._state, self._listeners, self._alone, self._lag = state, listeners, alone, lag
        self._found: dict[int, list[Stretch]] = {}

    def between(self, first_ns: int, last_ns: int) -> list[Stretch]:
        """Stretches of all periods that hold any of the times."""
        first = max((first_ns - self.start_ns) // self._period, 0)
        stays = []
        for number in range(first, (last_ns - self.start_ns) // self._period + 1):
            if number not in self._found:
                self._found[number] = self._live(number)
            stays += self._found[number]
        for number in sorted(self._found)[:-KEPT]:
            del self._found[number]
        return stays

    def _live(self, number: int) -> list[Stretch]:
        """The stretches of one period, whatever others were asked for."""
        elapsed_ns = number * self._period
        begin_ns = self.start_ns + elapsed_ns
        state = self._state.copy()
        if number:
            state[self._listeners] += self._lag - self._alone.motion.moment(self._lag, elapsed_ns)
        lived = []
        for stay in self._stays:
            end_ns = min(stay.end_ns + self._period + elapsed_ns, begin_ns + self._period)
            start_ns = max(stay.start_ns + self._period + elapsed_ns, begin_ns)
            lived.append(replace(stay, start_ns=start_ns, end_ns=end_ns, state=state))
            _, state = lived[-1].after(self._inputs)
        return lived


def recurrence(
    before: Section, now: Section, stays: Sequence[Stretch], largest: Floats, inputs: tuple[Periodic, ...]
) -> Cycle | None:
    """What recurs after two sections one period apart, or None where something is not yet as it was.

    Args:
        stays: from the one that holds the first section to the one that holds the second.
        largest: that each state (s,) has been.
    """
    if before.stay.mode is not now.stay.mode:
        return None
    modes = [stay.mode for stay in stays]
    seen = seen_states(modes)
    was, state = before.state(), now.state()
    if (np.abs(state - was) > REPEATED * largest)[seen].any():
        return None
    listeners = [k for k in range(len(state)) if k not in seen]
    alone = modes[0].system.part(listeners)
    if any((mode.system.part(listeners).a != alone.a).any() for mode in modes):
        return None
    period_ns = now.time_ns - before.time_ns
    once = np.array([alone.motion.moment(column, period_ns) for column in np.eye(len(listeners))]).T
    change = alone.motion.moment((state - was)[listeners], period_ns)
    try:
        lag = np.linalg.solve(np.eye(len(listeners)) - once, change) if listeners else change
    except np.linalg.LinAlgError:  # a listener that forgets nothing has no state to settle at
        return None
    return Cycle(now.time_ns, period_ns, stays, inputs, state, listeners, alone, lag)


def seen_states(modes: Sequence[Mode]) -> list[int]:
    """The states that guards of these modes depend on, now or later."""
    size = modes[0].system.order
    linked = np.zeros((size, size), bool)
    seen = np.zeros(size, bool)
    for mode in modes:
        linked |= mode.system.a != 0
        for guard in mode.guards:
            seen |= guard.row[0][0] != 0
    for _ in range(size):
        seen = seen | (seen @ linked)
    return [int(k) for k in np.flatnonzero(seen)]
