"""Columns of a record's fit: the drive's cosine and sine, an offset, a trend, and the mains.

Hum that is not fitted changes the drive's amplitude: over one cycle the trend follows the hum, and the drive's sine
makes up for the trend. So 1 V of 50 Hz adds up to 0.34 V to a drive of 10 Hz (0.04 V over two cycles, 0.001 V over
ten). Columns for the hum cost 9 % of variance over one cycle and 0.2 % over two.

The mains wander by 0.2 Hz. Of 1 V at 49.8 Hz, columns at 50 Hz still let 0.009 V through, over any dwell up to 2 s. So
each of the mains also has slopes, time times cosine and sine, which follow a small change of its frequency. With them
0.0002 V are left. They cost nothing from two cycles on, and tell the true frequency of the mains, at which a record
with hum is fitted (`hum`).

Columns are left out where they could not be told from the drive. That concerns the slopes over one cycle. It concerns
columns and slopes of 50 Hz beside a drive of 48 Hz over 0.1 s, and of 60 Hz sampled at 62.5 Hz beside a drive of 2.5 Hz
over any time.

The columns of a long record are not kept. They are made piece by piece, and the normal equations are summed over the
pieces. That is exact enough because over many cycles the columns are nearly orthogonal: a condition of 5 of the
columns, squared, costs a digit or two of sixteen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.noise import MAINS, fill_diagonal

Floats = npt.NDArray[np.float64]

COEFFICIENTS = 4  # cosine, sine, offset, trend
CONDITION_LIMIT = 100.0
"""Largest condition number that is accepted; one cycle has 3.1, 0.3 cycle 68, a quarter cycle 113.

