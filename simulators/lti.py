"""Linear time-invariant parts of a chain, solved in closed form.

A periodic drive is a mean and a few harmonics, so the state is a periodic part plus a transient that
decays with the system's own modes; both are known at any time without stepping.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Complexes = npt.NDArray[np.complex128]

POINTS = 1024  # of a period, where a waveform is sampled
CYCLE = 1_000_000_000_000  # one cycle in units of phase: 1 mHz for 1 ns is one unit


@dataclass(frozen=True)
class Periodic:
    """mean + sum over k of Re(amplitude[k] exp(i 2 pi order[k] phase)), the phase in cycles.

    frequency: integer mHz, so that the phase after any time is an exact integer count of 1e-12 cycles.
    start_ns, start_phase: the phase is `start_phase` (1e-12 cycles) at `start_ns`.
    order: (k,) integers. amplitude: (k,) complex.
    """

    mean: float
    frequency: int
    start_ns: int
    start_phase: int
    order: npt.NDArray[np.int64]
    amplitude: Complexes

    def phase(self, time_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Phase in 1e-12 cycles, exact for 30 days of any frequency up to 20 kHz. Shape of `time_ns`."""
        high, low = np.divmod(time_ns - self.start_ns, 1_000_000)
        whole = self.frequency * high % 1_000_000
        phase: npt.NDArray[np.int64] = (whole * 1_000_000 + self.frequency * low + self.start_phase) % CYCLE
        return phase

    def turns(self, time_ns: npt.NDArray[np.int64]) -> Complexes:
        """exp(i 2 pi order phase), shape (k, n)."""
        turns: Complexes = np.exp(2j * np.pi / CYCLE * (np.outer(self.order, self.phase(time_ns)) % CYCLE))
        return turns

    def restarted(self, time_ns: int) -> Periodic:
        """The same function of time, counted from `time_ns`."""
        phase = int(self.phase(np.array([time_ns]))[0])
        return Periodic(self.mean, self.frequency, time_ns, phase, self.order, self.amplitude)

    def scaled(self, factor: float, offset: float = 0.0) -> Periodic:
        """offset + factor * self."""
        return Periodic(
            offset + factor * self.mean, self.frequency, self.start_ns, self.start_phase, self.order,
            factor * self.amplitude,
        )  # fmt: skip

    def extremes(self) -> tuple[float, float]:
        """Least and greatest value; of several harmonics at 1024 points of a period."""
        if len(self.order) == 1:
            swing = float(np.abs(self.amplitude[0]))
            return self.mean - swing, self.mean + swing
        turns = np.arange(POINTS) / POINTS
        wave = self.mean + real_product(self.amplitude, np.exp(2j * np.pi * np.outer(self.order, turns)))
        return float(wave.min()), float(wave.max())

    def at(self, time_ns: npt.NDArray[np.int64]) -> Floats:
        """Values, shape (n,)."""
        return self.mean + real_product(self.amplitude, self.turns(time_ns))


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + B u, y = C x + D u with one input and one output; A (s, s) has distinct eigenvalues."""

    a: Floats
    b: Floats
    c: Floats
    d: float

    @property
    def order(self) -> int:
        return len(self.b)

    def periodic_state(self, drive: Periodic) -> tuple[Floats, Complexes]:
        """Mean (s,) and harmonics (s, k) of the state that a drive leads to."""
        mean: Floats = np.asarray(np.linalg.solve(self.a, -self.b * drive.mean), float)
        eye = np.eye(self.order)
        jw = 2j * np.pi * 1e-3 * drive.frequency * drive.order
        harmonics: Complexes = np.empty((self.order, len(drive.order)), complex)
        for k in range(len(drive.order)):
            harmonics[:, k] = np.linalg.solve(jw[k] * eye - self.a, self.b * drive.amplitude[k])
        return mean, harmonics

    def state(self, drive: Periodic, x0: Floats, time_ns: npt.NDArray[np.int64]) -> Floats:
        """State (s, n) at times after the drive's start, where it is `x0` (s,)."""
        return self._state(drive, x0, time_ns, drive.turns(time_ns))

    def output(self, drive: Periodic, x0: Floats, time_ns: npt.NDArray[np.int64]) -> Floats:
        """Output (n,) at times after the drive's start."""
        turns = drive.turns(time_ns)
        through = self.d * (drive.mean + real_product(drive.amplitude, turns))
        return real_product(self.c, self._state(drive, x0, time_ns, turns)) + through

    def _state(self, drive: Periodic, x0: Floats, time_ns: npt.NDArray[np.int64], turns: Complexes) -> Floats:
        mean, harmonics = self.periodic_state(drive)
        start = drive.turns(np.array([drive.start_ns]))
        transient = x0 - (mean + real_product(harmonics, start)[:, 0])
        rates, modes = np.linalg.eig(self.a)
        weights = np.linalg.solve(modes, transient.astype(complex))
        elapsed = 1e-9 * (time_ns - drive.start_ns)
        decaying = real_product(modes * weights, np.exp(np.outer(rates, elapsed)))
        return mean[:, np.newaxis] + real_product(harmonics, turns) + decaying


def real_product(weights: npt.NDArray[np.inexact[Any]], rows: npt.NDArray[np.inexact[Any]]) -> Floats:
    """Real part of weights @ rows; weights (..., k), rows (k, n), result (..., n).

    Summed row by row: a BLAS product rounds a column otherwise when it stands in a block of another length,
    and the same samples must be the same bytes whatever blocks they are asked for in.
    """
    total = np.zeros((*weights.shape[:-1], rows.shape[1]))
    for k, row in enumerate(rows):
        weight = weights[..., k, np.newaxis]
        total += weight.real * row.real - weight.imag * row.imag
    return total


def first_order_low_pass(tau: float) -> StateSpace:
    """Unit gain at 0 Hz, time constant `tau` s."""
    return StateSpace(np.array([[-1 / tau]]), np.array([1 / tau]), np.array([1.0]), 0.0)


def first_order_high_pass(tau: float) -> StateSpace:
    """Unit gain at high frequency, time constant `tau` s."""
    return StateSpace(np.array([[-1 / tau]]), np.array([1 / tau]), np.array([-1.0]), 1.0)
