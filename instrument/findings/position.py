"""Where a point load stands on the common base, from the shares that its teeth take.

located = locate(get_design("common_base"), get_sample("1"), (0.6, 0.02), (0.002, 0.001), (0.06, 0.03))
located.position, located.u, located.low, located.high
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate.instrument.models.influence import ERROR, shares_along
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample

GRID = 5e-5  # m
TAILS = (0.025, 0.975)  # of a 95 % interval


@dataclass(frozen=True, slots=True)
class Located:
    """The likeliest place [m], the root mean square distance of the others from it, and a 95 % interval.

    Beside a tooth two places give nearly the same: then `u` and the interval are wide.
    """

    position: float
    u: float
    low: float
    high: float


def locate(
    design: Design, sample: Sample, shares: Sequence[float], noise_u: Sequence[float], scatter: Sequence[float]
) -> Located:
    """The place along x, every place being as likely before.

    Args:
        shares: of the whole force, of each tooth.
        noise_u: their standard uncertainties by noise.
        scatter: relative standard deviation of each share by the gains.

    Raises:
        RangeError: no table of point loads for this design and object.
    """
    x = np.linspace(0.0, design.plate.length, round(design.plate.length / GRID) + 1)
    expected = shares_along(design, sample, x)
    model_u = ERROR / math.sqrt(3)
    variance = np.array(noise_u)[:, None] ** 2 + (np.array(scatter)[:, None] * expected) ** 2 + model_u**2
    misfit = (np.array(shares)[:, None] - expected) ** 2 / variance + np.log(variance)
    score = -0.5 * misfit.sum(axis=0)
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    best = float(x[int(weight.argmax())])
    below = np.cumsum(weight)
    low, high = (float(x[min(int(np.searchsorted(below, p)), x.size - 1)]) for p in TAILS)
    return Located(best, math.sqrt(float(weight @ (x - best) ** 2)), min(low, best), max(high, best))
