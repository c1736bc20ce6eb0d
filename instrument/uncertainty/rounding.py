"""Error that a display's rounding leaves in a mean of readings, where noise dithers the rounding.

A reading with noise σ is rounded to steps q. Averaged over all positions between two steps, the mean of many readings
is off by

    B(σ)² = q² Σ exp(−4 π² k² σ²/q²) / (2 π² k²), k = 1, 2, …

This is q²/12 without noise, and practically zero at σ = q (Fourier series of the quantiser's error; Widrow and Kollár,
Quantization Noise, 2008). The readings themselves scatter by s² = σ² + q²/12 − B².

The errors of two such means are not independent. If the true readings are y and z, their covariance is

    q² Σ cos(2π k (y − z)/q) exp(−4 π² k² σ²/q²) / (2 π² k²)

Readings that are a whole number of steps apart are rounded alike.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.instrument.arrays import Floats

LEAST_DITHER = 0.2
"""Least noise, as a share of a step, that is told apart from none: less shows in too few readings."""

DITHERED = 5
"""Number of harmonics that noise of `LEAST_DITHER` or more leaves: the next one is below 1e-24."""

SETTLED = 1e-12
"""Relative change of the noise that ends the search for it."""

_HARMONICS = np.arange(1, 201)
_EXPONENTS = -4 * np.pi**2 * _HARMONICS**2
_WITHOUT_NOISE = float(np.sum(1 / (2 * np.pi**2 * _HARMONICS**2)))


def mean_u(scatter: float, step: float, count: float) -> float:
    """Standard uncertainty of the mean of `count` readings whose standard deviation is `scatter`.

    All are in one unit. For a single reading that noise dithers it is √(σ² + step²/12). Infinitely many readings leave
    the error of rounding alone.
    """
    bias = _bias(_noise(scatter / step))
    return step * math.sqrt(bias + (scatter / step) ** 2 / count)


def sums_u(weights: Floats, readings: Floats, scatter: float, step: float) -> Floats:
    """Standard uncertainties (m, p) of weighted sums of means, by the error of rounding alone.

    Each mean is one of infinitely many readings, whose standard deviation is `scatter`.

    Args:
        weights: (n, p), of the n means in p sums.
        readings: (m, n), m cases of the true readings, whose differences alone count.
        scatter, step: as in `mean_u`; all in the unit of the readings.
    """
    noise = _noise(scatter / step)
    count = _HARMONICS.size if noise == 0 else DITHERED
    waves = np.exp(2j * np.pi * _HARMONICS[:count, np.newaxis, np.newaxis] * readings / step) @ weights
    terms = _terms(noise)[:count, np.newaxis, np.newaxis]
    found: Floats = step * np.sqrt(np.sum(terms * np.abs(waves) ** 2, axis=0) / _WITHOUT_NOISE / 12)
    return found


def _bias(noise: float) -> float:
    """B²/q² for σ/q."""
    return float(np.sum(_terms(noise))) / _WITHOUT_NOISE / 12


def _terms(noise: float) -> Floats:
    """What each harmonic adds to the variance for σ/q, in q²."""
    terms: Floats = np.exp(_EXPONENTS * noise**2) / (2 * np.pi**2 * _HARMONICS**2)
    return terms


def _noise(scatter: float) -> float:
    """σ/q for s/q; 0 below `LEAST_DITHER`.

    It is found by Newton's method. s² is convex in σ, so the search begins at σ = s and comes down to the root without
    passing it. (`brentq` takes as long, and 0.3 s to import.)
    """
    if _excess(LEAST_DITHER, scatter) >= 0:
        return 0.0
    noise, step = scatter, math.inf
    while step > SETTLED * noise:
        rise = noise * (2 + float(np.sum(np.exp(_EXPONENTS * noise**2))) / (3 * _WITHOUT_NOISE))
        step = _excess(noise, scatter) / rise
        noise -= step
    return noise


def _excess(noise: float, scatter: float) -> float:
    """Square of the scatter that this noise would give, less the square of the given scatter, in q²."""
    return noise**2 + 1 / 12 - _bias(noise) - scatter**2
