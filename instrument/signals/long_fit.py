"""The parts of a fit to a long record, of which no more than a piece is in memory at once.

The record is read again for each part: its extent, the sums of the columns, the search for the mains' frequency, and
the residuals. The noise around the drive is told by segments of the record, each with its own offset and trend taken
off, as in a shorter record. The drive and the mains are those of the whole record.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from math import inf

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.hum import BLOCK, above_round_off, deviation
from palpate.instrument.signals.noise import EquivalentNoise, fill_diagonal, noise_at
from palpate.instrument.signals.rapid_noise import FEWEST, Cycles, RapidNoise, rapid_noise
from palpate.instrument.signals.sine_columns import (
    COEFFICIENTS,
    SineColumns,
    Sums,
    first_sound,
    scaled_rows,
    turning,
)

Pieces = Callable[[], Iterator[tuple[Floats, Floats]]]
"""Reads a record from its beginning: times (k,) [s] and signals (channels, k) [V] of pieces, none of which is empty."""

SEGMENT = 1 << 15  # samples, of which the noise is told at once; the last segment may have twice as many


@dataclass(frozen=True, slots=True, eq=False)
class RecordInPieces:
    """A record that is read in pieces.

    Attributes:
        pieces: reads it.
        samples: number of samples.
        first, last: times of the first and of the last sample [s].
        step: time between samples [s].
        level: mean of each signal (channels,) [V], which is taken off.
        largest: greatest absolute value of each signal without its mean (channels,) [V].
    """

    pieces: Pieces
    samples: int
    first: float
    last: float
    step: float
    level: Floats
    largest: Floats

    @classmethod
    def of(cls, pieces: Pieces) -> RecordInPieces:
        """Read a record once. Raises EstimateError: a sample is not finite, or time does not increase."""
        samples, step, first, last = 0, 0.0, 0.0, -inf
        total, lowest, highest = np.zeros(1), np.full(1, inf), np.full(1, -inf)
        for time, signals in pieces():
            if not (np.isfinite(signals).all() and np.isfinite(time).all()):
                raise EstimateError(f"a sample after {last:g} s is not finite; leave flagged samples out")
            if not (time[0] > last and (np.diff(time) > 0).all()):
                raise EstimateError(f"time does not increase after {last:g} s; sort the record")
            first = first if samples else float(time[0])
            step = step if step or time.size < 2 else float(np.median(np.diff(time)))
            samples, last = samples + time.size, float(time[-1])
            total = total + signals.sum(axis=1)
            lowest, highest = np.minimum(lowest, signals.min(axis=1)), np.maximum(highest, signals.max(axis=1))
        level = total / max(samples, 1)
        return cls(pieces, samples, first, last, step, level, np.maximum(highest - level, level - lowest))

    @property
    def middle(self) -> float:
        """Time of its middle [s]."""
        return 0.5 * (self.first + self.last)

    def _centred(self, signals: bool = True) -> Iterator[tuple[Floats, Floats]]:
        """Pieces about the middle and the means; without `signals` their times alone."""
        for time, volts in self.pieces():
            yield time - self.middle, volts - self.level[:, np.newaxis] if signals else volts[:0]

    def _summed(self, basis: SineColumns, signals_of: Callable[[Floats, Floats], Floats]) -> Floats:
        """Coefficients (columns, signals) of the scaled columns for the signals that are made from each piece."""
        return self._sums(basis.frequency, basis.mains, basis.slopes, signals_of).solve()

    def _sums(
        self, frequency: float, mains: Sequence[float], slopes: bool, signals_of: Callable[[Floats, Floats], Floats]
    ) -> Sums:
        sums = Sums(frequency, self.last - self.middle, mains, slopes)
        for time, volts in self._centred():
            sums.add(time, signals_of(time, volts))
        return sums

    def columns(self, frequency: float) -> SineColumns:
        """Columns with those of the mains that can be told from the drive. Raises EstimateError: as `sine_columns`."""

        def found(mains: Sequence[float], slopes: bool) -> SineColumns:
            return self._sums(frequency, mains, slopes, lambda _, volts: volts[:0]).columns(self.middle)

        def answers(frequencies: Sequence[float]) -> Sequence[Floats]:
            if not frequencies:
                return []
            pairs = self._summed(basis, lambda time, _: np.concatenate([turning(time, each) for each in frequencies]))
            return np.split(pairs, len(frequencies), axis=1)

        basis = first_sound(found, self.samples, self.last - self.first)
        return basis.with_leaks(answers)

    def at(self, basis: SineColumns, mains: Sequence[float]) -> tuple[SineColumns, Floats]:
        """Columns with the mains at other frequencies [Hz], and the coefficients of a fit with them."""
        sums = self._sums(basis.frequency, mains, basis.slopes, lambda _, volts: volts)
        return basis.moved_to(sums.columns(self.middle)), sums.solve()

    def deviation(self, basis: SineColumns, scaled: Floats) -> Floats:
        """Standard deviation (channels,) [V] of a fitted amplitude by the residuals of the record."""
        squares = sum((left**2).sum(axis=1) for _, left in self._left(basis, scaled))
        return deviation(np.asarray(squares), self.samples, basis.scale.size, self.largest)

    def demodulated(self, basis: SineColumns, scaled: Floats) -> tuple[Floats, Sequence[Floats]]:
        """What is left without the drive: its standard deviation in an amplitude, and its hum over time."""
        begin = self.first - self.middle
        blocks = len(np.arange(begin, -begin, BLOCK))
        turned = [np.zeros((self.level.size, blocks), complex) for _ in basis.mains]
        total = squares = np.zeros(self.level.size)
        for time, left in self._left(basis, scaled[:COEFFICIENTS]):
            total, squares = total + left.sum(axis=1), squares + (left**2).sum(axis=1)
            block = np.minimum(((time - begin) / BLOCK).astype(int), blocks - 1)
            edges = np.flatnonzero(np.diff(block, prepend=-1))
            for mains, hum in zip(basis.mains, turned, strict=True):
                hum[:, block[edges]] += np.add.reduceat(left * np.exp(-2j * np.pi * mains * time), edges, axis=1)
        variance = np.maximum(squares / self.samples - (total / self.samples) ** 2, 0.0)
        scale = 2 / self.samples
        return above_round_off(np.sqrt(variance * scale), self.largest), [hum * scale for hum in turned]

    def _left(self, basis: SineColumns, scaled: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Times about the middle, and what the first columns leave of the signals with these coefficients."""
        for time, volts in self._centred():
            rows = scaled_rows(time, basis.frequency, basis.mains, basis.slopes, basis.scale)[: len(scaled)]
            yield time, volts - scaled.T @ rows

    def noise(self, basis: SineColumns, scaled: Floats) -> tuple[EquivalentNoise, RapidNoise]:
        """Noise around the drive (see `noise_at`), and rapid noise, in the residuals of a fit."""
        spent, samples_in_cycle = basis.scale.size, 1 / (basis.frequency * self.step)
        cycle = max(round(samples_in_cycle), FEWEST)
        segment = max(SEGMENT // cycle, 2) * cycle
        if self.samples < 2 * segment:
            time, left = joined(self._left(basis, scaled))
            return noise_at(basis.frequency, left, self.step, spent), rapid_noise(time, left, samples_in_cycle, spent)
        found, cycles = [], None
        for time, left in _cut(self._left(basis, scaled), chain(repeat(segment, self.samples // segment - 1), [inf])):
            found.append(noise_at(basis.frequency, _levelled(time, left), self.step, spent))
            more = Cycles.of(time, left, cycle)
            cycles = more if cycles is None else cycles + more
        assert cycles is not None
        return _mean(found), cycles.noise(spent)


def in_pieces(time: Floats, signals: Floats) -> Pieces:
    """A record in memory, read in pieces."""
    edges = range(0, time.size, SEGMENT)
    return lambda: ((time[first : first + SEGMENT], signals[:, first : first + SEGMENT]) for first in edges)


def _cut(pieces: Iterator[tuple[Floats, Floats]], sizes: Iterator[float]) -> Iterator[tuple[Floats, Floats]]:
    """Join pieces to others of these sizes; the last one is as long as the rest."""
    held: list[tuple[Floats, Floats]] = []
    size, have = next(sizes), 0
    for piece in pieces:
        held.append(piece)
        have += piece[0].size
        while have >= size:
            time, left = joined(held)
            cut = int(size)
            yield time[:cut], left[:, :cut]
            held, have, size = [(time[cut:], left[:, cut:])], have - cut, next(sizes)
    yield joined(held)


def joined(pieces: Iterable[tuple[Floats, Floats]]) -> tuple[Floats, Floats]:
    """Times (n,) and signals (channels, n) of all pieces."""
    times, signals = zip(*pieces, strict=True) if (pieces := list(pieces)) else ([np.empty(0)], [np.empty((1, 0))])
    return np.concatenate(times), np.concatenate(signals, axis=1)


def _levelled(time: Floats, left: Floats) -> Floats:
    """Residuals (channels, n) without an offset and a trend of their own."""
    at = time - time.mean()
    left = left - left.mean(axis=1, keepdims=True)
    return left - np.outer(left @ at / (at @ at), at)


def _mean(parts: Sequence[EquivalentNoise]) -> EquivalentNoise:
    """Noise of the mean power of several segments."""
    power = np.mean([np.outer(each.sigma, each.sigma) * each.correlation for each in parts], axis=0)
    sigma = np.sqrt(np.diagonal(power))
    both = np.outer(sigma, sigma)
    correlation = np.divide(power, both, out=np.zeros_like(power), where=both > 0)
    fill_diagonal(correlation)
    return EquivalentNoise(sigma, correlation, np.sum([each.degrees_of_freedom for each in parts], axis=0))
