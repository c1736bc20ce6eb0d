"""Amplitude and phase of a sine of known frequency, in all channels at once, with standard uncertainty.

The sine is fitted by least squares with its frequency known (IEEE 1057, three parameters). Two more terms are fitted
with it. One is a linear trend, because a PVDF film is pyroelectric and drifts with temperature [S]. The other is the
mains' hum, because over few cycles the trend would follow the hum and change the fitted drive. Time and signals are
centred and the columns scaled before one QR factorization. Normal equations of the plain columns would square the
condition number and lose the amplitude beneath a large offset. Only for long records, over which the scaled columns are
nearly orthogonal, normal equations of these are summed in pieces (`RecordInPieces`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import chain, repeat
from math import inf
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, UnknownName
from palpate.instrument.signals.noise import (
    FEWEST,
    HARMONICS_FROM,
    MAINS,
    Cycles,
    EquivalentNoise,
    RapidNoise,
    fill_diagonal,
    moments,
    noise_at,
    rapid_noise,
)
from palpate.instrument.uncertainty.budget import COVERAGE

# --- columns of a fit ----------------------------------------------------------------------------------

# Hum that is not fitted changes the drive's amplitude: over one cycle the trend follows the hum, and the drive's sine
# makes up for the trend. So 1 V of 50 Hz adds up to 0.34 V to a drive of 10 Hz (0.04 V over two cycles, 0.001 V over
# ten). Columns for the hum cost 9 % of variance over one cycle and 0.2 % over two.
#
# The mains wander by 0.2 Hz. Of 1 V at 49.8 Hz, columns at 50 Hz still let 0.009 V through, over any dwell up to 2 s.
# So each of the mains also has slopes, time times cosine and sine, which follow a small change of its frequency. With
# them 0.0002 V are left. They cost nothing from two cycles on, and tell the true frequency of the mains, at which a
# record with hum is fitted (`hum`).
#
# Columns are left out where they could not be told from the drive. That concerns the slopes over one cycle. It concerns
# columns and slopes of 50 Hz beside a drive of 48 Hz over 0.1 s, and of 60 Hz sampled at 62.5 Hz beside a drive of 2.5
# Hz over any time.
#
# The columns of a long record are not kept (`long_fit`). They are made piece by piece, and the normal equations are
# summed over the pieces. That is exact enough because over many cycles the columns are nearly orthogonal: a condition
# of 5 of the columns, squared, costs a digit or two of sixteen.


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
    """Results that are kept with the columns. `modes`: those of the two noises below."""

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


def median_step(time: Floats) -> float:
    """Median step of times (n,). By np.median it would take longer, which imports numpy.ma for it."""
    steps = np.diff(time)
    middle = [(steps.size - 1) // 2, steps.size // 2]
    return float(np.partition(steps, middle)[middle].sum() / 2)


def turning(time: Floats, frequency: float) -> tuple[Floats, Floats]:
    """Cosine and sine at times (n,) [s] of a frequency [Hz]."""
    angle = 2 * np.pi * frequency * time
    return np.cos(angle), np.sin(angle)


# --- white and 1/f noise -------------------------------------------------------------------------------

# The spectrum of a short record has few lines, and noise below the first line leaks into them. So the residuals
# themselves are used. Their covariance is that of white and of 1/f noise, seen through the fit's columns. In the
# directions in which both covariances are diagonal, each residual is an independent normal of variance v (1 − s + s λ).
# Here v is the effect of the noise on the drive, and s is the share of 1/f noise in it (restricted likelihood,
# Patterson and Thompson 1971).
#
# A short record hardly tells s. So every s counts by its likelihood (Jeffreys' prior), and v is described by a scaled
# chi-squared of the same mean and variance. The most likely s alone would be too optimistic, because 1/f noise is
# greater at the drive than where a short record measures noise best.
#
# These intervals hold 95 % in the mean over all shares, but 87 % for pure 1/f noise over one cycle. So the degrees of
# freedom are chosen to make the 95 % interval as wide as by a prior that leans to 1/f noise; it leans more in records
# of fewer cycles.


LONGEST = 240  # greatest number of samples; a longer record has a spectrum to fit, and the time here grows as the cube
FEWEST_RESIDUALS = 6  # least number of residuals; fewer do not show how well their variance is known
SHARES = np.sin((np.arange(16) + 0.5) * np.pi / 32) ** 2  # shares of 1/f noise at the drive; equally likely by Jeffreys
BEYOND_LAW = 1.15  # factor on the power of 1/f noise at the drive: amplifiers follow the 1/f law to about a tenth
LEANING = 8.0  # cycles: this over the record's cycles is the exponent of the share in the leaning prior; by trial
STEEPER = 0.3  # cycles: this over the record's cycles is the excess at the drive of noise that falls as 1/f throughout
UPPER = (1 + COVERAGE) / 2
LOWEST = 0.01  # cycles in a record: offset and trend take up slower 1/f noise


def short_noise(
    basis: SineColumns, residuals: Floats, step: float
) -> tuple[EquivalentNoise, npt.NDArray[np.bool_]] | None:
    """White noise that has the effect of the real noise on the drive, and which records have noise in all channels.

    None: the records are too long or too short.

    Args:
        basis: columns of the fit.
        residuals: (..., channels, n), residuals of the fit.
        step: time between samples [s].
    """
    if basis.time.size > LONGEST:
        return None
    from scipy.special import stdtridf, stdtrit

    if basis.kept.modes is None:
        basis.kept.modes = _modes(basis, step)
    directions, relative = basis.kept.modes
    if len(relative) < FEWEST_RESIDUALS:
        return None
    seen = residuals @ directions
    shape = 1 - SHARES[:, np.newaxis] + SHARES[:, np.newaxis] * relative  # (shares, residuals)
    squares = seen**2 @ (1 / shape).T  # (..., channels, shares)
    count = len(relative)
    sound = np.asarray((squares > 0).all(axis=(-2, -1)))
    squares = np.where(sound[..., np.newaxis, np.newaxis], squares, 1.0)
    likelihood = -0.5 * np.log(shape).sum(axis=1) - 0.5 * count * np.log(squares)
    mean, freedom, weight = mean_power(likelihood, squares, count)
    cycles = basis.frequency * basis.time.size * step
    worse, worse_freedom, _ = mean_power(likelihood + LEANING / cycles * np.log(SHARES), squares, count)
    wider = np.sqrt((1 + STEEPER / cycles) * typical(worse, worse_freedom) / typical(mean, freedom))
    factor = stdtrit(worse_freedom, UPPER) * wider
    upper = stdtridf(UPPER, np.maximum(factor, stdtrit(freedom, UPPER)))
    whitened = seen / np.sqrt(weight @ shape)
    return EquivalentNoise(np.sqrt(typical(mean, freedom)), moments(whitened, count)[1], upper.min(axis=-1)), sound


def mean_power(log: Floats, squares: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Mean (..., channels) of the noise's power at the drive, its degrees of freedom, and the weights of the shares.

    Args:
        log: (..., channels, shares), logarithms of the weights, up to a constant.
        squares: (..., channels, shares), sums of squared residuals, each scaled for its share.
        count: number of residuals in a sum.
    """
    weight = np.exp(log - log.max(axis=-1, keepdims=True))
    weight /= weight.sum(axis=-1, keepdims=True)
    mean = (weight * squares).sum(axis=-1) / (count - 2)
    square = (weight * squares**2).sum(axis=-1) / ((count - 2) * (count - 4))
    return mean, 4 + 2 / (square / mean**2 - 1), weight