At the limit the amplitude can be about 50 times as uncertain as from a whole number of cycles (√(2σ²/n)).
"""
HUM_CONDITION = 5.0  # largest condition number with columns of the mains: the variance grows six times at most
SAMPLES_PER_COLUMN = 2  # fewest samples for each column, with columns of the mains
LONGEST_FACTORED = 1 << 17  # samples; the columns of a longer record are summed in pieces
PIECE = 1 << 14  # samples
REMEMBERED, LONGEST_REMEMBERED = 8, 10_000  # records that are remembered, and samples in one; fits repeat
WANDER = 0.2  # Hz, by which the mains differ from their rated frequency (EN 50160: 0.5 Hz for 99.5 % of a year)
SHOWN = 1e-12  # V that leak from 1 V of hum; below this it is round-off


@dataclass(slots=True, eq=False)
class ColumnCache:
    """Results that are kept with the columns. `modes`: those of `signals/noise_parts.py`."""

    modes: tuple[Floats, Floats] | None = None


class Sums:
    """Normal equations of a fit, summed over the pieces of a record, of which none is kept.

        sums = Sums(frequency, half)
        for time, signals in pieces:
            sums.add(time, signals)
        amplitude = np.hypot(*(sums.solve() * sums.scale[:, np.newaxis])[:2])

    Attributes:
        scale: scale of each column, by which a coefficient becomes one in the signals' unit.
        samples: number of samples so far.
    """

    def __init__(self, frequency: float, half: float, mains: Sequence[float] = MAINS, slopes: bool = True) -> None:
        """Begin with no piece.

        Args:
            frequency: frequency of the drive [Hz].
            half: from the middle of the record to its last sample [s].
            mains: frequencies of the mains that get columns [Hz].
            slopes: whether each of these gets slopes, too.
        """
        self._of = frequency, tuple(mains), slopes
        self.scale = _scale(half, len(self._of[1]), slopes)
        self.samples = 0
        self.gram = np.zeros((self.scale.size, self.scale.size))
        self._moments, self._squares = np.zeros((self.scale.size, 1)), np.zeros(1)  # as many channels as come

    def add(self, time: Floats, signals: Floats) -> None:
        """Add a piece.

        Args:
            time: (n,) s, about the middle of the record.
            signals: (channels, n). Take a common level off them first, because squares of large numbers lose digits.
        """
        rows = _rows(time, *self._of, self.scale)
        self.samples += time.size
        self.gram += rows @ rows.T
        self._moments = self._moments + rows @ signals.T
        self._squares = self._squares + (signals**2).sum(axis=1)

    def solve(self) -> Floats:
        """Coefficients (columns, channels) of the scaled columns, by least squares."""
        return np.asarray(np.linalg.solve(self.gram, self._moments), dtype=np.float64)

    def deviation(self) -> Floats:
        """Standard deviation (channels,) of the residuals."""
        left = self._squares - (self.solve() * self._moments).sum(axis=0)
        return np.asarray(np.sqrt(np.maximum(left, 0.0) / (self.samples - self.scale.size)), dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class SineColumns:
    """Columns about the middle of a record, scaled, and their factors.

    Args:
        frequency: frequency of the drive [Hz].
        columns: (n, 4), then two columns for each of the `mains`, then two slopes for each where `slopes`; of a long
            record none, as of `q`.
        mains: frequencies of the mains that have columns [Hz].
        hum: what 1 V of mains without columns may add to an amplitude, at their worst phase and frequency [V].
        strays: the same for mains that have columns but no slopes, in their order, for 1 V that the columns see [V].
        kept: results that belong to the columns at the mains' rated frequencies.
    """

    frequency: float
    time: Floats
    columns: Floats
    scale: Floats
    q: Floats
    r: Floats
    middle: float
    condition: float
    mains: tuple[float, ...]
    slopes: bool
    hum: float = 0.0
    strays: tuple[float, ...] = ()
    kept: ColumnCache = field(default_factory=ColumnCache)

    def solve(self, signals: Floats) -> Floats:
        """Coefficients (..., columns, channels) of the scaled columns, by least squares; signals (..., channels, n).

        Signals of a record that is long have no further axes.
        """
        if self.is_long:
            return self._summed(signals).solve()
        return np.asarray(np.linalg.solve(self.r, self.q.T @ signals.swapaxes(-1, -2)), dtype=np.float64)

    @property
    def is_long(self) -> bool:
        """Whether the columns are not kept, but made piece by piece."""
        return self.time.size > LONGEST_FACTORED

    def fitted(self, scaled: Floats) -> Floats:
        """What the first columns give (..., channels, n) with these coefficients (..., columns, channels)."""
        count = scaled.shape[-2]
        if not self.is_long:
            found: Floats = (self.columns[:, :count] @ scaled).swapaxes(-1, -2)
            return found
        found = np.empty((scaled.shape[1], self.time.size))
        for part in _parts(self.time.size):
            rows = _rows(self.time[part], self.frequency, self.mains, self.slopes, self.scale)
            found[:, part] = scaled.T @ rows[:count]
        return found

    def _summed(self, signals: Floats) -> Sums:
        sums = Sums(self.frequency, self.time[-1], self.mains, self.slopes)
        for part in _parts(self.time.size):
            sums.add(self.time[part], signals[:, part])
        return sums

    def weights(self) -> Floats:
        """Matrix (2, n) that turns samples into the coefficients of the drive's cosine and sine, not if long."""
        found: Floats = np.linalg.solve(self.r, self.q.T)[:2] * self.scale[:2, np.newaxis]
        return found

    def direction(self, phase: Floats) -> Floats:
        """Vectors (..., columns, channels) of the effect of white noise on amplitudes.

        The length of a vector is the amplitude's standard deviation over that of a sample. The product of two vectors
        is the covariance of two amplitudes.

        Args:
            phase: (..., channels) rad, at the middle of the record.
        """
        gradient = np.stack([np.cos(phase), -np.sin(phase)], axis=-2) * self.scale[:2, np.newaxis]
        found: Floats = np.linalg.inv(self.r).T[:, :2] @ gradient
        return found

    def phasors(self, scaled: Floats) -> tuple[Floats, Floats]:
        """Complex amplitudes (..., mains, channels) of hum [V] and of its slopes [V/s], from the result of `solve`."""
        at, count = COEFFICIENTS, 2 * len(self.mains)
        own = scaled[..., at:, :] * self.scale[at:, np.newaxis]
        hum = own[..., 0:count:2, :] - 1j * own[..., 1:count:2, :]
        return hum, own[..., count::2, :] - 1j * own[..., count + 1 :: 2, :]

    def _leak(self, mains: float) -> float:
        """What 1 V at a frequency [Hz] may add to an amplitude, at its worst phase [V]."""
        added = self.solve(_pair(self.time, mains).T)[:2] * self.scale[:2, np.newaxis]
        most = float(np.linalg.norm(added, 2))
        return most if most > SHOWN else 0.0

    def _stray(self, number: int, mains: float) -> float:
        """What mains that have columns but no slopes may add to an amplitude, for 1 V that the columns see [V]."""
        found = self.solve(_pair(self.time, mains).T) * self.scale[:, np.newaxis]
        at = COEFFICIENTS + 2 * number
        most = float(np.linalg.norm(found[:2] @ np.linalg.inv(found[at : at + 2]), 2))
        return most if most > SHOWN else 0.0

    def with_leaks(self) -> SineColumns:
        """The same columns with `hum` and `strays` computed."""
        left = [self._leak(mains + off) for mains in MAINS if mains not in self.mains for off in (-WANDER, 0.0, WANDER)]
        strays = () if self.slopes else self.mains
        return replace(
            self,
            hum=max(left, default=0.0),
            strays=tuple(max(self._stray(i, each + off) for off in (-WANDER, WANDER)) for i, each in enumerate(strays)),
        )


