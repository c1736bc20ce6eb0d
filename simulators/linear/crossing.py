"""Certified search for the first nanosecond at which an output falls below zero: no dip is missed, however short.

Each step is as long as the value, its slope and a bound on its second derivative allow. So it ends before the first
failure, and near a failure steps shrink as Newton's do. Terms for which such a bound holds only for a short time are
bounded by their size instead: harmonics by their least value, fast modes by what is left of them.
"""

from __future__ import annotations

import cmath
import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.instrument.arrays import Complexes, Floats
from palpate.instrument.errors import UnreachableError
from palpate.simulators.linear.free_motion import balanced, exponential
from palpate.simulators.linear.lti import Rows, Steady
from palpate.simulators.linear.periodic import CYCLE, HERTZ, SECOND, Periodic

NEVER = 2**63 - 1
AHEAD = 16  # periods of the drive that are searched at once
MOST_STEPS = 20_000  # of a search
LOOKS = 64  # points in each period of the highest harmonic, which bound the least value of a sum of harmonics
# Share of the size of its terms by which an output must be below zero; less is rounding.
ROUNDING = 1e-13


class TransientTerm(NamedTuple):
    """One term of a transient at a moment.

    Attributes:
        slope: its rate.
        bend: greatest fall of the slope in each second, for the next `reach` s.
        least: value below which it never falls.
    """

    value: float
    slope: float
    bend: float
    least: float
    reach: float = math.inf