def typical(mean: Floats, freedom: Floats) -> Floats:
    """Scale of a scaled inverse chi-squared of this mean: Student's factor applies to the scale, not to the mean."""
    typical: Floats = mean * (freedom - 2) / freedom
    return typical


def _modes(basis: SineColumns, step: float) -> tuple[Floats, Floats]:
    """Directions (n, m) of the residuals, and the variance of 1/f noise in each over that at the drive."""
    time, frequency = basis.time, basis.frequency
    columns = basis.columns
    cycles = frequency * time.size * step
    if cycles >= HARMONICS_FROM:
        orders = np.arange(2, int(0.5 / step / frequency) + 1)
        angle = 2 * np.pi * frequency * np.outer(time, orders)
        columns = np.concatenate([columns, np.cos(angle), np.sin(angle)], axis=1)
    q, r = np.linalg.qr(columns, mode="complete")
    spanned = int((np.abs(np.diagonal(r)) > 1e-6 * np.sqrt(time.size)).sum())
    free = q[:, columns.shape[1] :] if spanned == columns.shape[1] else q[:, spanned:]
    pink = _pink(time, step)
    weights = basis.weights()
    at_drive = np.trace(weights @ pink @ weights.T) / np.trace(weights @ weights.T)
    values, vectors = np.linalg.eigh(free.T @ pink @ free)
    return free @ vectors, np.maximum(values, 0.0) / (BEYOND_LAW * at_drive)


