"""The least-squares sine as a linear map from the samples of a dwell to cosine and sine, and its greatest errors."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from palpate.instrument.arrays import Complexes, Floats
from palpate.instrument.signals.estimate import amplitudes
from palpate.instrument.signals.sine_columns import SineColumns, sine_columns
from palpate.simulators.physics.effect import Case

DIRECTIONS = 64  # number of directions in half a circle
SIGMAS = 6.0  # standard deviations of noise in a bound: two quadratures exceed them once in 6e7 fits


def fitted(case: Case, samples: Floats) -> Complexes:
    """Fitted phasors (...) of samples (..., n). Raises EstimateError: the dwell does not determine a sine."""
    cosine, sine = weights(case)
    centred = samples - samples.mean(axis=-1, keepdims=True)
    return np.asarray(centred @ cosine - 1j * (centred @ sine))


def largest(case: Case, variance: Floats) -> float:
    """Six standard deviations of an amplitude by independent noise of a variance (phases, n) or (n,) in each sample."""
    covariance = np.einsum("in,...n,jn->...ij", weights(case), variance, weights(case))
    return SIGMAS * math.sqrt(float(np.linalg.norm(covariance, 2, axis=(-2, -1)).max()))


def spread(case: Case) -> float:
    """Standard deviation of an amplitude over that of independent noise in each sample."""
    return float(np.linalg.norm(weights(case), 2))


def correlated_spread(case: Case, correlation: Callable[[Floats], Floats]) -> float:
    """Standard deviation of an amplitude over that of noise with a correlation, which is a function of the lag [s]."""
    from scipy.linalg import matmul_toeplitz

    column = correlation(np.arange(weights(case).shape[1]) / case.rate)
    covariance = weights(case) @ matmul_toeplitz(column, weights(case).T)
    return math.sqrt(np.linalg.norm(covariance, 2))


def largest_within(case: Case) -> float:
    """Greatest error of an amplitude over the greatest error of a sample."""
    return _largest(case.frequency, case.dwell, case.rate)


@functools.lru_cache(maxsize=8)
def _largest(frequency: float, dwell: float, rate: float) -> float:
    # The sum of |weights| along a direction is convex, so around the circle it is below that at a polygon's corners.
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    seen = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ _fit_weights(frequency, dwell, rate)
    return float(np.abs(seen).sum(axis=1).max()) / math.cos(np.pi / 2 / DIRECTIONS)


def largest_tone(case: Case, frequency: float) -> float:
    """Greatest error of an amplitude over the amplitude of a sine of another frequency [Hz]."""
    turns = np.exp(2j * np.pi * frequency * np.arange(weights(case).shape[1]) / case.rate)
    phasors = weights(case) @ turns
    return float(np.linalg.norm(np.stack([phasors.real, phasors.imag]), 2))  # at its worst phase


def weights(case: Case) -> Floats:
    """Weights (2, n) of the samples of a dwell in the fitted cosine and sine. Raises EstimateError."""
    return _fit_weights(case.frequency, case.dwell, case.rate)


def columns(case: Case) -> SineColumns:
    """Columns of the fit of a dwell. Raises EstimateError."""
    return _columns(case.frequency, case.dwell, case.rate)


@functools.lru_cache(maxsize=8)
def _fit_weights(frequency: float, dwell: float, rate: float) -> Floats:
    return _columns(frequency, dwell, rate).weights()


@functools.lru_cache(maxsize=8)
def _columns(frequency: float, dwell: float, rate: float) -> SineColumns:
    times = np.arange(max(1, round(dwell * rate))) / rate
    amplitudes(times, np.zeros((1, len(times))), frequency)  # raises where a fit raises
    return sine_columns(times, frequency)
