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

The columns of a long record are not kept (`long_fit`). They are made piece by piece, and the normal equations are
summed over the pieces. That is exact enough because over many cycles the columns are nearly orthogonal: a condition of
5 of the columns, squared, costs a digit or two of sixteen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.noise import MAINS, fill_diagonal

COEFFICIENTS = 4  # cosine, sine, offset, trend
CONDITION_LIMIT = 100.0
"""Largest condition number that is accepted; one cycle has 3.1, 0.3 cycle 68, a quarter cycle 113.

At the limit the amplitude can be about 50 times as uncertain as from a whole number of cycles (√(2σ²/n)).
"""
HUM_CONDITION = 5.0  # largest condition number with columns of the mains: the variance grows six times at most
SAMPLES_PER_COLUMN = 2  # fewest samples for each column, with columns of the mains
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
    """

    def __init__(self, frequency: float, half: float, mains: Sequence[float] = MAINS, slopes: bool = True) -> None:
        """Begin with no piece.

        Args:
            frequency: frequency of the drive [Hz].
            half: from the middle of the record to its last sample [s].
            mains: frequencies of the mains that get columns [Hz].
            slopes: whether each of these gets slopes, too.
        """
        self._of, self._half = (frequency, tuple(mains), slopes), half
        self.scale = _scale(half, len(self._of[1]), slopes)
        self.gram = np.zeros((self.scale.size, self.scale.size))
        self._moments = np.zeros((self.scale.size, 1))  # as many channels as come

    def add(self, time: Floats, signals: Floats) -> None:
        """Add a piece.

        Args:
            time: (n,) s, about the middle of the record.
            signals: (channels, n). Take a common level off them first, because sums of large numbers lose digits.
        """
        rows = scaled_rows(time, *self._of, self.scale)
        self.gram += rows @ rows.T
        self._moments = self._moments + rows @ signals.T

    def solve(self) -> Floats:
        """Coefficients (columns, channels) of the scaled columns, by least squares."""
        return np.asarray(np.linalg.solve(self.gram, self._moments), dtype=np.float64)

    def columns(self, middle: float) -> SineColumns:
        """What is known of the columns without the columns themselves. `middle`: time of the record's middle [s]."""
        frequency, mains, slopes = self._of
        condition, r = math.sqrt(max(float(np.linalg.cond(self.gram)), 1.0)), np.empty((0, self.scale.size))
        if condition <= CONDITION_LIMIT:
            r = np.asarray(np.linalg.cholesky(self.gram).T, dtype=np.float64)
        ends, none = np.array([-self._half, self._half]), np.empty((0, self.scale.size))
        return SineColumns(frequency, ends, none, self.scale, none, r, middle, condition, mains, slopes)


