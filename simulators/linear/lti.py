"""Linear time-invariant parts of a chain, solved in closed form.

A periodic drive is a mean and a few harmonics. So the state is a periodic part and a transient that decays with the
system's own modes. Both are known at any time without stepping.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.simulators.linear.free_motion import FreeMotion, Seen, free_motion
from palpate.simulators.linear.periodic import HERTZ, Periodic

Rows = tuple[Floats, Floats]  # weights on states (p, s) and inputs (p, m)

KEPT = 256  # pairs of system and inputs whose settled states are kept


Parts = tuple[tuple[Periodic, Complexes], ...]  # time bases with phasors (p, k)


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u, with s states, m inputs and p outputs.

    Attributes:
        a: (s, s).
        b: (s, m).
        c: (p, s).
        d: (p, m).
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.a)

    def then(self, following: StateSpace) -> StateSpace:
        """Both systems in series: the outputs of this one are the inputs of `following`."""
        if not self.order:
            return StateSpace(following.a, following.b @ self.d, following.c, following.d @ self.d)
        if not following.order:
            return StateSpace(self.a, self.b, following.d @ self.c, following.d @ self.d)
        upper = np.hstack([self.a, np.zeros((self.order, following.order))])
        lower = np.hstack([following.b @ self.c, following.a])
        return StateSpace(
            np.vstack([upper, lower]),
            np.vstack([self.b, following.b @ self.d]),
            np.hstack([following.d @ self.c, following.c]),
            following.d @ self.d,
        )

    def plus(self, other: StateSpace) -> StateSpace:
        """Both systems with the same inputs; their outputs are added."""
        a, _, c, _ = (_block(mine, its) for mine, its in zip(self._parts(), other._parts(), strict=True))
        p = len(self.c)
        return StateSpace(a, np.vstack([self.b, other.b]), c[:p] + c[p:], self.d + other.d)

    def beside(self, other: StateSpace) -> StateSpace:
        """Both systems side by side: first inputs and outputs of this one, then those of `other`."""
        return StateSpace(*(_block(mine, its) for mine, its in zip(self._parts(), other._parts(), strict=True)))

    def part(self, states: list[int]) -> StateSpace:
        """The system of some of the states, on which the others must not act."""
        return StateSpace(self.a[np.ix_(states, states)], self.b[states], self.c[:, states], self.d)

    def transfer(self, frequency: float) -> Complexes:
        """Transfer matrix (p, m), outputs over inputs, at a frequency [Hz]."""
        resolvent = -self.a.astype(complex)
        resolvent.flat[:: self.order + 1] += 2j * np.pi * frequency
        return np.asarray(self.c @ np.linalg.solve(resolvent, self.b) + self.d, complex)

    def drive(self, inputs: Sequence[Periodic]) -> Steady:
        """This system under periodic inputs, given in order."""
        inputs = tuple(u if u.frequency else u.held() for u in inputs)
        waves = [(u.frequency, u.order.tobytes(), u.amplitude.tobytes()) for u in inputs]
        means = np.array([u.mean for u in inputs])
        return Steady(self, inputs, led_to(self.a.tobytes(), self.b.tobytes(), means.tobytes(), tuple(waves)))

    @functools.cached_property
    def motion(self) -> FreeMotion:
        """The motion of the system without inputs."""
        return free_motion(self.a)

    def _parts(self) -> tuple[Floats, Floats, Floats, Floats]:
        return self.a, self.b, self.c, self.d


@dataclass(frozen=True, eq=False)
class Settled:
    """The settled state under periodic inputs that begin at any phase; the same object for equal inputs.

    Attributes:
        mean: (s,), mean of the state.
        waves: (s, k) for each input, harmonics of the state.
        kept: results that rest on them.
    """

    mean: Floats
    waves: tuple[Complexes, ...]
    kept: dict[object, Any] = field(default_factory=dict, init=False)


@dataclass(frozen=True, eq=False)
class Steady:
    """A system under periodic inputs, and its settled state."""

    system: StateSpace
    inputs: tuple[Periodic, ...]
    settled: Settled

    @property
    def mean(self) -> Floats:
        """Mean (s,) of the state."""
        return self.settled.mean

    @property
    def waves(self) -> tuple[Complexes, ...]:
        """Harmonics (s, k) of the state for each input."""
        return self.settled.waves

    def harmonics(self, rows: Rows) -> tuple[Floats, Parts]:
        """rows[0] @ x + rows[1] @ u without the transient: means (p,) and the harmonics of each time base."""
        mean = rows[0] @ self.mean + rows[1] @ np.array([u.mean for u in self.inputs])
        parts: dict[tuple[int, int, int, bytes], tuple[Periodic, Complexes]] = {}
        for number, (u, wave) in enumerate(zip(self.inputs, self.waves, strict=True)):
            if len(u.order):  # an input without harmonics adds none
                _add(parts, u, rows[0] @ wave + np.outer(rows[1][:, number], u.amplitude))
        return mean, tuple(parts.values())

    def trace(self, rows: Rows, start_ns: int, x0: Floats) -> Trace:
        """rows[0] @ x + rows[1] @ u at times after `start_ns`, where the state is `x0` (s,)."""
        return Trace(self.system, rows[0], *self.harmonics(rows), start_ns, self.gap(start_ns, x0))

    def state(self, start_ns: int, x0: Floats, time_ns: Times) -> Floats:
        """State (s, n) at times after `start_ns`, where it is `x0` (s,)."""
        return self._periodic(time_ns) + self.system.motion.free(self.gap(start_ns, x0), time_ns - start_ns)

    def moment(self, start_ns: int, x0: Floats, time_ns: int) -> Floats:
        """The state (s,) at one time."""
        return self._now(time_ns) + self.system.motion.moment(self.gap(start_ns, x0), time_ns - start_ns)

    def gap(self, start_ns: int, x0: Floats) -> Floats:
        """Difference (s,) of the state `x0` from the periodic one."""
        return x0 - self._now(start_ns)

    def magnitude(self, rows: Rows, start_ns: int, x0: Floats) -> Floats:
        """Sums (p,) of the sizes of all terms that make up rows[0] @ x + rows[1] @ u, of which it has the rounding."""
        state = (
            np.abs(self.mean) + np.abs(self.gap(start_ns, x0)) + sum(np.abs(wave).sum(axis=1) for wave in self.waves)
        )
        inputs = np.array([abs(u.mean) + np.abs(u.amplitude).sum() for u in self.inputs])
        return np.asarray(np.abs(rows[0]) @ state + np.abs(rows[1]) @ inputs)

    def _now(self, time_ns: int) -> Floats:
        mean, parts = self._harmonics
        return mean + sum((phasors @ base.turn(time_ns)).real for base, phasors in parts)

    def _periodic(self, time_ns: Times) -> Floats:
        mean, parts = self._harmonics
        state = np.repeat(mean[:, np.newaxis], len(time_ns), axis=1)
        for base, phasors in parts:
            state += base.summed(phasors, time_ns)
        return state

    @functools.cached_property
    def _harmonics(self) -> tuple[Floats, Parts]:
        parts: dict[tuple[int, int, int, bytes], tuple[Periodic, Complexes]] = {}
        for u, wave in zip(self.inputs, self.waves, strict=True):
            _add(parts, u, wave)
        return self.mean, tuple(parts.values())


@dataclass(frozen=True, eq=False)
class Trace:
    """Functions of time: means, harmonics and a decaying transient.

    Attributes:
        mean: (p,).
        gap: (s,), difference from the settled state at `start_ns`; rows (p, s) of it are seen.
    """

    system: StateSpace
    rows: Floats
    mean: Floats
    parts: Parts
    start_ns: int
    gap: Floats

    def at(self, time_ns: Times, step_ns: int = 0) -> Floats:
        """Values (p, n) at times from the start on. `step_ns`: step between times, for speed; 0: not even."""
        terms = [base.summed(phasors, time_ns, step_ns) for base, phasors in self.parts]
        if self.rows.any() and self.gap.any():
            terms.append(self._transient(time_ns, self.start_ns, step_ns))
        if not terms:
            return np.repeat(self.mean[:, np.newaxis], len(time_ns), axis=1)
        value, *others = terms
        value += self.mean[:, np.newaxis]
        for term in others:
            value += term
        return value

    @functools.cached_property
    def _transient(self) -> Seen:
        return self.system.motion.seen(self.rows, self.gap)


def _add(parts: dict[tuple[int, int, int, bytes], tuple[Periodic, Complexes]], u: Periodic, phasors: Complexes) -> None:
    """Add harmonics (p, k) of an input; those of inputs with one frequency and phase add up as phasors."""
    if len(u.order):
        key = (u.frequency, u.start_ns, u.start_phase, u.order.tobytes())
        parts[key] = (u, phasors + parts[key][1]) if key in parts else (u, phasors)


@functools.lru_cache(maxsize=KEPT)
def led_to(a: bytes, b: bytes, means: bytes, waves: tuple[tuple[int, bytes, bytes], ...]) -> Settled:
    """Settled state of a system under inputs, which are given by frequency, orders and amplitudes."""
    order = len(b) // len(means)
    system, push = np.frombuffer(a).reshape(order, order), np.frombuffer(b).reshape(order, len(waves))
    columns = []
    for number, (frequency, orders, amplitudes) in enumerate(waves):
        amplitude = np.frombuffer(amplitudes, complex)
        column = np.zeros((order, len(amplitude)), complex)
        for k, harmonic in enumerate(np.frombuffer(orders, np.int64) if order else ()):
            rate = 2j * np.pi * (frequency / HERTZ) * harmonic
            right = push[:, number] * amplitude[k]
            if right.any():
                column[:, k] = np.linalg.solve(rate * np.eye(order) - system, right)
        column.flags.writeable = False
        columns.append(column)
    mean = _rest(system, push @ np.frombuffer(means))
    mean.flags.writeable = False
    return Settled(mean, tuple(columns))


def _rest(a: Floats, push: Floats) -> Floats:
    """The state (s,) at rest under a constant push (s,) on its rates.

    A state that only integrates makes A singular; then the quantity that it integrates has no mean. Each row is scaled
    by its rate and each column by its weight, so that time constants from microseconds to hours side by side are kept.
    """
    if not len(a):
        return np.zeros(0)
    rate = np.abs(a).max(axis=1, initial=0.0)
    rows = 1 / np.where(rate > 0, rate, 1.0)
    scaled = rows[:, np.newaxis] * a
    weight = np.abs(scaled).max(axis=0, initial=0.0)
    columns = 1 / np.where(weight > 0, weight, 1.0)
    scaled, rest = scaled * columns, np.zeros(len(a))
    for _ in range(2):  # the second pass corrects the rounding of the first
        rest += np.linalg.lstsq(scaled, -rows * push - scaled @ rest, rcond=None)[0]
    return np.asarray(columns * rest)


def gain(matrix: Floats) -> StateSpace:
    """A matrix (p, m) without a memory."""
    p, m = matrix.shape
    return StateSpace(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), matrix)


def first_order_low_pass(tau: float) -> StateSpace:
    """One input, one output, unit gain at 0 Hz, time constant `tau` s."""
    return StateSpace(np.array([[-1 / tau]]), np.array([[1 / tau]]), np.array([[1.0]]), np.array([[0.0]]))


def first_order_high_pass(tau: float) -> StateSpace:
    """One input, one output, unit gain at high frequency, time constant `tau` s."""
    return StateSpace(np.array([[-1 / tau]]), np.array([[1 / tau]]), np.array([[-1.0]]), np.array([[1.0]]))


def _block(first: Floats, second: Floats) -> Floats:
    (rows, columns), (more_rows, more_columns) = first.shape, second.shape
    block = np.zeros((rows + more_rows, columns + more_columns))
    block[:rows, :columns], block[rows:, columns:] = first, second
    return block
