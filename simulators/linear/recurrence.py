"""The fixed point of a period, from which on the transitions of a piecewise linear system recur.

A path finds transitions to the nanosecond, but a period need not be a whole number of nanoseconds. Here transitions are
found as roots in the phase of the drive. Some slow states may act on no guard, such as amplifiers (called listeners).
From one period to the next they change by the same linear map, which tells their settled state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.simulators.linear.crossing import CrossingWatch
from palpate.simulators.linear.cycle import CLOSE, Cycle, Leg, inputs_at, period_of, periodic
from palpate.simulators.linear.lti import StateSpace
from palpate.simulators.linear.mode import Mode, Stretch
from palpate.simulators.linear.periodic import CYCLE, HERTZ, Periodic

REPEATED = 1e-13  # share of each state's greatest value; a state that is this close one period later has repeated
NEAR = 1e-6  # share of the same, plus the drive's change in 100 ns; from here on the fixed point is searched for
PERIODS = 300  # number of periods within which the fixed point must be found


@dataclass(frozen=True, eq=False)
class PoincareSection:
    """The first nanosecond after a number of periods of the drive, with the stretch that holds it."""

    number: int
    time_ns: int
    stay: Stretch

    def state(self) -> Floats:
        """The state (s,) at the moment at which the drive repeats, at most a nanosecond before."""
        drive, stay = self.stay.steady.inputs[0], self.stay
        late_ns = (drive.frequency * (self.time_ns - drive.start_ns) - self.number * CYCLE) / drive.frequency
        gap = stay.steady.gap(stay.start_ns, stay.state)
        moved = stay.mode.system.motion.moment(gap, self.time_ns - late_ns - stay.start_ns)
        return periodic(stay.steady, 0.0) + moved


@dataclass(frozen=True, eq=False)
class Recurrence:
    """Recurring motion with settled listeners, which begins after a number of periods of the drive.

    Attributes:
        listeners: numbers of the states that no guard sees.
        alone: the system of the listeners by themselves.
        near: (s,), greatest distance of a state from the expected one.
    """

    number: int
    legs: Sequence[Leg]
    listeners: list[int]
    alone: StateSpace
    near: Floats

    def begun(self, now: PoincareSection) -> Cycle | None:
        """The recurring motion from a section on; None: the state there is not the expected one."""
        if not (np.abs(now.state() - self.legs[0].state) <= self.near)[self.seen].all():
            return None
        settled = Cycle(now.time_ns, self.legs, self.listeners, self.alone, np.zeros(len(self.listeners)))
        lag = (settled.state(now.time_ns) - now.stay.moment(now.time_ns))[self.listeners]
        return Cycle(now.time_ns, self.legs, self.listeners, self.alone, lag)

    @property
    def seen(self) -> list[int]:
        """Numbers of the states that guards see."""
        return [k for k in range(len(self.near)) if k not in self.listeners]


def recurrence(
    before: PoincareSection,
    now: PoincareSection,
    stays: Sequence[Stretch],
    largest: Floats,
    watch: Callable[[Mode], tuple[CrossingWatch, list[int]]],
) -> Recurrence | None:
    """Motion that will recur after two sections one period apart; None: they are too far from a fixed point.

    It begins as many periods from here as the search for the fixed point took. What the path finds does not decide it,
    because the path has whole nanoseconds.

    Args:
        before, now: the two sections.
        stays: stays from the one that holds the first section to the one that holds the second.
        largest: (s,), greatest value of each state so far.
        watch: function of a mode that gives the search over its guards and the states on which they depend.
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
    except np.linalg.LinAlgError:  # a system that never forgets its state has no settled one
        return None
    legs, _ = orbit.lived(state)
    if legs is None or not _certain(legs, now.time_ns, watch):
        return None
    return Recurrence(now.number + periods, legs, listeners, alone, near)


class _Orbit:
    """The stays of a period, to be found as phases; `stays` begin and end at whole nanoseconds."""

    def __init__(self, stays: Sequence[Stretch], inputs: tuple[Periodic, ...]) -> None:
        self._inputs = inputs
        drive = inputs[0]
        *ending, self._last = stays
        self._ending = [
            (stay, drive.frequency * (stay.end_ns - drive.start_ns) % CYCLE / CYCLE)
            for stay in ending
            if stay.failed is not None  # skip ends at which only the search was cut off
        ]

    def lived(self, state: Floats) -> tuple[list[Leg] | None, Floats]:
        """Legs of one period from a state (s,), and the state after it. None: a transition is not where it was."""
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


def _certain(legs: Sequence[Leg], start_ns: int, watch: Callable[[Mode], tuple[CrossingWatch, list[int]]]) -> bool:
    """Whether the certified search finds just these transitions in the period from a section on."""
    drive = legs[0].steady.inputs[0]
    period = drive.frequency * (start_ns - drive.start_ns) // CYCLE
    for number, leg in enumerate(legs):
        last = number == len(legs) - 1
        times = [_first_ns(drive, period, cycles) for cycles in (leg.begin, 1.0 if last else legs[number + 1].begin)]
        time_ns, end_ns = max(times[0], start_ns), times[1]
        if time_ns >= end_ns:
            continue  # the leg is shorter than a nanosecond
        search, seen = watch(leg.mode)
        failed: int | None = None
        while failed is None and time_ns < end_ns:
            # This needs the state of exactly this nanosecond, because a play may be very close to being dragged.
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
    """The states on which some states (s,) depend, now or later.

    `linked` (s, s) tells which rate depends on which state.

    """
    for _ in seen:
        seen = seen | (seen @ linked)
    return np.flatnonzero(seen).tolist()
