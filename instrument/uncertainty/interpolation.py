"""Least-squares polynomial through readings at known loads, as calibrations use it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.quantity import counted

SIGNIFICANCE = 0.01
"""Significance of the tests.

One of a hundred straight cells is taken for curved, and one of a hundred cells for noisier than it is.
"""


@dataclass(frozen=True, slots=True)
class Interpolation:
    """`reading = c0 + c1·load + c2·load²` up to its degree.

    Args:
        coefficients: (degree + 1,), from the constant term on; the indicator's unit per N to the power.
        covariance: (degree + 1, degree + 1), covariance of the coefficients.
        by_scatter: whether the covariance comes from the residuals instead of from `reading_u`.
        residual_sd: standard deviation of the readings about the curve.
        degrees_of_freedom: degrees of freedom of `residual_sd`: points less coefficients.
    """

    coefficients: Floats
    covariance: Floats
    residual_sd: float
    degrees_of_freedom: int
    by_scatter: bool

    def reading(self, load: npt.ArrayLike) -> Floats:
        """Readings at loads [N], an array of the loads' shape."""
        at = np.polynomial.polynomial.polyval(np.asarray(load, dtype=np.float64), self.coefficients)
        return np.asarray(at, dtype=np.float64)


def interpolate(load: npt.ArrayLike, reading: npt.ArrayLike, reading_u: float, degree: int = 1) -> Interpolation:
    """Least-squares polynomial of degree 1 or 2.

    It is fitted by QR of centred and scaled loads, so that a large offset of load or reading costs no digits (normal
    equations of the plain columns were 1.4 N off [M]).

    Args:
        load: (n,) N.
        reading: (n,) in the indicator's unit.
        reading_u: standard uncertainty of a reading, such as resolution/√12. The residuals replace it only where they
            are greater than chance explains (χ² test). Few loads tell little of the scatter, and where each reading
            rounds the same way every time, the scatter is smaller than the error.
        degree: 1 or 2.

    Raises:
        EstimateError: the shapes differ, a value is not finite, there are not more distinct loads than coefficients, or
            `reading_u` is negative.
    """
    x = np.asarray(load, dtype=np.float64)
    y = np.asarray(reading, dtype=np.float64)
    if x.ndim != 1 or x.shape != y.shape:
        raise EstimateError(f"loads have shape {x.shape} and readings {y.shape}; both must be (n,)")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        bad = np.flatnonzero(~(np.isfinite(x) & np.isfinite(y)))
        raise EstimateError(f"load or reading is not finite at {', '.join(f'point {i}' for i in bad)}; repeat it")
    if not (math.isfinite(reading_u) and reading_u >= 0):
        raise EstimateError(f"standard uncertainty {reading_u} of a reading must be zero or more; give resolution/√12")
    distinct = np.unique(x).size
    if distinct < degree + 2:
        what = "a line" if degree == 1 else "a second degree"
        raise EstimateError(
            f"{counted(distinct, 'distinct load')} cannot give {what} and its uncertainty; use at least {degree + 2}"
        )
    centre_reading = float(y.mean())
    columns, back = _powers(x, degree)
    q, r = np.linalg.qr(columns)
    own = np.linalg.solve(r, q.T @ (y - centre_reading))
    degrees_of_freedom = x.size - degree - 1
    residual_sd = float(np.linalg.norm(y - centre_reading - columns @ own)) / math.sqrt(degrees_of_freedom)
    from scipy.special import chdtri

    by_scatter = residual_sd**2 * degrees_of_freedom > reading_u**2 * chdtri(degrees_of_freedom, SIGNIFICANCE)
    root = np.linalg.inv(r) * (residual_sd if by_scatter else reading_u)
    root = back @ root
    coefficients = back @ own
    coefficients[0] += centre_reading
    return Interpolation(coefficients, root @ root.T, residual_sd, degrees_of_freedom, bool(by_scatter))


def best_degree(load: npt.ArrayLike, reading: npt.ArrayLike, reading_u: float) -> int:
    """Degree of the polynomial: 2 where the second degree lowers the scatter by more than chance does (F-test), else 1.

    Scatter below `reading_u` counts as `reading_u`, because errors of rounding have no shape.

    Raises:
        EstimateError: as in `interpolate` with degree 1.
    """
    line = interpolate(load, reading, reading_u)
    if np.unique(np.asarray(load)).size < 4:
        return 1
    curve = interpolate(load, reading, reading_u, 2)
    explained = line.residual_sd**2 * line.degrees_of_freedom - curve.residual_sd**2 * curve.degrees_of_freedom
    scatter = max(curve.residual_sd, reading_u) ** 2
    from scipy.special import fdtri

    limit = float(fdtri(1, curve.degrees_of_freedom, 1 - SIGNIFICANCE))
    return 2 if explained > limit * scatter else 1


def polynomials(load: Floats, degree: int) -> tuple[Floats, Floats]:
    """Orthonormal polynomials at loads (n,) [N], and what they are in powers of the load.

    Returns:
        q: (n, degree + 1). A least-squares fit weighs the readings by its columns.
        powers: (degree + 1, degree + 1). It turns their sums q.T @ reading into the coefficients of the fit.
    """
    columns, back = _powers(load, degree)
    q, r = np.linalg.qr(columns)
    return q, back @ np.linalg.inv(r)


def _powers(load: Floats, degree: int) -> tuple[Floats, Floats]:
    """Powers (n, degree + 1) of (load − centre)/scale; the matrix that turns their coefficients into those of the load.

    It keeps digits that powers of the load itself would lose.
    """
    centre, scale = float(load.mean()), float(np.ptp(load)) / 2
    matrix = np.zeros((degree + 1, degree + 1))
    for power in range(degree + 1):
        for own in range(power + 1):
            matrix[own, power] = math.comb(power, own) * (-centre) ** (power - own) / scale**power
    return np.vander((load - centre) / scale, degree + 1, increasing=True), matrix
