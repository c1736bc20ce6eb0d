"""Random noise in the residuals of a fit of the drive, without the signal's slow drift.

After a change of load a film's offset still decays by some 100 µV while it is recorded. A straight trend over the whole
record leaves the bend of that decay in the residuals, where it would count as noise. So noise is what is left about a
straight line through each cycle.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

FEWEST = 8  # samples for a line, which takes two of their degrees of freedom

Floats = npt.NDArray[np.float64]


def rapid_noise(time: Floats, residuals: Floats, cycle: float, spent: int) -> tuple[Floats, Floats]:
    """Root mean square (channels,) and greatest absolute value (channels,) of the residuals about lines.

    A record of fewer than two cycles has the one line of its trend. Samples after the last whole cycle do not count.

    Args:
        time: (n,) s.
        residuals: (channels, n), residuals of a fit with offset and trend.
        cycle: samples in a cycle.
        spent: number of coefficients of the fit, with offset and trend.
    """
    length = max(round(cycle), FEWEST)
    count = time.size // length
    if count < 2:
        return np.sqrt((residuals**2).sum(axis=1) / (time.size - spent)), np.abs(residuals).max(axis=1)
    used = count * length
    at = time[:used].reshape(count, length)
    at = at - at.mean(axis=1, keepdims=True)
    left = residuals[:, :used].reshape(-1, count, length)
    left = left - left.mean(axis=2, keepdims=True)
    slope = (left * at).sum(axis=2) / (at**2).sum(axis=1)
    left = (left - slope[:, :, np.newaxis] * at).reshape(-1, used)
    freedom = used - 2 * count - (spent - 2)  # the lines hold offset and trend
    return np.sqrt((left**2).sum(axis=1) / freedom), np.abs(left).max(axis=1)


def of_greatest(samples: int) -> float:
    """Relative standard deviation of the greatest absolute value of so many samples of normal noise.

    It is that of the limit, a Gumbel distribution of mode m and scale 1/s (Cramér 1946, 28.6): 4 % low at 250 samples.
    """
    log = math.log(2 * samples)
    s = math.sqrt(2 * log)
    m = s - (math.log(log) + math.log(4 * math.pi)) / (2 * s)
    return math.pi / math.sqrt(6) / (s * m + np.euler_gamma)
