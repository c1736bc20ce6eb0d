"""The curve through readings of a display that rounds them, some of them alike.

Loads that are nearly a whole number of display steps apart are rounded alike, in every run. How alike depends on the
slope. That is known to its uncertainty alone, so the greatest error over all slopes within it counts, and never less
than that of rounding which is independent from load to load.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.uncertainty.interpolation import Interpolation, interpolate, polynomials
from palpate.instrument.uncertainty.rounding import mean_u, sums_u

SLOPES = 41
"""Number of slopes that are tried. Over all of them the readings move by less than a step against each other."""


def displayed_curve(
    load: Floats, reading: Floats, scatter: float, step: float, values: float, degree: int
) -> Interpolation:
    """Least-squares polynomial through mean readings, whose covariance holds what loads share of the rounding.

    Orthonormal polynomials weigh the readings. For evenly spaced loads, the errors of mean and slope in these terms are
    uncorrelated; they count as uncorrelated for all loads.

    Args:
        load: (n,) N, increasing.
        reading: (n,) mV, each the mean of some displayed values.
        scatter: standard deviation of single displayed values [mV].
        step: step of the display [mV].
        values: number of displayed values in each mean.
        degree: 1 or 2.

    Raises:
        EstimateError: as in `interpolate`.
    """
    curve = interpolate(load, reading, mean_u(scatter, step, values), degree)
    weights, powers = polynomials(load, degree)
    rounded = rounding_u(load, curve.reading(load), weights, scatter, step, values)
    own = curve.residual_sd if curve.by_scatter else mean_u(scatter, step, values)
    variances = own**2 + rounded**2 - mean_u(scatter, step, math.inf) ** 2
    return replace(curve, covariance=(powers * variances) @ powers.T)


def rounding_u(load: Floats, reading: Floats, weights: Floats, scatter: float, step: float, values: float) -> Floats:
    """Standard uncertainties (p,) of weighted sums of mean readings by rounding alone, which no further value lowers.

    Args:
        load, scatter, step, values: as in `displayed_curve`.
        reading: (n,) mV, on the curve.
        weights: (n, p), of the readings in p sums.
    """
    about = load - load.mean()
    widest = math.sqrt(3) * mean_u(scatter, step, values) / float(np.linalg.norm(about))
    cases = reading + np.linspace(-widest, widest, SLOPES)[:, np.newaxis] * about
    shared = sums_u(weights, cases, scatter, step).max(axis=0)
    independent = mean_u(scatter, step, math.inf) * np.linalg.norm(weights, axis=0)
    greatest: Floats = np.maximum(shared, independent)
    return greatest