Transient = Callable[
    [int], list[TransientTerm]
]  # a function from a time after the start [ns] to the parts, the fastest first


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A function of time: level + harmonics + transient, from `start_ns` on.

    Attributes:
        waves: time base, order and phasor of each harmonic.
        least: lower bound of the sum of harmonics.
        bend: bound of its second derivative.
    """

    level: float
    waves: list[tuple[Periodic, int, complex]]
    least: float
    bend: float
    start_ns: int
    transient: Transient

    def first_below(self, before_ns: int) -> int:
        """The first nanosecond with a value below zero; `before_ns`: none before it; NEVER: none at all."""
        time_ns = self.start_ns
        for _ in range(MOST_STEPS):
            if time_ns >= before_ns:
                return before_ns
            value, safe = self.step(time_ns, (before_ns - time_ns) / SECOND)
            if math.isnan(value) or math.isnan(safe):
                break
            if value < 0:
                return time_ns
            if safe * SECOND >= NEVER:
                return NEVER
            time_ns += max(int(safe * SECOND), 1)
        raise UnreachableError(
            f"the simulated chain cannot be followed from {self.start_ns / SECOND:.9f} s on: "
            f"{'its state is no number' if math.isnan(value) else f'nothing is decided in {MOST_STEPS} steps'}; look "
            "for numbers of the scene that are far from those of a real bench"
        )

    def step(self, time_ns: int, enough: float) -> tuple[float, float]:
        """The value at a time, and for how long [s] it will certainly not fall below zero, at most `enough`."""
        wave = drift = 0.0
        for base, order, phasor in self.waves:
            turns = (base.start_phase + base.frequency * (time_ns - base.start_ns)) % CYCLE / CYCLE
            turned = phasor * cmath.exp(2j * math.pi * (order * turns % 1.0))
            rate = 2 * math.pi * (base.frequency / HERTZ) * order
            wave += turned.real
            drift -= rate * turned.imag
        parts = self.transient(time_ns - self.start_ns)
        value = self.level + wave + sum([part.value for part in parts])
        least = self.level + sum([part.least for part in parts])
        if least + self.least >= 0:
            return value, math.inf
        safe = _turned_below(least, turned, rate) if len(self.waves) == 1 and rate else 0.0
        # Some of the fastest modes are bounded by their least value, the others by slope and bend. Every division is
        # tried,
        # and the longest step counts. The least value of a slow mode that rises from below would give up its slope.
        spares = list(itertools.accumulate([part.least - part.value for part in parts], initial=value))
        slope = bend = 0.0
        for spare, part in zip(reversed(spares), (*reversed(parts), None), strict=True):
            if safe >= enough:
                break
            if spare >= 0:
                safe = max(
                    safe,
                    _root(spare, slope + drift, bend + self.bend),
                    _root(spare - wave + self.least, slope, bend),
                )
            if part is not None:
                slope, bend = slope + part.slope, bend + part.bend
        return value, min([safe, *(part.reach for part in parts)])


class _Outputs:
    """Properties of outputs that do not depend on the phase at which the inputs began.

    Attributes:
        mean, least, bend: (g,), as in `Signal`.
        terms: (g,), sizes of the terms of an output, without the transient.
        waves: harmonics of each output, by number of the input, order and phasor.
        fastest: numbers of the modes, the fastest first. Of a pair, the mode that turns forward counts for both.
        rates, turning: rates of the modes, and whether they are pairs.
        shapes: (g, s), weight of each mode in each output.
    """

    def __init__(self, steady: Steady, rows: Rows) -> None:
        self.mean, parts = steady.harmonics(rows)
        means = np.array([u.mean for u in steady.inputs])
        self.terms = np.abs(rows[0]) @ np.abs(steady.mean) + np.abs(rows[1]) @ np.abs(means)
        self.least, self.bend = np.zeros(len(self.mean)), np.zeros(len(self.mean))
        self.waves: list[list[tuple[int, int, complex]]] = [[] for _ in self.mean]
        for base, phasors in parts:
            number = next(number for number, u in enumerate(steady.inputs) if u is base)
            self.least += _least(base, phasors)
            self.bend += np.abs(phasors) @ (2 * np.pi * (base.frequency / HERTZ) * base.order) ** 2
            self.terms += np.abs(phasors).sum(axis=1)
            for waves, own in zip(self.waves, phasors.tolist(), strict=True):
                waves += [(number, k, phasor) for k, phasor in zip(base.order.tolist(), own, strict=True)]
        if steady.system.motion.modes is None:
            return
        rates, shapes, _ = steady.system.motion.modes
        self.fastest = [int(k) for k in np.argsort(-np.abs(rates), kind="stable") if rates[k].imag >= 0]
        self.rates: list[complex] = rates[self.fastest].tolist()
        self.turning = np.array([rate.imag > 0 for rate in self.rates])
        self.still = np.array([rate == 0 for rate in self.rates])
        self.shapes = (rows[0] @ shapes)[:, self.fastest] * np.where(self.turning, 2.0, 1.0)


class CrossingWatch:
    """Outputs of a system under periodic inputs that should stay at or above zero.

    Args:
        rows: weights of the outputs on states (g, s) and inputs (g, m).
    """

    def __init__(self, steady: Steady, rows: Rows) -> None:
        self._steady, self._rows = steady, rows[0]
        first, kept = steady.inputs[0], steady.settled.kept
        begun = tuple((u.start_ns - first.start_ns, u.start_phase - first.start_phase) for u in steady.inputs)
        key = rows[0].tobytes(), rows[1].tobytes(), begun
        if key not in kept:
            kept[key] = _Outputs(steady, rows)
        self._outputs: _Outputs = kept[key]
        period = max((1 / (u.frequency / HERTZ) for u in steady.inputs if u.frequency), default=1.0)
        self._ahead_ns = round(AHEAD * period * SECOND)

    def first_failure(self, start_ns: int, state: Floats) -> tuple[int, int | None]:
        """Time at which the first output falls below zero after `start_ns`, and its number.

        None in place of the number: no output does so before that time, which is NEVER or the time from which the
            search must go on.

        Args:
            start_ns: start of the search [ns].
            state: (s,), state at the start.
        """
        gap, seen = self._steady.gap(start_ns, state), self._outputs
        modes = self._steady.system.motion.modes
        if modes is None:
            terms, least = np.abs(self._rows) @ np.abs(gap), np.full(len(self._rows), -np.inf)
        else:
            weights = seen.shapes * (modes[2] @ gap)[seen.fastest]
            sizes = np.abs(weights)
            terms = sizes.sum(axis=1)
            falling = np.where(seen.still, weights.real, np.minimum(weights.real, 0.0))
            least = np.where(seen.turning, -sizes, falling).sum(axis=1)
        slack = ROUNDING * (seen.terms + terms)
        end_ns, failed = NEVER, None
        limit_ns = start_ns + self._ahead_ns
        for k in (~(seen.mean + slack + seen.least + least >= 0)).nonzero()[0].tolist():
            transient: Transient
            if modes is None:
                transient = functools.partial(self._by_powers, self._rows[k], gap)
            else:
                pairs = zip(weights[k].tolist(), seen.rates, strict=True)
                transient = functools.partial(_by_modes, [(weight, rate) for weight, rate in pairs if weight])
            waves = [(self._steady.inputs[number], order, phasor) for number, order, phasor in seen.waves[k]]
            signal = Signal(
                float(seen.mean[k] + slack[k]), waves, float(seen.least[k]), float(seen.bend[k]), start_ns, transient
            )
            found_ns = signal.first_below(min(end_ns, limit_ns))
            if found_ns < end_ns:
                end_ns, failed = found_ns, k if found_ns < limit_ns else None
        return end_ns, failed

    def _by_powers(self, row: Floats, gap: Floats, elapsed_ns: int) -> list[TransientTerm]:
        """The transient as one part, by bounds that need no modes: for modes that are too nearly parallel."""
        a = self._steady.system.a
        state = self._steady.system.motion.moment(gap, elapsed_ns)
        reach, growth, measure = self._bounds
        bend = np.abs(row @ a @ a) @ growth @ np.abs(state)
        least = -math.inf
        if measure is not None:
            least = -float(np.linalg.norm(np.linalg.solve(measure.T, row)) * np.linalg.norm(measure @ state))
        return [TransientTerm(float(row @ state), float(row @ a @ state), float(bend), least, reach)]

    @functools.cached_property
    def _bounds(self) -> tuple[float, Floats, Floats | None]:
        """Time [s] for which |exp(A t)| <= growth holds, that bound, and `measure_of(A)`."""
        a = self._steady.system.a
        reach = 1 / float(np.abs(a).sum(axis=1).max())
        return reach, exponential(np.abs(a) * reach), measure_of(a)


def _by_modes(modes: Sequence[tuple[complex, complex]], elapsed_ns: int) -> list[TransientTerm]:
    """Parts by modes, from their weights at the start and their rates [1/s]."""
    parts, elapsed = [], elapsed_ns / SECOND
    for weight, rate in modes:
        if rate.imag:
            term = weight * cmath.exp(rate * elapsed)
            size = abs(term)
            parts.append(TransientTerm(term.real, (rate * term).real, abs(rate) ** 2 * size, -size))
            continue
        # A mode that does not turn keeps its sign: a positive one falls ever more slowly and never below zero. A mode
        # without
        # a rate stays as it is.
        value, fall = weight.real * math.exp(rate.real * elapsed), rate.real
        parts.append(
            TransientTerm(value, fall * value, max(-fall * fall * value, 0.0), min(value, 0.0) if fall else value)
        )
    return parts


def measure_of(a: Floats) -> Floats | None:
    """Matrix F (s, s) with which |F x| never grows while x' = a x; None where none is certain.

    P = F'F solves Lyapunov's equation, in units in which rows and columns of `a` have equal sizes. That x'Px never
    grows is then checked.
    """
    from scipy.linalg import solve_continuous_lyapunov

    matrix, units = balanced(a)
    if np.linalg.eigvals(matrix).real.max() >= 0:
        return None
    energy = np.asarray(solve_continuous_lyapunov(matrix.T, -np.eye(len(a))), float)
    energy = (energy + energy.T) / 2
    change = energy @ matrix
    if np.linalg.eigvalsh(energy).min() <= 0 or np.linalg.eigvalsh(change + change.T).max() >= 0:
        return None
    return np.asarray(np.linalg.cholesky(energy).T / units)


def _root(value: float, slope: float, bend: float) -> float:
    """The first time at which value + slope t - bend t^2 / 2 is zero, for a value at or above zero; inf: never."""
    if value < 0:
        return 0.0
    if bend == 0:
        return math.inf if slope >= 0 else value / -slope
    turn = math.sqrt(slope * slope + 2 * value * bend)
    return (slope + turn) / bend if slope > 0 else 2 * value / (turn - slope) if turn > slope else 0.0


def _turned_below(level: float, turned: complex, rate: float) -> float:
    """Time for which level + the real part of a phasor, turning at a rate [rad/s], stays at or above zero."""
    size = abs(turned)
    if not -size < level < size:
        return 0.0
    end = math.acos(-level / size)  # angle from the phasor's greatest real part, in either direction
    phase = cmath.phase(turned)
    return (end - phase) / rate if -end <= phase < end else 0.0


def _least(base: Periodic, phasors: Complexes) -> Floats:
    """Lower bounds of sums of harmonics (p,), from phasors (p, k)."""
    sizes = np.abs(phasors)
    if len(base.order) == 1 or not base.frequency:
        return np.asarray(-sizes.sum(axis=1), float)
    count = LOOKS * int(base.order.max())
    looks = np.exp(2j * np.pi * np.outer(base.order, np.arange(count)) / count)
    seen = (phasors @ looks).real.min(axis=1)
    # Between two points the sum is lower by at most its second derivative times an eighth of their squared distance.
    between: Floats = sizes @ base.order**2 * (2 * np.pi / count) ** 2 / 8
    return np.array(np.maximum(seen - between, -sizes.sum(axis=1)), dtype=np.float64)
