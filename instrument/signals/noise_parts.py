"""White and 1/f noise of a short record, told apart by all that a fit leaves over, and how well they are known.

A short record has few lines of a spectrum, and what is below the first leaks into them. So the samples themselves are
taken: what a fit leaves over has the covariance of white and of 1/f noise, seen through the fit's columns. In the
directions in which both are diagonal each residual is a normal of its own, of variance v (1 − s + s λ): v is what noise
does to the drive, and s the share that 1/f noise has in it (restricted likelihood, Patterson and Thompson 1971). How
large s is a short record hardly knows; so every s counts by its likelihood (Jeffreys' prior), and v with it, by a
scaled chi-squared of the same mean and variance. 1/f noise is more at the drive than where a short record sees noise
best: to take the one likeliest s would leave out those that matter.

That holds in the mean over all shares; of pure 1/f noise it holds 87 % over one cycle. So the degrees of freedom are
those with which the 95 % interval is as wide as by a prior that leans to 1/f noise, the more the fewer the cycles.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.instrument.signals.noise import HARMONICS_FROM, Noise, moments
from palpate.instrument.signals.sine_columns import SineColumns
from palpate.instrument.uncertainty.budget import COVERAGE

Floats = npt.NDArray[np.float64]

LONGEST = 240  # samples: beyond them the spectrum has a shape to fit; the directions take the cube of it, once
FEWEST = 6  # residuals, from which on their variance has a variance
SHARES = np.sin((np.arange(16) + 0.5) * np.pi / 32) ** 2  # of 1/f noise in the power at the drive, alike by Jeffreys
BEYOND_LAW = 1.15  # power of 1/f noise at the drive over that of the law: amplifiers keep it to a tenth or so
LEANING = 8.0  # cycles: over these, the power of the share in the prior that leans; by trial
STEEPER = 0.3  # cycles: over these, what noise that falls as 1/f up to half the sample rate has more at the drive
UPPER = (1 + COVERAGE) / 2
LOWEST = 0.01  # cycles in a record, of 1/f noise: offset and trend take what is slower


def short_noise(basis: SineColumns, residuals: Floats, step: float) -> Noise | None:
    """White noise of the effect that the noise has on the drive; None: the record is too long, or too short.

    Args:
        residuals: (channels, n), what `basis` leaves over.
        step: between samples [s].
    """
    if basis.time.size > LONGEST:
        return None
    from scipy.special import stdtridf, stdtrit

    if basis.kept.modes is None:
        basis.kept.modes = _modes(basis, step)
    directions, relative = basis.kept.modes
    if len(relative) < FEWEST:
        return None
    seen = residuals @ directions
    shape = 1 - SHARES[:, np.newaxis] + SHARES[:, np.newaxis] * relative  # (shares, residuals)
    squares = seen**2 @ (1 / shape).T  # (channels, shares)
    count = len(relative)
    if not (squares > 0).all():
        return None
    likelihood = -0.5 * np.log(shape).sum(axis=1) - 0.5 * count * np.log(squares)
    mean, freedom, weight = _power(likelihood, squares, count)
    cycles = basis.frequency * basis.time.size * step
    worse, worse_freedom, _ = _power(likelihood + LEANING / cycles * np.log(SHARES), squares, count)
    wider = np.sqrt((1 + STEEPER / cycles) * _typical(worse, worse_freedom) / _typical(mean, freedom))
    factor = stdtrit(worse_freedom, UPPER) * wider
    known = stdtridf(UPPER, np.maximum(factor, stdtrit(freedom, UPPER)))
    whitened = seen / np.sqrt(weight @ shape)
    return Noise(np.sqrt(_typical(mean, freedom)), moments(whitened, count)[1], float(known.min()))


def _power(log: Floats, squares: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Mean (channels,) of what noise does to the drive, its degrees of freedom, and the weights of the shares.

    Args:
        log: (channels, shares), logarithms of the weights but for a constant.
        squares: (channels, shares) sums of `count` squared residuals, as each share scales them.
    """
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    mean = (weight * squares).sum(axis=1) / (count - 2)
    square = (weight * squares**2).sum(axis=1) / ((count - 2) * (count - 4))
    return mean, 4 + 2 / (square / mean**2 - 1), weight


def _typical(mean: Floats, freedom: Floats) -> Floats:
    """The scale of a scaled inverse chi-squared of this mean, which is what Student's factor is for."""
    typical: Floats = mean * (freedom - 2) / freedom
    return typical


def _modes(basis: SineColumns, step: float) -> tuple[Floats, Floats]:
    """Directions (n, m) of the residuals, and the variance of 1/f noise in each, by what it is at the drive."""
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
    """Covariance (n, n) of 1/f noise, but for a factor."""
    span = time[-1] - time[0]
    octaves = np.log2(0.5 / step * span / LOWEST)
    corners = LOWEST / span * 2 ** np.linspace(0, octaves, int(np.ceil(octaves)) + 1)
    lag = np.abs(time[:, np.newaxis] - time)
    covariance = np.zeros_like(lag)
    for corner in corners:
        covariance += np.exp(-2 * np.pi * corner * lag)
    return covariance
