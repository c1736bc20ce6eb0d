"""Recurring transitions as phases of the drive: the motion of a piecewise linear system in every period.

Samples of many periods are computed together in closed form, each by the stay to which its phase belongs. Slow states
that act on no other state, such as amplifiers (called listeners), need not have settled: their distance from the
settled state decays by itself.
"""

from __future__ import annotations

import functools
import itertools
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.simulators.linear.crossing import CrossingWatch
from palpate.simulators.linear.free_motion import Seen
from palpate.simulators.linear.lti import Rows, StateSpace, Steady, Trace
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic

# --- modes ---------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Guard:
    """An output that stays at or above zero while a mode lasts, and the mode that follows when it does not.

    `entry` is a function of state (s,) and inputs (m,) at the end that gives the first state of the following mode;
    None: the state stays.
    """

    row: Rows
    following: Callable[[], Mode]
    entry: Callable[[Floats, Floats], Floats] | None = None


@dataclass(frozen=True, eq=False)
class Mode:
    """A linear system from all inputs to all outputs, valid as long as its guards hold. `touch` tells modes apart."""

    touch: Any
    system: StateSpace
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stay in one mode, from `start_ns` and a state (s,) to `end_ns`, when a guard fails.

    `traces` keeps the functions of time that were asked for, by name and rows.
    """

    start_ns: int
    end_ns: int
    mode: Mode
    steady: Steady
    state: Floats
    failed: Guard | None
    traces: dict[tuple[str, int, int], Trace] = field(default_factory=dict, init=False)

    def trace(self, name: str, rows: slice, row: Callable[[StateSpace], Rows]) -> Trace:
        """Some of the system's outputs, or functions of them, for all times of the stay."""
        key = (name, rows.start, rows.stop)
        if key not in self.traces:
            self.traces[key] = self.steady.trace(row(self.mode.system), self.start_ns, self.state)
        return self.traces[key]

    def moment(self, time_ns: int) -> Floats:
        """The state (s,) at a time of the stay."""
        return self.steady.moment(self.start_ns, self.state, time_ns)

    def after(self, inputs: tuple[Periodic, ...]) -> tuple[Mode, Floats]:
        """The mode and the state that follow; the same mode where only the search was cut off."""
        state = self.moment(self.end_ns)
        if self.failed is None:
            return self.mode, state
        if self.failed.entry is not None:
            state = self.failed.entry(state, np.array([each.now(self.end_ns) for each in inputs]))
        return self.failed.following(), state


# --- recurrence ----------------------------------------------------------------------------------------

# A path finds transitions to the nanosecond, but a period need not be a whole number of nanoseconds. Here transitions
# are found as roots in the phase of the drive. Some slow states may act on no guard, such as amplifiers (called
# listeners). From one period to the next they change by the same linear map, which tells their settled state.


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


# --- the cycle -----------------------------------------------------------------------------------------


STEPS = 8  # greatest number of Newton steps, from a root that is known to the nanosecond
CLOSE = 10.0  # ns; greatest distance of a root from the nanosecond at which it was found
LOST = 1e-13  # share of an output's size to which the period is known
LEAST = -100.0  # exponent below which a mode has decayed


@dataclass(frozen=True, eq=False)
class Leg:
    """A stay in each period, from a phase [cycles after the drive's first] and a state (s,) until a guard fails."""

    begin: float
    mode: Mode
    steady: Steady
    state: Floats
    failed: Guard | None

    @functools.cached_property
    def modes(self) -> tuple[Complexes, Complexes, Complexes]:
        """Rates (m,), shapes (s, m) and their inverse (m, s) of the modes that turn forward or not at all.

        Those that turn come first; each counts for both of its pair.
        """
        modes = self.mode.system.motion.modes
        assert modes is not None
        rates, shapes, inverse = modes
        order = np.lexsort((rates.real, -rates.imag))
        order = order[rates.imag[order] >= 0]
        return rates[order], shapes[:, order] * np.where(rates.imag[order] > 0, 2.0, 1.0), inverse[order]

    def moment(self, cycles: float) -> Floats:
        """The state (s,) at a phase."""
        gap = self.state - periodic(self.steady, self.begin)
        elapsed_ns = (cycles - self.begin) * period_of(self.steady.inputs)
        state: Floats = periodic(self.steady, cycles) + self.mode.system.motion.moment(gap, elapsed_ns)
        return state

    def end(self, near: float) -> float | None:
        """The phase at which the guard fails, from a phase within nanoseconds of it; None: it does not fail there."""
        assert self.failed is not None
        (row,), (inputs,) = self.failed.row
        system, period_ns = self.mode.system, period_of(self.steady.inputs)
        cycles = near
        at_once = abs(self.begin - near) <= CLOSE / period_ns
        if at_once and float(row @ self.state + inputs @ inputs_at(self.steady.inputs, self.begin)[0]) < 0:
            return self.begin
        for _ in range(STEPS):
            state, (u, rates) = self.moment(cycles), inputs_at(self.steady.inputs, cycles)
            slope = float(row @ (system.a @ state + system.b @ u) + inputs @ rates) * period_ns / SECOND
            if not slope:
                return None
            step = float(row @ state + inputs @ u) / slope
            cycles -= step
            if not abs(cycles - near) <= CLOSE / period_ns:
                return None
            if abs(step) <= 1e-16:
                break
        return max(cycles, self.begin)


