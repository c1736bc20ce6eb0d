"""1/f noise of the amplifiers: one Ornstein-Uhlenbeck process a decade."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from pydantic import Field

from instrument.design import Film
from instrument.quantity import Hertz, VoltsPerRootHertz
from simulators.changes import of_source
from simulators.effects.effect import Bound, Case, Floats, InputEffect, Kind
from simulators.lti import Times
from simulators.pickup import SIGMAS, correlated_spread
from simulators.randomness import Stream

LOWEST, DECADES = 1e-3, 8  # Hz; corners of the processes: 1 mHz to 10 kHz
PER_TAU = 16  # grid points in a time constant, within a factor of sqrt(2)
BLOCK = 4096  # grid points that are found together
FORGOTTEN = 1e-16  # of a process, that what came before a block may still make of it
KEPT_BLOCKS = 1024  # 32 MB


@dataclass(frozen=True, slots=True)
class Process:
    """One Ornstein-Uhlenbeck process.

    Attributes:
        corner: [Hz].
        passed: what of it, in amplitude, is below half the sample rate.
        step: of its grid, in samples: a power of two, so that the grids of slower processes lie on it.
        decay: it falls by exp(-decay) in a step.
    """

    corner: float
    passed: float
    step: int
    decay: float


class PinkNoise(InputEffect):
    """Power density as 1/f, within 10 % from 1 mHz to a tenth of the sample rate; independent on each channel.

    An anti-alias filter at half the sample rate is assumed: of a process above it leaves the flat part below.
    A process is known on a grid of its own, some 16th of its time constant or the sample period where that is longer,
    and is a straight line between the points. Its value at a grid point is a moving average of the numbers of a
    stream, so any time is reached without stepping there.
    """

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # one-sided, where it equals the white noise [A]
    density: VoltsPerRootHertz = Field(default=2e-6, ge=0, le=1)
    corner: Hertz = Field(default=10.0, gt=0, le=1e6)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Noise voltages at integer multiples of the sample period, shape (n,)."""
        first = int(time_ns[0]) // period_ns
        return self._deviation() * _sum(stream, _processes(1e9 / period_ns), first, first + len(time_ns))

    def error(self, case: Case, film: Film) -> float:
        """Six standard deviations of the fit [V]."""

        def correlation(lag: Floats) -> Floats:
            each = [p.passed**2 * np.exp(-2 * math.pi * p.corner * lag) for p in _processes(case.rate)]
            return np.asarray(np.sum(each, axis=0))

        return SIGMAS * self._deviation() * correlated_spread(case, correlation)

    def bound(self, case: Case) -> Bound:
        return of_source(case, self)

    def _deviation(self) -> float:
        """Of each process [V]. Processes of variance s^2, one a decade, add up to a density of s^2 / (ln 10 f)."""
        return self.density * math.sqrt(math.log(10) * self.corner)


@functools.cache
def _processes(rate: float) -> tuple[Process, ...]:
    """The processes at a rate of samples a second, fastest first."""
    processes = []
    for decade in reversed(range(DECADES)):
        corner = LOWEST * 10.0**decade
        samples = rate / (2 * math.pi * corner)  # in a time constant
        step = 2 ** max(0, round(math.log2(samples / PER_TAU)))
        processes.append(Process(corner, min(1.0, math.sqrt(2 * samples)), step, step / samples))
    return tuple(process for process in processes if process.corner <= rate)


def _sum(stream: Stream, processes: tuple[Process, ...], first: int, end: int) -> Floats:
    """Of the processes at grid points `first` to `end` - 1 of the fastest."""
    fastest, *slower = processes
    total = fastest.passed * _process(stream.child(fastest.corner), fastest.decay, first, end)
    if slower:
        ratio = slower[0].step // fastest.step
        coarse = _sum(stream, tuple(slower), first // ratio, (end - 1) // ratio + 2)
        between = np.arange(ratio) / ratio
        lines = coarse[:-1, np.newaxis] + np.diff(coarse)[:, np.newaxis] * between
        total += lines.ravel()[first % ratio :][: end - first]
    return total


def _process(stream: Stream, decay: float, first: int, end: int) -> Floats:
    """Values at grid points `first` to `end` - 1 of a process of unit variance that decays by exp(-decay) each step.

    Each block starts afresh from what the numbers before it leave, so a value does not depend on what else was asked.
    """
    blocks = range(first // BLOCK, (end - 1) // BLOCK + 1)
    values = np.concatenate([_block(stream, decay, number) for number in blocks])
    return values[first - blocks[0] * BLOCK : end - blocks[0] * BLOCK]


@functools.lru_cache(maxsize=KEPT_BLOCKS)
def _block(stream: Stream, decay: float, number: int) -> Floats:
    from scipy.signal import lfilter

    before = math.ceil(-math.log(FORGOTTEN) / decay)
    fresh = math.sqrt(-math.expm1(-2 * decay))
    # Number 0 of the stream belongs to the earliest grid point that the block from 0 on looks back at.
    normals = stream.normal(number * BLOCK, before + BLOCK)
    values: Floats = lfilter([fresh], [1.0, -math.exp(-decay)], normals)[before:]
    return values