@dataclass(frozen=True, slots=True, eq=False)
class SineColumns:
    """Columns about the middle of a record, scaled, and their factors.

    Args:
        frequency: frequency of the drive [Hz].
        time: (n,) s, about the middle of the record; where the columns are not kept, its ends.
        columns: (n, 4), then two columns for each of the `mains`, then two slopes for each where `slopes`. Those of a
            long record are not kept, nor is `q`; then `solve`, `fitted` and `weights` have no answer.
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
        """Coefficients (..., columns, channels) of the scaled columns, by least squares; signals (..., channels, n)."""
        return np.asarray(np.linalg.solve(self.r, self.q.T @ signals.swapaxes(-1, -2)), dtype=np.float64)

    def fitted(self, scaled: Floats) -> Floats:
        """What the first columns give (..., channels, n) with these coefficients (..., columns, channels)."""
        found: Floats = (self.columns[:, : scaled.shape[-2]] @ scaled).swapaxes(-1, -2)
        return found

    def weights(self) -> Floats:
        """Matrix (2, n) that turns samples into the coefficients of the drive's cosine and sine."""
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

    def with_leaks(self, answers: Callable[[Sequence[float]], Sequence[Floats]]) -> SineColumns:
        """The same columns with `hum` and `strays` computed.

        Args:
            answers: coefficients (columns, 2) that the fit gives a cosine and a sine of 1 V, for each frequency [Hz].
        """
        left = [mains + off for mains in MAINS if mains not in self.mains for off in (-WANDER, 0.0, WANDER)]
        ends = [] if self.slopes else [each + off for each in self.mains for off in (-WANDER, WANDER)]
        found = answers([*left, *ends])
        added = [float(np.linalg.norm(self._unscaled(each)[:2], 2)) for each in found[: len(left)]]
        strayed = [self._stray(at // 2, each) for at, each in enumerate(found[len(left) :])]
        return replace(
            self,
            hum=max(map(_shown, added), default=0.0),
            strays=tuple(max(strayed[at : at + 2]) for at in range(0, len(strayed), 2)),
        )

    def moved_to(self, columns: SineColumns) -> SineColumns:
        """Columns of the same record with the mains at other frequencies; `hum` and `strays` stay."""
        return replace(columns, hum=self.hum, strays=self.strays, kept=self.kept)

    def _unscaled(self, scaled: Floats) -> Floats:
        return scaled * self.scale[:, np.newaxis]

    def _stray(self, number: int, answer: Floats) -> float:
        """What mains that have columns but no slopes may add to an amplitude, for 1 V that the columns see [V]."""
        found, at = self._unscaled(answer), COEFFICIENTS + 2 * number
        return _shown(float(np.linalg.norm(found[:2] @ np.linalg.inv(found[at : at + 2]), 2)))


def _shown(most: float) -> float:
    return most if most > SHOWN else 0.0


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
    return basis.moved_to(_factored(basis.time, basis.frequency, mains, basis.slopes, basis.middle))


@lru_cache(REMEMBERED)
def _remembered(time: bytes, frequency: float) -> SineColumns:
    return _columns(np.frombuffer(time), frequency)


def _columns(time: Floats, frequency: float) -> SineColumns:
    middle = float(0.5 * (time[0] + time[-1]))
    centred = time - middle
    basis = first_sound(
        lambda mains, slopes: _factored(centred, frequency, mains, slopes, middle), time.size, time[-1] - time[0]
    )
    return basis.with_leaks(
        lambda frequencies: [basis.solve(np.stack(turning(centred, each), axis=1).T) for each in frequencies]
    )


def first_sound(columns: Callable[[Sequence[float], bool], SineColumns], samples: int, span: float) -> SineColumns:
    """The columns with as many of the mains, and their slopes, as can be told from the drive.

    Args:
        columns: makes columns with some of the mains, and with slopes or without.
        samples: number of samples of the record.
        span: from its first to its last sample [s].

    Raises:
        EstimateError: the times do not determine the sine.
    """
    each = [(mains,) for mains in MAINS]
    for mains, slopes in ((MAINS, True), (MAINS, False), *((m, s) for s in (True, False) for m in each)):
        if samples >= SAMPLES_PER_COLUMN * (COEFFICIENTS + (4 if slopes else 2) * len(mains)):
            basis = columns(mains, slopes)
            if basis.condition <= HUM_CONDITION:
                return basis
    basis = columns((), False)
    if not basis.condition <= CONDITION_LIMIT:
        raise EstimateError(
            f"{samples} samples over {span:.4g} s do not determine a sine of {basis.frequency:g} Hz:"
            f" condition number {basis.condition:.3g}, limit {CONDITION_LIMIT:g}; record a whole cycle or more, away"
            " from half the sample rate"
        )
    return basis


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
    columns = np.ascontiguousarray(scaled_rows(centred, frequency, mains, slopes, scale).T)
    q, r = np.linalg.qr(columns)
    condition = float(np.linalg.cond(r))
    return SineColumns(frequency, centred, columns, scale, q, r, middle, condition, tuple(mains), slopes)


def scaled_rows(centred: Floats, frequency: float, mains: Sequence[float], slopes: bool, scale: Floats) -> Floats:
    """The scaled columns as rows, which are quick to fill."""
    hum = [row for each in mains for row in turning(centred, each)]
    sloping = [centred * row for row in hum] if slopes else []
    rows = np.stack([*turning(centred, frequency), np.ones_like(centred), centred, *hum, *sloping])
    rows *= scale[:, np.newaxis]
    return rows


def _scale(half: float, mains: int, slopes: bool) -> Floats:
    # Over many cycles the factors give each column an rms near 1. They are fixed, because a column scaled by its own
    # norm would hide a cosine that was sampled at its zeros.
    scale = [math.sqrt(2)] * 2 + [1.0, math.sqrt(3) / half] + [math.sqrt(2)] * 2 * mains
    return np.array(scale + ([math.sqrt(6) / half] * 2 * mains if slopes else []), dtype=np.float64)


def turning(time: Floats, frequency: float) -> tuple[Floats, Floats]:
    """Cosine and sine at times (n,) [s] of a frequency [Hz]."""
    angle = 2 * np.pi * frequency * time
    return np.cos(angle), np.sin(angle)