def period_of(inputs: tuple[Periodic, ...]) -> float:
    """Period of the drive [ns]."""
    return SECOND * HERTZ / inputs[0].frequency


def _turns(inputs: tuple[Periodic, ...], cycles: float) -> list[Complexes | None]:
    """Factors by which the harmonics of each input have turned; None: it has none."""
    turns: list[Complexes | None] = []
    found: dict[tuple[int, int], Complexes] = {}
    for u in inputs:
        key = id(u.order), u.start_phase
        if len(u.order) and key not in found:
            found[key] = np.exp(2j * np.pi * ((u.start_phase / CYCLE + cycles) * u.order))
        turns.append(found.get(key))
    return turns


def inputs_at(inputs: tuple[Periodic, ...], cycles: float) -> tuple[Floats, Floats]:
    """Values (m,) and rates (m,) of the inputs at a phase."""
    values, rates = [], []
    for u, turn in zip(inputs, _turns(inputs, cycles), strict=True):
        if turn is None:
            values.append(u.mean)
            rates.append(0.0)
            continue
        waves = u.amplitude * turn
        values.append(u.mean + float(waves.sum().real))
        rates.append(float((2j * np.pi * (u.frequency / HERTZ) * u.order * waves).sum().real))
    return np.array(values), np.array(rates)


def periodic(steady: Steady, cycles: float) -> Floats:
    """The state (s,) without the transient, at a phase."""
    state = steady.mean.copy()
    for waves, turn in zip(steady.waves, _turns(steady.inputs, cycles), strict=True):
        if turn is not None:
            state += (waves @ turn).real
    return state


@dataclass(frozen=True, eq=False)
class CycleTable:
    """Functions of time: their means (p, l) in all legs, and their weights (p, l) on waves, by the waves' numbers.

    `lag` is their distance from the settled functions, from the start on.
    """

    means: Floats
    waves: dict[int, Floats]
    lag: Seen


class Moments:
    """Times with the values of waves: cosines and sines of the drive, then two waves for each of the legs' modes.

    `legs` (n,) is the leg of each time.
    """

    def __init__(self, legs: npt.NDArray[np.int64], since: Floats, turns: Floats, rates: Sequence[Complexes]) -> None:
        self.legs = legs
        self._since, self._rates, self._turns = since, rates, len(turns)
        self._waves = dict(enumerate(turns))

    def wave(self, number: int) -> Floats:
        """Values (n,) of a wave, by its number."""
        if number not in self._waves:
            mode = (number - self._turns) // 2
            rates, cosine = self._rates[mode], self._turns + 2 * mode
            decay = self._exponent(rates.real)
            np.exp(np.maximum(decay, LEAST, out=decay), out=decay)
            if rates.imag.any():
                angle = self._exponent(rates.imag)
                self._waves[cosine], self._waves[cosine + 1] = decay * np.cos(angle), decay * np.sin(angle)
            else:
                self._waves[cosine] = decay
        wave: Floats = self._waves[number]
        return wave

    def _exponent(self, rates: Floats) -> Floats:
        """Exponents (n,) at the times, of rates (l,) in the legs."""
        exponent = rates.take(self.legs, mode="clip")
        exponent *= self._since
        return exponent


