"""The fixed point of a period: from where on the transitions of a piecewise linear system recur.

A path finds transitions to the nanosecond, and a period need not be a whole number of them: here they are found as
phases of the drive, as roots. Behind what the guards see there can be slow states that only listen, such as
amplifiers. From one period to the next they change by the same linear map, which says how they will settle.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.simulators.linear.crossing import Watch
from palpate.simulators.linear.cycle import CLOSE, Cycle, Leg, inputs_at, period_of, periodic
from palpate.simulators.linear.lti import Floats, StateSpace
from palpate.simulators.linear.mode import Mode, Stretch
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic

REPEATED = 1e-13  # of the largest that each state has been: so close it is the same one period later
NEAR = 1e-6  # of the same, beside what a drive changes in 100 ns: from here on the fixed point is looked for
PERIODS = 300  # in which it must be found


@dataclass(frozen=True, eq=False)
class Section:
    """The first nanosecond after so many periods of the drive, in the stretch that holds it."""

    number: int
    time_ns: int
    stay: Stretch

    def state(self) -> Floats:
        """(s,) as the drive has repeated, at most a nanosecond before."""
        drive, stay = self.stay.steady.inputs[0], self.stay
        late_ns = (drive.frequency * (self.time_ns - drive.start_ns) - self.number * CYCLE) / drive.frequency
        gap = stay.steady.gap(stay.start_ns, stay.state)
        moved = stay.mode.system.motion.moment(gap, self.time_ns - late_ns - stay.start_ns)
        return periodic(stay.steady, 0.0) + moved


@dataclass(frozen=True, eq=False)
class Recurrence:
    """What recurs, with listeners as they will settle, once so many periods of the drive have passed.

    listeners: the states that no guard sees. alone: how they are by themselves. near: as far as a state (s,) may be.
    """

    number: int
    legs: Sequence[Leg]
    listeners: list[int]
    alone: StateSpace
    near: Floats

    def begun(self, now: Section) -> Cycle | None:
        """From a section on; None where it is not what it was to be."""
        if not (np.abs(now.state() - self.legs[0].state) <= self.near)[self.seen].all():
            return None
        settled = Cycle(now.time_ns, self.legs, self.listeners, self.alone, np.zeros(len(self.listeners)))
        lag = (settled.state(now.time_ns) - now.stay.moment(now.time_ns))[self.listeners]
        return Cycle(now.time_ns, self.legs, self.listeners, self.alone, lag)

    @property
    def seen(self) -> list[int]:
        """The other states."""
        return [k for k in range(len(self.near)) if k not in self.listeners]


def recurrence(
    before: Section,
    now: Section,
    stays: Sequence[Stretch],
    largest: Floats,
    watch: Callable[[Mode], tuple[Watch, list[int]]],
) -> Recurrence | None:
    """What will recur after two sections one period apart, or None where they are too far from it.

    It begins when the fixed point has been reached as nearly as it can be: not by what the path finds, which is of
    whole nanoseconds, but by as many periods from here as it took to find it.

    Args:
        stays: from the one that holds the first section to the one that holds the second.
        largest: that each state (s,) has been.
        watch: over the guards of a mode, and the states that it looks at.
    """
    inputs = now.stay.steady.inputs
    modes = [stay.mode for stay in stays]
    if before.stay.mode is not now.stay.mode or any(mode.system.motion.modes is None for mode in modes):
        return None
    seen = seen_states(modes)
    listeners = [k for k in range(len(largest)) if k not in seen]
    near = (NEAR + 1e-7 * inputs[0].frequency / HERTZ) * largest
    state = now.state()
    if (np.abs(state - before.state()) > near)[seen].any():
        return None
    alone = modes[0].system.part(listeners)
    if any((its.a != alone.a).any() or (its.c != alone.c).any() for its in (m.system.part(listeners) for m in modes)):
        return None
    orbit = _Orbit(stays, inputs)
    periods, settled = 0, False
    while not settled:
        legs, after = orbit.lived(state)
        periods += 1
        if legs is None or periods > PERIODS:
            return None
        settled = bool((np.abs(after - state) <= REPEATED * largest)[seen].all())
        if not settled:
            state[seen] = after[seen]
    once = np.array([alone.motion.moment(column, period_of(inputs)) for column in np.eye(len(listeners))]).T
    change = (after - state)[listeners]
    try:
        state[listeners] += np.linalg.solve(np.eye(len(listeners)) - once, change) if listeners else change
    except np.linalg.LinAlgError:  # a listener that forgets nothing has no state to settle at
        return None
    legs, _ = orbit.lived(state)
    if legs is None or not _certain(legs, now.time_ns, watch):
        return None
    return Recurrence(now.number + periods, legs, listeners, alone, near)


class _Orbit:
    """The stays of a period, as phases: `stays` begin and end at the nanosecond."""

    def __init__(self, stays: Sequence[Stretch], inputs: tuple[Periodic, ...]) -> None:
        self._inputs = inputs
        drive = inputs[0]
        *ending, self._last = stays
        self._ending = [
            (stay, drive.frequency * (stay.end_ns - drive.start_ns) % CYCLE / CYCLE)
            for stay in ending
            if stay.failed is not None  # not where only the search ended
        ]

    def lived(self, state: Floats) -> tuple[list[Leg] | None, Floats]:
        """One period from a state (s,); None where a transition is not where it was."""
        begin, legs = 0.0, []
        for stay, near in self._ending:
            assert stay.failed is not None
            leg = Leg(begin, stay.mode, stay.steady, state, stay.failed)
            end = leg.end(near)
            if end is None or end > 1:
                return None, state
            state = leg.moment(end)
            if stay.failed.entry is not None:
                state = stay.failed.entry(state, inputs_at(self._inputs, end)[0])
            legs.append(leg)
            begin = end
        legs.append(Leg(begin, self._last.mode, self._last.steady, state, None))
        return legs, legs[-1].moment(1.0)


def _certain(legs: Sequence[Leg], start_ns: int, watch: Callable[[Mode], tuple[Watch, list[int]]]) -> bool:
    """Whether the search, too, finds these transitions and no others, in the period from a section on."""
    drive = legs[0].steady.inputs[0]
    period = drive.frequency * (start_ns - drive.start_ns) // CYCLE
    for number, leg in enumerate(legs):
        last = number == len(legs) - 1
        times = [_first_ns(drive, period, cycles) for cycles in (leg.begin, 1.0 if last else legs[number + 1].begin)]
        time_ns, end_ns = max(times[0], start_ns), times[1]
        if time_ns >= end_ns:
            continue  # shorter than a nanosecond
        search, seen = watch(leg.mode)
        failed: int | None = None
        while failed is None and time_ns < end_ns:
            # Of just this nanosecond: a play lies a billionth of its radius from being dragged.
            cycles = (drive.frequency * (time_ns - drive.start_ns) - period * CYCLE) / CYCLE
            time_ns, failed = search.first_failure(time_ns, leg.moment(cycles)[seen])
        if last:
            if time_ns < end_ns - CLOSE:
                return False
        elif failed is None or leg.mode.guards[failed] is not leg.failed or abs(time_ns - end_ns) > CLOSE:
            return False
    return True


def _first_ns(drive: Periodic, period: int, cycles: float) -> int:
    """The first nanosecond at or after a phase of a period of the drive."""
    return drive.start_ns - (-(period * CYCLE + round(cycles * CYCLE)) // drive.frequency)


def seen_states(modes: Sequence[Mode]) -> list[int]:
    """The states that guards of these modes depend on, now or later."""
    size = modes[0].system.order
    linked = np.zeros((size, size), bool)
    seen = np.zeros(size, bool)
    for mode in modes:
        linked |= mode.system.a != 0
        for guard in mode.guards:
            seen |= guard.row[0][0] != 0
    return depended_on(seen, linked)


def depended_on(seen: npt.NDArray[np.bool_], linked: npt.NDArray[np.bool_]) -> list[int]:
    """The states on which some (s,) depend, now or later; linked: (s, s), whose rate depends on which."""
    for _ in seen:
        seen = seen | (seen @ linked)
    return np.flatnonzero(seen).tolist()
