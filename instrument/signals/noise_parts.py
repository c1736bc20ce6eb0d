"""White and 1/f noise of a short record, told apart by the residuals of a fit, and how well they are known.

The spectrum of a short record has few lines, and noise below the first line leaks into them. So the residuals
themselves are used. Their covariance is that of white and of 1/f noise, seen through the fit's columns. In the
directions in which both covariances are diagonal, each residual is an independent normal of variance v (1 − s + s λ).
Here v is the effect of the noise on the drive, and s is the share of 1/f noise in it (restricted likelihood, Patterson
and Thompson 1971).

A short record hardly tells s. So every s counts by its likelihood (Jeffreys' prior), and v is described by a scaled
chi-squared of the same mean and variance. The most likely s alone would be too optimistic, because 1/f noise is greater
at the drive than where a short record measures noise best.

These intervals hold 95 % in the mean over all shares, but 87 % for pure 1/f noise over one cycle. So the degrees of
freedom are chosen to make the 95 % interval as wide as by a prior that leans to 1/f noise; it leans more in records of
fewer cycles.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.signals.noise import HARMONICS_FROM, EquivalentNoise, moments
from palpate.instrument.signals.sine_columns import SineColumns
from palpate.instrument.uncertainty.budget import COVERAGE

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
    mean, freedom, weight = _power(likelihood, squares, count)
    cycles = basis.frequency * basis.time.size * step
    worse, worse_freedom, _ = _power(likelihood + LEANING / cycles * np.log(SHARES), squares, count)
    wider = np.sqrt((1 + STEEPER / cycles) * _typical(worse, worse_freedom) / _typical(mean, freedom))
    factor = stdtrit(worse_freedom, UPPER) * wider
    known = stdtridf(UPPER, np.maximum(factor, stdtrit(freedom, UPPER)))
    whitened = seen / np.sqrt(weight @ shape)
    return EquivalentNoise(np.sqrt(_typical(mean, freedom)), moments(whitened, count)[1], known.min(axis=-1)), sound


def _power(log: Floats, squares: Floats, count: int) -> tuple[Floats, Floats, Floats]:
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


def _typical(mean: Floats, freedom: Floats) -> Floats:
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