class Cycle:
    """Motion that recurs from `start_ns` on.

    Args:
        legs: legs of one period, with settled listeners.
        listeners: numbers of the states that no guard sees.
        alone: the system of the listeners by themselves.
        lag: distance of the listeners at the start from their settled states.
    """

    def __init__(
        self, start_ns: int, legs: Sequence[Leg], listeners: list[int], alone: StateSpace, lag: Floats
    ) -> None:
        self.start_ns = start_ns
        self._legs, self._listeners, self._alone, self._lag = legs, listeners, alone, lag
        self.begins = np.array([leg.begin for leg in legs])
        self._inputs = legs[0].steady.inputs
        self._since_start = replace(self._inputs[0], start_phase=0)
        one = np.eye(len(self._inputs[0].order))
        self._cosines_and_sines = np.concatenate([one, -1j * one])
        # rates (l,) of the first mode in each leg, of the second one, ...; 0 where there is none
        own = itertools.zip_longest(*(leg.modes[0].tolist() for leg in legs), fillvalue=0j)
        self._rates = [np.array(rates) for rates in own]
        self._tables: dict[tuple[str, int, int], CycleTable] = {}
        self._last: dict[tuple[int, int, int, int], Moments] = {}

    def at(self, name: str, rows: slice, row: Callable[[StateSpace], Rows], time_ns: Times, step_ns: int) -> Floats:
        """Some of the system's outputs, or of functions of them, (p, n), at times from the start on."""
        table, moments = self._table((name, rows.start, rows.stop), row), self._moments(time_ns, step_ns)
        value = table.means.take(moments.legs, axis=1, mode="clip")
        part = np.empty_like(value)
        for number, weights in table.waves.items():
            weights.take(moments.legs, axis=1, out=part, mode="clip")
            part *= moments.wave(number)
            value += part
        value -= table.lag(time_ns, self.start_ns, step_ns)
        return value

    def state(self, time_ns: int) -> Floats:
        """The state (s,) at a time from the start on."""
        cycles = self.cycles(time_ns)
        state = self._leg(cycles).moment(cycles)
        state[self._listeners] -= self._alone.motion.moment(self._lag, time_ns - self.start_ns)
        return state

    def mode_at(self, time_ns: int) -> Mode:
        """The mode at a time from the start on."""
        return self._leg(self.cycles(time_ns)).mode

    def modes(self, first_ns: int, last_ns: int) -> list[Mode]:
        """All modes from one time to another, one after the other."""
        drive = self._inputs[0]
        first, last = (drive.frequency * (time - drive.start_ns) / CYCLE for time in (first_ns, last_ns))
        periods = range(int(first), int(last) + 1)
        all_legs = [(period + leg.begin, leg.mode) for period in periods for leg in self._legs]
        begins = [begin for begin, _ in all_legs]
        return [mode for _, mode in all_legs[bisect_right(begins, first) - 1 : bisect_right(begins, last)]]

    def cycles(self, time_ns: int) -> float:
        drive = self._inputs[0]
        return (drive.frequency * (time_ns - drive.start_ns)) % CYCLE / CYCLE

    def _leg(self, cycles: float) -> Leg:
        return self._legs[bisect_right(self.begins.tolist(), cycles) - 1]

    def _moments(self, time_ns: Times, step_ns: int) -> Moments:
        """Values that all functions of time share; kept, as voltages and their rates are asked for in turn."""
        key = (int(time_ns[0]), int(time_ns[-1]), len(time_ns), step_ns)
        if not step_ns or key not in self._last:
            drive = self._inputs[0]
            cycles = self._since_start.phase(time_ns, step_ns) / CYCLE
            legs = np.searchsorted(self.begins, cycles, side="right") - 1
            since = cycles - self.begins.take(legs, mode="clip")
            since *= period_of(self._inputs) / SECOND
            turns = drive.summed(self._cosines_and_sines, time_ns, step_ns)
            self._last = {key: Moments(legs, since, turns, self._rates)}
        return self._last[key]

    def _table(self, key: tuple[str, int, int], row: Callable[[StateSpace], Rows]) -> CycleTable:
        if key not in self._tables:
            means, weights = zip(*(self._seen(leg, row(leg.mode.system)) for leg in self._legs), strict=True)
            waves = enumerate(np.array(weights).transpose(1, 2, 0).copy())
            listened = row(self._legs[0].mode.system)[0][:, self._listeners]
            lag = self._alone.motion.seen(listened, self._lag)
            self._tables[key] = CycleTable(
                np.array(means).T, {number: wave for number, wave in waves if wave.any()}, lag
            )
        return self._tables[key]

    def _seen(self, leg: Leg, rows: Rows) -> tuple[Floats, Floats]:
        """Mean (p,) of rows over state and inputs in a leg, and weights (w, p) of waves; 0 if lost in rounding."""
        inputs, gap = leg.steady.inputs, leg.state - periodic(leg.steady, leg.begin)
        mean, _ = leg.steady.harmonics(rows)
        phasors = np.zeros((len(mean), len(inputs[0].order)), complex)
        for number, (u, waves) in enumerate(zip(inputs, leg.steady.waves, strict=True)):
            if len(u.order):
                phasors += rows[0] @ waves + np.outer(rows[1][:, number], u.amplitude)
        rates, shapes, inverse = leg.modes
        modes = np.zeros((len(self._rates), len(mean)), complex)
        modes[: len(rates)] = ((rows[0] @ shapes) * (inverse @ gap)).T
        modes[: len(rates)].imag[rates.imag == 0] = 0.0  # a decay has no sine part; rounding leaves one if poles repeat
        weights = np.concatenate([phasors.real.T, -phasors.imag.T, _split(modes)])
        weights[np.abs(weights) < LOST * (np.abs(mean) + np.abs(weights).sum(axis=0))] = 0.0
        return mean, weights


def _split(modes: Complexes) -> Floats:
    """Weights (2 m, p) of the cosines and sines of modes (m, p)."""
    return np.stack([modes.real, -modes.imag], axis=1).reshape(2 * len(modes), -1)