def _pink(time: Floats, step: float) -> Floats:
    """Covariance (n, n) of 1/f noise, up to a constant factor."""
    span = time[-1] - time[0]
    octaves = np.log2(0.5 / step * span / LOWEST)
    corners = LOWEST / span * 2 ** np.linspace(0, octaves, int(np.ceil(octaves)) + 1)
    lag = np.abs(time[:, np.newaxis] - time)
    covariance = np.zeros_like(lag)
    for corner in corners:
        covariance += np.exp(-2 * np.pi * corner * lag)
    return covariance


# --- hum -----------------------------------------------------------------------------------------------

# The fitted slopes tell how far off the mains are (a step of Gauss and Newton). That step converges if the mains are
# off by less than half a turn over the record. If they may be off by more, frequencies around the rated one are tried
# first.


SEEN = 5.0  # number of an amplitude's standard deviations above which hum is seen; smaller hum does no harm
SURE = 3.0  # number of a frequency's standard uncertainties; mains that are farther off are tuned
CENTRED = 0.05  # rad at the ends of the record; the slopes absorb a phase error this small
FARTHEST = 0.5  # greatest deviation of the mains' frequency by EN 50160 [Hz]
STEPS = 8
LONG = 2.0  # s; in a longer record 0.25 Hz are more than half a turn
BLOCK = 0.5  # s of a record that the search averages
ROUND_OFF = 1e-12  # of a signal
PADDED = 4  # number of frequencies that are tried for each block


class RecordWithHum(Protocol):
    """A record (channels, n) as the search sees it, whether it is in memory or not."""

    def at(self, basis: SineColumns, mains: Sequence[float]) -> tuple[SineColumns, Floats]:
        """Columns with the mains at other frequencies [Hz], and the coefficients of a fit with them."""

    def deviation(self, basis: SineColumns, scaled: Floats) -> Floats:
        """Standard deviation (channels,) [V] of a fitted amplitude by the residuals of the record."""

    def demodulated(self, basis: SineColumns, scaled: Floats) -> tuple[Floats, Sequence[Floats]]:
        """What is left without the drive: its standard deviation in an amplitude, and its hum over time.

        The hum is (channels, blocks), complex, for each of the mains: the mean over each `BLOCK`, times blocks.
        """


class _InMemory:
    """Records (..., channels, n) in memory, centred."""

    def __init__(self, signals: Floats) -> None:
        self._signals = signals

    def at(self, basis: SineColumns, mains: Sequence[float]) -> tuple[SineColumns, Floats]:
        found = columns_at(basis, mains)
        return found, found.solve(self._signals)

    def deviation(self, basis: SineColumns, scaled: Floats) -> Floats:
        left = self._signals - basis.fitted(scaled)
        return deviation((left**2).sum(axis=-1), basis.time.size, basis.scale.size, self._largest())

    def demodulated(self, basis: SineColumns, scaled: Floats) -> tuple[Floats, Sequence[Floats]]:
        left, time = self._signals - basis.fitted(scaled[:COEFFICIENTS]), basis.time
        edges = np.searchsorted(time, np.arange(time[0], time[-1], BLOCK))
        turned = [
            np.add.reduceat(left * np.exp(-2j * np.pi * mains * time), edges, axis=1) * (2 / time.size)
            for mains in basis.mains
        ]
        return above_round_off(left.std(axis=1) * np.sqrt(2 / time.size), self._largest()), turned

    def _largest(self) -> Floats:
        largest: Floats = np.abs(self._signals).max(axis=-1, initial=0.0)
        return largest


def tuned(basis: SineColumns, signals: Floats, scaled: Floats) -> tuple[SineColumns, Floats]:
    """Columns with the mains at their true frequency, and the coefficients of a fit with them.

    Where no hum shows, both are returned as they were given.

    Args:
        basis: columns with the mains at their rated frequency.
        signals: (channels, n) V, centred.
        scaled: coefficients of the signals by `basis`.
    """
    return tuned_to(_InMemory(signals), basis, scaled)


