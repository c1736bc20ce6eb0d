"""1/f noise of the amplifiers: one Ornstein-Uhlenbeck process for each decade."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from palpate.instrument.arrays import Floats, Times
from palpate.instrument.quantity import Hertz, VoltsPerRootHertz
from palpate.simulators.bounds import SIGMAS, correlated_spread
from palpate.simulators.physics.effect import Case, InputEffect, Kind, Rates
from palpate.simulators.randomness import BLOCK, Stream, cut, keep

LOWEST, DECADES = 1e-3, 8  # Hz; corners of the processes: 1 mHz to 10 kHz
PER_TAU = 16  # grid points in a time constant, within a factor of sqrt(2)
ROW = 64  # points of a grid in one row of a product
BEFORE = 2  # blocks of numbers in which every process of a grid is forgotten: 37 time constants of at most 23 points
KEPT = 64  # sets of weights
FORGOTTEN = 1e-16  # fraction of a process below which its remainder from before a block is neglected


@dataclass(frozen=True, slots=True)
class Process:
    """One Ornstein-Uhlenbeck process.

    Attributes:
        corner: corner frequency [Hz].
        passed: share of its amplitude that is below half the sample rate.
        step: step of its grid [samples], a power of two, so that the grids of slower processes are parts of it.
        decay: the process falls by exp(-decay) in a step.
    """

    corner: float
    passed: float
    step: int
    decay: float


class PinkNoise(InputEffect):
    """Noise with a density as 1/f, within 10 % from 1 mHz to a tenth of the sample rate.

    It is independent on each channel with a film.

    An anti-alias filter at half the sample rate is assumed; of a process above it the flat part below remains. A
    process is computed on a grid, with a step of about a 16th of its time constant, or of the sample period where that
    is longer, and is a straight line between the points. Processes of one grid are summed: they are an autoregressive
    moving average of one stream's numbers. So any time is reached without stepping there.
    """

    kind: ClassVar[Kind] = "additive"
    cancels_in_ratio: ClassVar[bool] = False

    # one-sided density where it equals the white noise [A]
    density: VoltsPerRootHertz = Field(default=2e-6, ge=0, le=1)
    corner: Hertz = Field(default=10.0, ge=1e-6, le=1e6)

    def volts(self, stream: Stream, time_ns: Times, period_ns: int, rates: Callable[[], Floats]) -> Floats:
        """Noise voltages at integer multiples of the sample period, shape (n,), not to be written to."""
        if not self.density:
            return np.zeros(len(time_ns))
        first = int(time_ns[0]) // period_ns
        key = (self, period_ns)
        if key not in stream.kept:
            stream.kept[key] = _Sum(stream, self._deviation(), _grids(1e9 / period_ns))
        values: Floats = stream.kept[key].values(first, len(time_ns))
        return values

    def error(self, case: Case, rates: Rates) -> float:
        """Six standard deviations of the fit [V]."""

        def correlation(lag: Floats) -> Floats:
            each = [p.passed**2 * np.exp(-2 * math.pi * p.corner * lag) for p in _processes(case.rate)]
            return np.asarray(np.sum(each, axis=0))

        return SIGMAS * self._deviation() * correlated_spread(case, correlation)

    def largest(self, case: Case, rates: Rates) -> float:
        return SIGMAS * self._deviation() * math.hypot(*(process.passed for process in _processes(case.rate)))

    def noise_density(self, frequency: float) -> float:
        return self.density * math.sqrt(self.corner / frequency)

    def _deviation(self) -> float:
        """Standard deviation of each process [V]; one in each decade, of variance s^2, gives s^2 / (ln 10 f)."""
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


@dataclass(frozen=True)
class NoiseGrid:
    """The sum of the processes with the same step [samples].

    Attributes:
        falls, shares: (k,), a number of the stream adds the sum of shares * falls**n, n steps later.
    """

    step: int
    falls: tuple[float, ...]
    shares: tuple[float, ...]


@functools.cache
def _grids(rate: float) -> tuple[NoiseGrid, ...]:
    """Grids at a rate of samples a second, the finest first."""
    together = itertools.groupby(_processes(rate), key=lambda process: process.step)
    return tuple(_grid(step, tuple(processes)) for step, processes in together)


def _grid(step: int, processes: Sequence[Process]) -> NoiseGrid:
    """Grid of processes of powers p (1 - a^2) / |1 - a z|^2: in sum |c(z)|^2 over the product of |1 - a z|^2."""
    falls = np.exp([-process.decay for process in processes])
    numerator = np.zeros(len(processes))  # of powers of w = z + 1 / z, highest first: |1 - a z|^2 = 1 + a^2 - a w
    for k, process in enumerate(processes):
        others = np.delete(falls, k)
        term = np.array([process.passed**2 * -math.expm1(-2 * process.decay)])
        for fall in others:
            term = np.polymul(term, [-fall, 1 + fall * fall])
        numerator += term
    roots = np.roots(numerator)  # w > 2 has the roots z and 1 / z, of which the smaller one is taken
    fresh = np.atleast_1d(np.poly(roots / 2 - np.sqrt(roots * roots / 4 - 1)))
    fresh *= math.sqrt(float(np.polyval(numerator, 2.0))) / float(fresh.sum())  # by the power at w = 2, z = 1
    shares = [np.polyval(fresh, fall) / np.prod(fall - np.delete(falls, k)) for k, fall in enumerate(falls)]
    return NoiseGrid(step, tuple(falls.tolist()), tuple(map(float, shares)))


class _Sum:
    """Sum of all processes from a grid on, at its points. `deviation` is that of each process."""

    def __init__(self, stream: Stream, deviation: float, grids: Sequence[NoiseGrid]) -> None:
        self._grid = replace(grids[0], shares=tuple(deviation * share for share in grids[0].shares))
        self._stream = stream.child(self._grid.step)
        self._blocks: dict[int, Floats] = {}
        self._coarser = _Sum(stream, deviation, grids[1:]) if len(grids) > 1 else None

    def values(self, first: int, count: int) -> Floats:
        """Values (count,) at the points from `first` on."""
        return cut(self._block, first, count)

    def _block(self, number: int) -> Floats:
        return self._blocks[number] if number in self._blocks else keep(self._blocks, number, self._found(number))

    def _found(self, number: int) -> Floats:
        """Points of a block, from its own numbers and those before it alone, whatever else is asked for."""
        ratio = self._coarser._grid.step // self._grid.step if self._coarser else None
        weights = _weights(self._grid, ratio)
        # The grid begins after the stream's first blocks.
        *before, own = (self._stream.block(number + each).reshape(-1, ROW) for each in range(BEFORE + 1))
        left = np.concatenate([*before, own])[-weights.before - len(own) :] @ weights.left
        others = [np.matmul(weights.passed_on, left.T[..., np.newaxis])[..., 0].T]
        if self._coarser and ratio:
            points = self._coarser.values(number * BLOCK // ratio, BLOCK // ratio + 1)
            spans = ROW // ratio
            others += [points[:-1].reshape(-1, spans), points[spans::spans, np.newaxis]]
        values: Floats = own @ weights.own
        values += np.concatenate(others, axis=1) @ weights.others
        return values.ravel()


@dataclass(frozen=True)
class _Weights:
    """Weights by which numbers become the points of a grid, row by row.

    Attributes:
        own: (ROW, ROW), weights of the row's own numbers.
        left: (ROW, k), weights of these numbers in the state at the row's end.
        before: number of rows after which that state is forgotten.
        passed_on: (k, rows, before + rows), weights of all rows' states in the state with which each row begins.
        others: (k + p, ROW), weights of that first state, and of p points of the next coarser grid, which lines join.
    """

    own: Floats
    left: Floats
    before: int
    passed_on: Floats
    others: Floats


@functools.lru_cache(maxsize=KEPT)
def _weights(grid: NoiseGrid, ratio: int | None) -> _Weights:
    falls: Floats = np.array(grid.falls)[:, np.newaxis]
    shares: Floats = np.array(grid.shares)[:, np.newaxis]
    steps, rows = np.arange(ROW), BLOCK // ROW
    before = math.ceil(math.log(FORGOTTEN) / math.log(falls.max()) / ROW)
    gone = np.arange(rows)[:, np.newaxis] + before - 1 - np.arange(before + rows)  # rows between
    later = steps - steps[:, np.newaxis]
    begun = shares * falls ** (steps + 1)
    answer = (shares * falls**steps).sum(axis=0)
    return _Weights(
        own=np.where(later >= 0, answer[later], 0.0),
        left=(falls ** steps[::-1]).T,
        before=before,
        passed_on=np.where(gone >= 0, falls[..., np.newaxis] ** (ROW * np.maximum(gone, 0)), 0.0),
        others=np.concatenate([begun, _lines(ratio)]) if ratio else begun,
    )


def _lines(ratio: int) -> Floats:
    """Weights (ROW / ratio + 1, ROW) of points in the values on the lines between them, `ratio` for each line."""
    points = np.arange(ROW // ratio + 1)[:, np.newaxis]
    weights: Floats = np.maximum(1 - np.abs(np.arange(ROW) / ratio - points), 0.0)
    return weights
