"""Periodic functions of time: a mean and a few harmonics, whose phase is an integer count."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Complexes, Floats, Times
from palpate.simulators.linear.free_motion import BLOCK, on_grid, real_product

POINTS = 1024  # samples of a waveform in a period
CYCLE = 10**18  # one cycle in units of phase: 1 nHz for 1 ns is one unit
HERTZ = 10**9  # one hertz in units of frequency
SECOND = 10**9  # one second in nanoseconds
KEPT = 16  # tables of turns within a block


@dataclass(frozen=True)
class Periodic:
    """mean + sum over k of Re(amplitude[k] exp(i 2 pi order[k] phase)), the phase in cycles.

    Attributes:
        frequency: integer nHz, so that the phase after any time is an exact integer count of 1e-18 cycles.
        start_ns, start_phase: the phase is `start_phase` (1e-18 cycles) at `start_ns`.
        order: (k,), integers.
        amplitude: (k,), complex.
    """

    mean: float
    frequency: int
    start_ns: int
    start_phase: int
    order: npt.NDArray[np.int64]
    amplitude: Complexes

    def phase(self, time_ns: Times, step_ns: int = 0) -> Times:
        """Phase [1e-18 cycles], exact for 30 days of any frequency up to 20 kHz, in the shape of `time_ns`.

        `step_ns` is the step between times, which makes it faster; 0: times are not even.
        """
        if step_ns:
            heads = self._counts(time_ns[::BLOCK])
            sums: Times = (heads[:, np.newaxis] + _phase_within(self.frequency, step_ns)).ravel()[: len(time_ns)]
            np.subtract(sums, CYCLE, out=sums, where=sums >= CYCLE)
            return sums
        whole, part = divmod(self.frequency, HERTZ)
        seconds, rest = np.divmod(time_ns - self.start_ns, SECOND)
        billionths = (part * seconds + whole * rest) % HERTZ
        phase: Times = (billionths * HERTZ + part * rest + self.start_phase) % CYCLE
        return phase

    def turns(self, time_ns: Times) -> Complexes:
        """exp(i 2 pi order phase) (k, n)."""
        turns: Complexes = np.exp(2j * np.pi * np.outer(self.order, self.phase(time_ns) / CYCLE))
        return turns

    def turn(self, time_ns: int) -> Complexes:
        """exp(i 2 pi order phase) (k,) at one time."""
        turn: Complexes = np.exp(2j * np.pi * (self._count(time_ns) / CYCLE) * self.order)
        return turn

    def _count(self, time_ns: int) -> int:
        """The phase at one time."""
        return (self.start_phase + self.frequency * (time_ns - self.start_ns)) % CYCLE

    def _counts(self, time_ns: Times) -> Times:
        """The phase at times; faster than `phase` for few times."""
        return np.array([self._count(time) for time in time_ns.tolist()])

    def summed(self, phasors: Complexes, time_ns: Times, step_ns: int = 0) -> Floats:
        """Sums (p, n) of its harmonics with other phasors (p, k). `step_ns`: step between times; 0: not even."""
        if not step_ns:
            return real_product(phasors, self.turns(time_ns))
        repeat = self.repeat(step_ns)
        if repeat <= BLOCK:
            sums = real_product(phasors, self.turns(time_ns[:repeat]))
            return np.tile(sums, -(-len(time_ns) // sums.shape[1]))[:, : len(time_ns)]

        def heads(begin_ns: Times) -> Floats:
            cycles = (self._counts(begin_ns) / CYCLE)[:, np.newaxis, np.newaxis]
            turned = phasors * np.exp(2j * np.pi * (cycles * self.order))
            return np.concatenate([turned.real, -turned.imag], axis=2)

        within = _turns_within(self.frequency, self.order.tobytes(), step_ns)
        return on_grid(heads, within, int(time_ns[0]), len(time_ns), step_ns)

    def repeat(self, step_ns: int) -> int:
        """Number of times, `step_ns` apart, after which its phases repeat."""
        return CYCLE // math.gcd(self.frequency * step_ns, CYCLE)

    def restarted(self, time_ns: int) -> Periodic:
        """The same function of time, counted from `time_ns`."""
        return Periodic(self.mean, self.frequency, time_ns, self._count(time_ns), self.order, self.amplitude)

    def scaled(self, factor: float, offset: float = 0.0) -> Periodic:
        """offset + factor * self."""
        return Periodic(
            offset + factor * self.mean, self.frequency, self.start_ns, self.start_phase, self.order,
            factor * self.amplitude,
        )  # fmt: skip

    def held(self) -> Periodic:
        """A function of 0 Hz as a constant: its value at the start."""
        return constant(self.now(self.start_ns), self)

    def derivative(self) -> Periodic:
        """Its derivative with respect to time, in its unit per second."""
        rates = 2j * np.pi * (self.frequency / HERTZ) * self.order
        return Periodic(0.0, self.frequency, self.start_ns, self.start_phase, self.order, rates * self.amplitude)

    def extremes(self) -> tuple[float, float]:
        """Least and greatest value; for several harmonics, of 1024 points in a period."""
        if len(self.order) == 1:
            swing = float(np.abs(self.amplitude[0]))
            return self.mean - swing, self.mean + swing
        turns = np.arange(POINTS) / POINTS
        wave = self.mean + real_product(self.amplitude, np.exp(2j * np.pi * np.outer(self.order, turns)))
        return float(wave.min()), float(wave.max())

    def at(self, time_ns: Times) -> Floats:
        """Values (n,) at times."""
        return self.mean + real_product(self.amplitude, self.turns(time_ns))

    def now(self, time_ns: int) -> float:
        """The value at one time."""
        return self.mean + float((self.amplitude @ self.turn(time_ns)).real)


@functools.lru_cache(maxsize=KEPT)
def _phase_within(frequency: int, step_ns: int) -> Times:
    """Phase (BLOCK,) [1e-18 cycles] since the beginning of a block of samples."""
    from_zero = Periodic(0.0, frequency, 0, 0, np.zeros(0, np.int64), np.zeros(0, complex))
    return from_zero.phase(step_ns * np.arange(BLOCK))


@functools.lru_cache(maxsize=KEPT)
def _turns_within(frequency: int, order: bytes, step_ns: int) -> Floats:
    """Cosines and sines (2 k, BLOCK) of the harmonics within a block of samples."""
    phase = _phase_within(frequency, step_ns) / CYCLE
    turns = np.exp(2j * np.pi * np.outer(np.frombuffer(order, np.int64), phase))
    return np.concatenate([turns.real, turns.imag])


def sine(frequency: float, amplitude: float, now_ns: int, before: Periodic | None = None) -> Periodic:
    """A sine of `frequency` Hz from now on, whose phase goes on from that of `before`, if there is one."""
    phase = int(before.phase(np.array([now_ns]))[0]) if before is not None else 0
    return Periodic(0.0, round(frequency * HERTZ), now_ns, phase, np.array([1]), np.array([-1j * amplitude]))


def constant(value: float, like: Periodic) -> Periodic:
    """A constant with the time base of another function."""
    return Periodic(value, like.frequency, like.start_ns, like.start_phase, like.order[:0], like.amplitude[:0])
