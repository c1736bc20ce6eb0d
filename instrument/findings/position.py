"""Position of a point load on the common base, from the shares of the force that its teeth take.

located = locate(get_design("common_base"), get_sample("1"), (0.6, 0.02), (0.002, 0.001), ((36e-4, 0), (0, 9e-4)))
located.position, located.u, located.low, located.high
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.models.influence import ERROR, shares_along
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample

GRID = 1e-5  # m
TAILS = (0.025, 0.975)  # probabilities at the ends of a 95 % interval


@dataclass(frozen=True, slots=True)
class Located:
    """A located load.

    Attributes:
        position: most likely position along x [m].
        u: root mean square distance of all likely positions from it [m].
        low, high: ends of the 95 % interval [m].

    Two positions on both sides of a tooth give nearly the same shares. Then `u` and the interval are wide.
    """

    position: float
    u: float
    low: float
    high: float


def locate(
    design: Design, sample: Sample, shares: Sequence[float], noise_u: Sequence[float], scatter: npt.ArrayLike
) -> Located:
    """Locate a load along x. Before the measurement, every position is taken to be equally likely.

    Args:
        design: the sensor.
        sample: the object on it.
        shares: share of the whole force that each tooth takes.
        noise_u: standard uncertainties of the shares by noise.
        scatter: (2, 2), relative covariance of the shares by the gains: the design's `tooth_covariance`.

    Raises:
        RangeError: there is no table of point loads for this design and object.
    """
    x = np.linspace(0.0, design.plate.length, round(design.plate.length / GRID) + 1)
    expected = shares_along(design, sample, x)
    alone = np.array(noise_u)[:, None] ** 2 + (ERROR / math.sqrt(3)) ** 2
    own = alone + np.diag(scatter)[:, None] * expected**2
    common = np.asarray(scatter)[0, 1] * expected.prod(axis=0)
    off = np.array(shares)[:, None] - expected
    determinant = own.prod(axis=0) - common**2
    misfit = ((off**2 * own[::-1]).sum(axis=0) - 2 * common * off.prod(axis=0)) / determinant
    score = -0.5 * (misfit + np.log(determinant))
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    best = float(x[int(weight.argmax())])
    below = np.cumsum(weight)
    low, high = (float(x[min(int(np.searchsorted(below, p)), x.size - 1)]) for p in TAILS)
    return Located(best, math.sqrt(float(weight @ (x - best) ** 2)), min(low, best), max(high, best))


def deviations(
    design: Design,
    sample: Sample,
    position: float,
    shares: Sequence[Sequence[float]],
    noise_u: Sequence[float],
    scatter: npt.ArrayLike,
) -> Floats:
    """How far load sets lie from their mean, in the direction in which the shares change with the place of the load.

    Args:
        design, sample, noise_u, scatter: as for `locate`, for one load set.
        position: place of the load [m].
        shares: (sets, 2), shares of both teeth in each load set.

    Returns: (sets,), in standard deviations of one load set by noise and scatter.
    """
    ends = np.clip([position - GRID, position + GRID], 0.0, design.plate.length)
    rise = np.diff(shares_along(design, sample, ends))[:, 0]
    each = np.asarray(shares, dtype=np.float64)
    mean = each.mean(axis=0)
    covariance = np.diag(np.square(noise_u)) + np.asarray(scatter) * np.outer(mean, mean)
    found: Floats = (each - mean) @ rise / math.sqrt(rise @ covariance @ rise)
    return found