def sine_columns(time: Floats, frequency: float) -> SineColumns:
    """Columns of a fit at times (n,) [s], with those of the mains that can be told from the drive.

    Raises:
        EstimateError: the times do not determine the sine.
    """
    if time.size > LONGEST_REMEMBERED:
        return _columns(time, frequency)
    return _remembered(time.tobytes(), frequency)


def columns_at(basis: SineColumns, mains: Sequence[float]) -> SineColumns:
    """The same columns with the mains at other frequencies [Hz]."""
    found = _factored(basis.time, basis.frequency, mains, basis.slopes, basis.middle)
    return replace(found, hum=basis.hum, strays=basis.strays, kept=basis.kept)


@lru_cache(REMEMBERED)
def _remembered(time: bytes, frequency: float) -> SineColumns:
    return _columns(np.frombuffer(time), frequency)


def _columns(time: Floats, frequency: float) -> SineColumns:
    middle = float(0.5 * (time[0] + time[-1]))
    centred = time - middle
    each = [(mains,) for mains in MAINS]
    for mains, slopes in ((MAINS, True), (MAINS, False), *((m, s) for s in (True, False) for m in each)):
        if time.size >= SAMPLES_PER_COLUMN * (COEFFICIENTS + (4 if slopes else 2) * len(mains)):
            basis = _factored(centred, frequency, mains, slopes, middle)
            if basis.condition <= HUM_CONDITION:
                return basis.with_leaks()
    basis = _factored(centred, frequency, (), False, middle)
    if not basis.condition <= CONDITION_LIMIT:
        raise EstimateError(
            f"{time.size} samples over {time[-1] - time[0]:.4g} s do not determine a sine of {frequency:g} Hz:"
            f" condition number {basis.condition:.3g}, limit {CONDITION_LIMIT:g}; record a whole cycle or more, away"
            " from half the sample rate"
        )
    return basis.with_leaks()


def correlated(noise: Floats, direction: Floats, of_noise: Floats) -> Floats:
    """Correlation (..., channels, channels) of errors, as of amplitudes or of phases.

    Args:
        noise: (..., channels, channels), correlation of the noise.
        direction: (..., columns, channels), effect of white noise on each, as `SineColumns.direction` has it.
        of_noise: (..., channels), part of each standard uncertainty that is by noise. The rest is independent.
    """
    scaled = direction / np.linalg.norm(direction, axis=-2, keepdims=True) * of_noise[..., np.newaxis, :]
    found: Floats = noise * (scaled.swapaxes(-1, -2) @ scaled)
    fill_diagonal(found)
    return found


def _factored(centred: Floats, frequency: float, mains: Sequence[float], slopes: bool, middle: float) -> SineColumns:
    scale = _scale(centred[-1], len(mains), slopes)
    if centred.size > LONGEST_FACTORED:
        none = np.empty((0, scale.size))
        found = SineColumns(frequency, centred, none, scale, none, none, middle, 0.0, tuple(mains), slopes)
        gram = found._summed(np.empty((0, centred.size))).gram
        condition = math.sqrt(max(float(np.linalg.cond(gram)), 1.0))
        if condition > CONDITION_LIMIT:
            return replace(found, condition=condition)
        return replace(found, r=np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64), condition=condition)
    columns = np.ascontiguousarray(_rows(centred, frequency, mains, slopes, scale).T)
    q, r = np.linalg.qr(columns)
    condition = float(np.linalg.cond(r))
    return SineColumns(frequency, centred, columns, scale, q, r, middle, condition, tuple(mains), slopes)


def _parts(size: int) -> list[slice]:
    return [slice(first, first + PIECE) for first in range(0, size, PIECE)]


def _rows(centred: Floats, frequency: float, mains: Sequence[float], slopes: bool, scale: Floats) -> Floats:
    """The scaled columns as rows, which are quick to fill."""
    hum = [row for each in mains for row in _turning(centred, each)]
    sloping = [centred * row for row in hum] if slopes else []
    rows = np.stack([*_turning(centred, frequency), np.ones_like(centred), centred, *hum, *sloping])
    rows *= scale[:, np.newaxis]
    return rows


def _scale(half: float, mains: int, slopes: bool) -> Floats:
    # Over many cycles the factors give each column an rms near 1. They are fixed, because a column scaled by its own
    # norm would hide a cosine that was sampled at its zeros.
    scale = [math.sqrt(2)] * 2 + [1.0, math.sqrt(3) / half] + [math.sqrt(2)] * 2 * mains
    return np.array(scale + ([math.sqrt(6) / half] * 2 * mains if slopes else []), dtype=np.float64)


def _pair(time: Floats, frequency: float) -> Floats:
    """Cosine and sine at times (n,): an array (n, 2)."""
    return np.stack(_turning(time, frequency), axis=1)


def _turning(time: Floats, frequency: float) -> tuple[Floats, Floats]:
    angle = 2 * np.pi * frequency * time
    return np.cos(angle), np.sin(angle)