def tuned_to(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> tuple[SineColumns, Floats]:
    """The same for any record."""
    if not (basis.mains and basis.slopes):
        return basis, scaled
    rated = tuple(min(MAINS, key=lambda each: abs(each - own)) for own in basis.mains)
    if basis.time[-1] - basis.time[0] > LONG:
        basis, scaled = _searched(record, basis, scaled)
    given = basis, scaled
    for _ in range(STEPS):
        off = _off(record, basis, scaled)
        if not off.any():
            break
        found = [own + float(step) for own, step in zip(basis.mains, off, strict=True)]
        if any(abs(own - each) > FARTHEST for own, each in zip(found, rated, strict=True)):
            return given
        basis, scaled = record.at(basis, found)
    return basis, scaled


def humming(basis: SineColumns, signals: Floats, scaled: Floats) -> npt.NDArray[np.bool_]:
    """In which records of a stack (..., channels, n) `tuned` may find other frequencies of the mains."""
    if not (basis.mains and basis.slopes):
        return np.zeros(signals.shape[:-2], bool)
    if basis.time[-1] - basis.time[0] > LONG:
        return np.ones(signals.shape[:-2], bool)
    return np.asarray(_off(_InMemory(signals), basis, scaled).any(axis=-1))


def _off(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> Floats:
    """Difference (..., mains) [Hz] of the mains from the frequency of their columns; 0: no difference can be told."""
    hum, slope = basis.phasors(scaled)
    deviation = record.deviation(basis, scaled)[..., np.newaxis, :]
    power = (np.abs(hum / deviation) ** 2).sum(axis=-1)
    shown = power > SEEN**2 * scaled.shape[-1]
    half = basis.time[-1]
    # hum (1 + i δ t) turns by δ; all channels share the frequency of the mains.
    turned = ((slope / deviation) * (hum / deviation).conj()).imag.sum(axis=-1)
    rate = np.divide(turned, power, out=np.zeros_like(power), where=shown)
    turned_u = np.sqrt(np.divide(3.0, power, out=np.zeros_like(power), where=shown)) / half
    needed = shown & (np.abs(rate) * half > CENTRED) & (np.abs(rate) > SURE * turned_u)
    return np.where(needed, rate / (2 * np.pi), 0.0)


def deviation(squares: Floats, samples: int, columns: int, largest: Floats) -> Floats:
    """Standard deviation (..., channels) [V] of a fitted amplitude.

    Args:
        squares: sum of the squares of the residuals (..., channels) [V²].
        samples, columns: numbers of samples and of columns.
        largest: greatest absolute value of each signal (..., channels) [V].
    """
    return above_round_off(np.sqrt(2 * squares / max(samples - columns, 1) / samples), largest)


def above_round_off(deviation: Floats, largest: Floats) -> Floats:
    """The deviation, at least that of round-off: the residuals of a record without noise are no hum."""
    least = np.where(largest > 0, ROUND_OFF * largest, 1.0)
    found: Floats = np.maximum(deviation, least)
    return found


def _searched(record: RecordWithHum, basis: SineColumns, scaled: Floats) -> tuple[SineColumns, Floats]:
    """Columns and coefficients with each of the mains at the frequency of greatest power, where that is hum."""
    deviation, hums = record.demodulated(basis, scaled)
    found = []
    for mains, turned in zip(basis.mains, hums, strict=True):
        size = PADDED * turned.shape[1]
        power = ((np.abs(np.fft.fft(turned, size, axis=1)) / deviation[:, np.newaxis]) ** 2).sum(axis=0)
        off = np.fft.fftfreq(size, BLOCK)
        power[np.abs(off) > FARTHEST] = 0.0
        most = int(power.argmax())
        found.append(mains + (float(off[most]) if power[most] > SEEN**2 * len(turned) else 0.0))
    return (basis, scaled) if tuple(found) == basis.mains else record.at(basis, found)


# --- long records --------------------------------------------------------------------------------------

# The record is read again for each part: its extent, the sums of the columns, the search for the mains' frequency, and
# the residuals. The noise around the drive is told by segments of the record, each with its own offset and trend taken
# off, as in a shorter record. The drive and the mains are those of the whole record.


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
            step = step if step or time.size < 2 else median_step(time)
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


# --- the estimate --------------------------------------------------------------------------------------


Some = TypeVar("Some", float, Floats)

SHORTEST_RECORD = 0.25
"""Shortest record [cycles].

In a shorter one sine and cosine cannot be told from offset and trend: the amplitude scatters by 0.8 of itself, as
trials showed.
"""
FEW_DEGREES = 50.0
"""Degrees of freedom below which noise is known to no better than a tenth of itself.

A record with so few is too short to tell white from 1/f noise. Where noise prevails, its intervals may be a fifth wider
than they need to be.
"""
LONGEST_FACTORED, FEW_SAMPLES = 1 << 17, 1 << 14
"""Most samples of a record in memory, and of one that is read in pieces, for which the columns are factored."""
LEAST_SHARE = 1e-3  # share of an uncertainty; a smaller part of it by noise does not count for the degrees of freedom


@dataclass(frozen=True, slots=True, eq=False)
class SineFit:
    """Fit of a sine in each channel. Where a stack of records was fitted, arrays have one axis more, in front.

    `signal = offset + trend·(t − middle of the record) + amplitude·cos(2π·frequency·t + phase)`

    Args:
        frequency: Hz, as given.
        amplitude: (channels,) V, not negative.
        phase: (channels,) rad, −π to π, at time zero of the record's own time axis.
        offset: (channels,) V, at the middle of the record.
        trend: (channels,) V/s.
        amplitude_u: (channels,) V, standard uncertainty from `noise` and `hum_u`, with `degrees_of_freedom`. It holds
            neither a gain's uncertainty nor pick-up in step with the drive. It is linear, so it holds for amplitudes
            well above it.
        phase_u: (channels,) rad, standard uncertainty from `noise` and `hum_u`; infinite where the amplitude is zero.
        amplitude_bias: (channels,) V, mean error that noise adds to an amplitude, because an amplitude is the length of
            a vector.
        hum_u: (channels,) V, standard uncertainty of an amplitude by hum that was fitted, but whose frequency so short
            a record does not tell.
        rapid: the residuals about a line through each cycle [V] (see `rapid_noise`). Hum that was not fitted is in it.
        noise: (channels,) V, standard deviation of one sample of white noise that has the density of the noise around
            the drive (see `noise_at`).
        correlation: (channels, channels), correlation of the noise.
        degrees_of_freedom: degrees of freedom of `amplitude_u`; (records,) of a stack.
        amplitude_correlation, phase_correlation: (channels, channels), correlations of the errors of `amplitude` and of
            `phase`.
        condition: condition number of the scaled columns; 1 is the least.
        hum: what 1 V of mains hum that was not fitted may add to an amplitude, at its worst phase [V]; 0 where hum was
            fitted.
        most_hum: the same, together with what the wandering frequency of fitted hum may add [V].
        mains: frequencies of the mains as they were fitted [Hz].
        samples: number of samples in each channel.
        rate: samples a second.
    """

    frequency: float
    amplitude: Floats
    phase: Floats
    offset: Floats
    trend: Floats
    amplitude_u: Floats
    phase_u: Floats
    amplitude_bias: Floats
    hum_u: Floats
    rapid: RapidNoise
    noise: Floats
    correlation: Floats
    degrees_of_freedom: float
    amplitude_correlation: Floats
    phase_correlation: Floats
    condition: float
    hum: float
    most_hum: float
    mains: tuple[float, ...]
    samples: int
    rate: float

    @property
    def beside_mains(self) -> bool:
        """Whether the mains turn by less than one turn against the drive in the record."""
        beat = min(abs(self.frequency - mains) for mains in (*MAINS, *self.mains))
        return beat * self.samples < self.rate or any(abs(self.frequency - mains) < WANDER for mains in MAINS)

    @property
    def unbiased(self) -> Floats:
        """`amplitude` (channels,) less `amplitude_bias` [V]."""
        unbiased: Floats = self.amplitude - self.amplitude_bias
        return unbiased


def fit_sine(time: npt.ArrayLike, signals: npt.ArrayLike, frequency: float) -> SineFit:
    """Fit a sine of known frequency, offset, trend and hum to every channel by least squares.

    Args:
        time: (n,) s, increasing; even spacing is not needed.
        signals: (channels, n) V.
        frequency: Hz.

    Raises:
        EstimateError: the shapes do not match, there are fewer than 5 samples, a sample or time is not finite, time
            does not increase, the frequency is not positive or is above half the sample rate (of the median step), the
            record is shorter than a quarter cycle, or the condition number is above 100.
    """
    t = np.asarray(time, dtype=np.float64)
    y = np.asarray(signals, dtype=np.float64)
    _check_samples(t, y)
    step = _check_frequency(t, frequency)
    if t.size > LONGEST_FACTORED:
        return fit_pieces(in_pieces(t, y), frequency)
    basis = sine_columns(t, frequency)
    level = y.mean(axis=-1, keepdims=True)
    basis, scaled = tuned(basis, y - level, basis.solve(y - level))
    fit = _fitted(basis, t, level, y - level, scaled, step)
    return replace(fit, degrees_of_freedom=float(fit.degrees_of_freedom))


def fit_pieces(pieces: Pieces, frequency: float) -> SineFit:
    """The same fit to a record that is read in pieces, again and again, and is never in memory as a whole.

    The noise is the mean of that of segments. Arguments and errors otherwise as `fit_sine`.
    """
    record = RecordInPieces.of(pieces)
    if record.samples <= FEW_SAMPLES:
        return fit_sine(*joined(pieces()), frequency)
    _check_step(record.step, record.last - record.first, frequency)
    basis, scaled = tuned_to(record, *_rated(record, frequency))
    around, rapid = record.noise(basis, scaled)
    fit = _sine_fit(basis, record.level, scaled, around, rapid, record.samples, record.step)
    return replace(fit, degrees_of_freedom=float(fit.degrees_of_freedom))


def _rated(record: RecordInPieces, frequency: float) -> tuple[SineColumns, Floats]:
    """Columns with the mains at their rated frequencies, and the coefficients of a fit with them."""
    basis = record.columns(frequency)
    return record.at(basis, basis.mains)


def fit_sines(time: Floats, stack: Floats, frequency: float) -> tuple[SineFit, npt.NDArray[np.bool_]]:
    """Fit each record (channels, n) of a stack (records, channels, n), to the last bit as `fit_sine` fits it alone.

    The records must be finite. Arithmetic depends on neither the number of records nor their places, because numpy and
    BLAS treat the matrices of a stack one by one.

    Returns:
        The fits, and which records they hold for. In the others the mains may have another frequency than the rated
        one, so that each must be fitted alone.

    Raises:
        EstimateError: as in `fit_sine`, for the times and the frequency.
    """
    _check_samples(time, stack[0])
    step = _check_frequency(time, frequency)
    basis = sine_columns(time, frequency)
    level = stack.mean(axis=-1, keepdims=True)
    centred = stack - level
    scaled = basis.solve(centred)
    return _fitted(basis, time, level, centred, scaled, step), ~humming(basis, centred, scaled)


def _fitted(basis: SineColumns, time: Floats, level: Floats, centred: Floats, scaled: Floats, step: float) -> SineFit:
    """Fit of a record (channels, n) or of a stack of them, of which `centred` is what is left about the `level`."""
    residuals, spent = centred - basis.fitted(scaled), basis.scale.size
    around = _noise_around(basis, residuals, step, spent)
    rapid = rapid_noise(time, residuals, 1 / (basis.frequency * step), spent)
    return _sine_fit(basis, level[..., 0], scaled, around, rapid, time.size, step)


def _sine_fit(
    basis: SineColumns,
    level: Floats,
    scaled: Floats,
    around: EquivalentNoise,
    rapid: RapidNoise,
    samples: int,
    step: float,
) -> SineFit:
    """The fit that coefficients and noise tell. `level`: (..., channels) V, what was taken off the signals."""
    frequency = basis.frequency
    a, b, offset, trend = np.moveaxis(scaled[..., :COEFFICIENTS, :] * basis.scale[:COEFFICIENTS, np.newaxis], -2, 0)
    at_middle = np.arctan2(-b, a)
    along, across = basis.direction(at_middle), basis.direction(at_middle + np.pi / 2)
    amplitude, hum_u = np.hypot(a, b), _wandering(basis, scaled)
    noise_u, across_u = (around.sigma * np.linalg.norm(each, axis=-2) for each in (along, across))
    amplitude_u, turned_u = np.hypot(noise_u, hum_u), np.hypot(across_u, hum_u)
    of_noise, turned_by_noise = (
        np.divide(part, whole, out=np.ones_like(part), where=whole > 0)
        for part, whole in ((noise_u, amplitude_u), (across_u, turned_u))
    )
    turns = math.remainder(frequency * basis.middle, 1.0)
    freedom = np.asarray(around.degrees_of_freedom)[..., np.newaxis] / np.maximum(of_noise, LEAST_SHARE) ** 4
    return SineFit(
        frequency=float(frequency),
        amplitude=amplitude,
        phase=np.remainder(at_middle - 2 * np.pi * turns + np.pi, 2 * np.pi) - np.pi,
        offset=level + offset,
        trend=trend,
        amplitude_u=amplitude_u,
        phase_u=np.divide(turned_u, amplitude, out=np.full_like(amplitude, np.inf), where=amplitude > 0),
        amplitude_bias=amplitude - np.sqrt(np.maximum(amplitude**2 - across_u**2, 0.0)),
        hum_u=hum_u,
        rapid=rapid,
        noise=around.sigma,
        correlation=around.correlation,
        degrees_of_freedom=freedom.min(axis=-1),
        amplitude_correlation=correlated(around.correlation, along, of_noise),
        phase_correlation=correlated(around.correlation, across, turned_by_noise),
        condition=basis.condition,
        hum=basis.hum,
        most_hum=max((basis.hum, *basis.strays)),
        mains=basis.mains,
        samples=samples,
        rate=1 / step,
    )


def _noise_around(basis: SineColumns, residuals: Floats, step: float, spent: int) -> EquivalentNoise:
    found = short_noise(basis, residuals, step)
    if found is not None and found[1].all():
        return found[0]
    longer = noise_at(basis.frequency, residuals, step, spent)
    return longer if found is None else found[0].where(found[1], longer)


def amplitudes(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Amplitudes (channels,) [V] by the fit of `fit_sine`, for thousands of records at the same times.

    Args:
        time: (n,) s.
        signals: (channels, n) V.
        frequency: Hz.

    Raises:
        EstimateError: as in `fit_sine`.
    """
    if time.size > LONGEST_FACTORED:
        return fit_sine(time, signals, frequency).amplitude
    _check_samples(time, signals)
    _check_frequency(time, frequency)
    basis, centred = sine_columns(time, frequency), signals - signals.mean(axis=1, keepdims=True)
    basis, scaled = tuned(basis, centred, basis.solve(centred))
    a, b = scaled[:2] * basis.scale[:2, np.newaxis]
    return np.asarray(np.hypot(a, b), dtype=np.float64)


def quotient_bias(ratio: Some, bottom: Some, variance: Some, covariance: Some) -> Some:
    """Mean error that noise adds to a quotient, to second order.

    A denominator that is too small has a greater effect than one that is too large by as much.

    Args:
        ratio: numerator over denominator.
        bottom: denominator.
        variance: variance of the denominator.
        covariance: covariance of numerator and denominator.
    """
    return (ratio * variance - covariance) / (bottom * bottom)


def _wandering(basis: SineColumns, scaled: Floats) -> Floats:
    """Standard uncertainty (channels,) [V] of amplitudes by hum that is fitted at the mains' rated frequency alone.

    Every frequency within the wander of the mains is as likely as any other, and so is every phase. So it is the
    greatest leak divided by √3 and √2. Where the mains turn less than once against the drive, the greatest leak counts
    as two standard uncertainties.
    """
    if not basis.strays:
        return np.zeros((*scaled.shape[:-2], scaled.shape[-1]))
    hum, _ = basis.phasors(scaled)
    turns = np.abs(np.array(basis.mains) - basis.frequency) * (basis.time[-1] - basis.time[0])
    typical = np.where(turns < 1, 0.5, 1 / math.sqrt(6)) * basis.strays
    found: Floats = np.linalg.norm(np.abs(hum).swapaxes(-1, -2) * typical, axis=-1)
    return found


def _check_samples(time: Floats, signals: Floats) -> None:
    if time.ndim != 1 or signals.ndim != 2 or signals.shape[1] != time.size or signals.shape[0] == 0:
        raise EstimateError(
            f"time has shape {time.shape} and signals {signals.shape}; they must be (n,) and (channels, n)"
        )
    if time.size <= COEFFICIENTS:
        raise EstimateError(
            f"{time.size} samples cannot give {COEFFICIENTS} coefficients and their uncertainty; "
            f"record at least {COEFFICIENTS + 1}"
        )
    bad = np.count_nonzero(~np.isfinite(signals), axis=1)
    if bad.any():
        counts = ", ".join(f"{bad[i]} in channel {i}" for i in np.flatnonzero(bad))
        raise EstimateError(
            f"of {time.size} samples a channel are not finite: {counts}; leave flagged samples out, with their times"
        )
    if not np.isfinite(time).all():
        raise EstimateError(f"{np.count_nonzero(~np.isfinite(time))} of {time.size} times are not finite")
    back = np.flatnonzero(~(np.diff(time) > 0))
    if back.size:
        i = int(back[0])
        raise EstimateError(
            f"time does not increase: sample {i + 1} at {time[i + 1]!s} s follows {time[i]!s} s; sort the record"
        )


def _check_frequency(time: Floats, frequency: float) -> float:
    """Check a frequency [Hz] against the times (n,) [s]; returns the median step of the times [s]."""
    step = median_step(time)
    _check_step(step, float(time[-1] - time[0]), frequency)
    return step


def _check_step(step: float, span: float, frequency: float) -> None:
    if not frequency > 0:
        raise EstimateError(f"frequency {frequency} Hz must be positive; give that of the drive")
    if frequency > 0.5 / step:
        raise EstimateError(
            f"frequency {frequency:g} Hz lies above half the sample rate of {1 / step:g} Hz; sample faster"
        )
    cycles = frequency * (span + step)
    if cycles < SHORTEST_RECORD:
        raise EstimateError(
            f"record of {cycles:.3g} cycles of {frequency:g} Hz is shorter than {SHORTEST_RECORD:g} cycle; "
            f"dwell {1 / frequency:g} s or more"
        )


# --- Estimators of an amplitude, to be compared with each other and with the Cramér–Rao bound ----------
#
# Palpate measures by least squares (`fit_sine`). The others show what a lock-in amplifier, a voltmeter and an
# oscilloscope would have shown. Each has a bias of its own by hum, drift and noise.

Estimator = Callable[[Floats, Floats, float], Floats]
"""Function of time (n,) [s], signals (channels, n) [V] and frequency [Hz] that gives amplitudes (channels,) [V]."""


def boxcar(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier that averages over the record without a window. It is exact over whole cycles."""
    return _lock_in(time, signals, frequency, np.ones_like(time))


def hann(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier with a Hann window. Other tones hardly change it, but it has half as much noise again."""
    middle = (np.arange(time.size) + 0.5) / time.size
    return _lock_in(time, signals, frequency, np.sin(np.pi * middle) ** 2)


def rms(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Voltmeter, AC coupled: √2 times the rms. Hum, drift and noise make it greater."""
    deviation: Floats = signals.std(axis=1)
    return math.sqrt(2) * deviation


def peak_to_peak(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Oscilloscope: half the difference of greatest and least sample. It grows with noise and record length."""
    extent: Floats = np.ptp(signals, axis=1)
    return extent / 2


LEAST_SQUARES = "least squares"
ESTIMATORS: Mapping[str, Estimator] = {
    LEAST_SQUARES: amplitudes,
    "lock-in boxcar": boxcar,
    "lock-in Hann": hann,
    "RMS": rms,
    "peak to peak": peak_to_peak,
}


def amplitude_ratios(estimator: str, time: Floats, records: Floats, frequency: float) -> Floats:
    """Ratios (repeats,) of the amplitudes of two channels: the first over the second.

    Args:
        estimator: name of one of ESTIMATORS.
        time: (n,) s, times that all records share.
        records: (repeats, 2, n) V.
        frequency: Hz.

    Raises:
        UnknownName: no such estimator.
        EstimateError: a record does not determine a sine, or its second channel is silent.
    """
    if estimator not in ESTIMATORS:
        raise UnknownName("estimator", estimator, ESTIMATORS)
    repeats, _, n = records.shape
    found = ESTIMATORS[estimator](time, records.reshape(2 * repeats, n), frequency).reshape(repeats, 2)
    if not (found[:, 1] > 0).all():
        raise EstimateError(f"{estimator}: the second channel is silent in a record, so there is no ratio")
    ratios: Floats = found[:, 0] / found[:, 1]
    return ratios


def ratio_bound(
    time: Floats, frequency: float, amplitude: Floats, phase: Floats, sigma: Floats, correlation: float = 0.0
) -> float:
    """Cramér–Rao bound of the relative standard uncertainty of a ratio of two amplitudes.

    The noise is white; amplitudes, phases, offsets, trends and hum are unknown. Over many whole cycles the bound in
    phase is √((2/n)(σ₁²/A₁² + σ₂²/A₂² − 2ρσ₁σ₂/(A₁A₂))). Over one cycle, trend and hum make it up to 1.6 times as
    large.

    Args:
        time: (n,) s.
        frequency: Hz.
        amplitude: (2,) V.
        phase: (2,) rad, at time zero.
        sigma: (2,) V, standard deviation of the noise of one sample.
        correlation: correlation of the two channels' noise in one sample.

    Raises:
        EstimateError: the times do not determine the sine.
    """
    basis = sine_columns(time, frequency)
    direction = basis.direction(phase + 2 * np.pi * frequency * basis.middle) * (sigma / amplitude)
    together = correlation * float(direction[:, 0] @ direction[:, 1])
    return math.sqrt(max(float((direction**2).sum()) - 2 * together, 0.0))


def _lock_in(time: Floats, signals: Floats, frequency: float, window: Floats) -> Floats:
    weights = window / window.sum() * np.exp(-2j * np.pi * frequency * time)
    found: Floats = 2 * np.abs((signals - signals.mean(axis=1, keepdims=True)) @ weights)
    return found
