"""Random noise in the residuals of a fit of the drive, without the signal's slow drift.

After a change of load a film's offset still decays by some 100 µV while it is recorded. A straight trend over the whole
record leaves the bend of that decay in the residuals, where it would count as noise. So noise is what is left about a
straight line through each cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.instrument.arrays import Floats

FEWEST = 8  # samples for a line, which takes two of their degrees of freedom
HELD = 4  # places of a cycle that the line and the fitted drive hold where each cycle is like the others


@dataclass(frozen=True, slots=True, eq=False)
class RapidNoise:
    """What is left of each channel's signal about lines.

    Args:
        rms: (..., channels) root mean square.
        rms_u: (..., channels) standard uncertainty of `rms`, with `degrees_of_freedom`.
        greatest: (..., channels) greatest absolute value.
        degrees_of_freedom: degrees of freedom of `rms_u`.
    """

    rms: Floats
    rms_u: Floats
    greatest: Floats
    degrees_of_freedom: float


def rapid_noise(time: Floats, residuals: Floats, cycle: float, spent: int) -> RapidNoise:
    """Noise about a line through each cycle.

    Where an offset stands still within a step of the converter, rounding repeats with each cycle. Then the samples at
    one place in the cycle are all alike, and only places are independent. So the uncertainty comes from the mean
    squares at each place: they differ by chance if noise is random, and by more if rounding repeats. How much squares
    scatter by chance tell the cycles: 2 mean² if noise is normal, less if it is rounding. What is beyond that repeats.

    A record of fewer than two cycles has the one line of its trend, and its samples count as independent. Samples after
    the last whole cycle do not count.

    Args:
        time: (n,) s.
        residuals: (..., channels, n), residuals of a fit with offset and trend.
        cycle: samples in a cycle.
        spent: number of coefficients of the fit, with offset and trend.
    """
    length = max(round(cycle), FEWEST)
    count = time.size // length
    if count < 2:
        freedom = time.size - spent
        rms = np.sqrt((residuals**2).sum(axis=-1) / freedom)
        return RapidNoise(rms, rms / math.sqrt(2 * freedom), np.abs(residuals).max(axis=-1), math.inf)
    return Cycles.of(time, residuals, length).noise(spent)


@dataclass(frozen=True, slots=True, eq=False)
class Cycles:
    """What is left about the line of each cycle, over some whole cycles of a record.

    Attributes:
        count: number of cycles.
        total: (..., channels) sum of the squares of what is left.
        at_place: (..., channels, length) mean square at each place of a cycle.
        scatter: (..., channels, length) variance of the squares at each place.
        greatest: (..., channels) greatest absolute value.
    """

    count: int
    total: Floats
    at_place: Floats
    scatter: Floats
    greatest: Floats

    @classmethod
    def of(cls, time: Floats, residuals: Floats, length: int) -> Cycles:
        """Those of a record or of a part of it; samples after the last whole cycle of this length do not count."""
        count = time.size // length
        used = count * length
        at = time[:used].reshape(count, length)
        at = at - at.mean(axis=1, keepdims=True)
        square = (at**2).sum(axis=1)
        left = residuals[..., :used].reshape(*residuals.shape[:-1], count, length)
        left = left - left.mean(axis=-1, keepdims=True)
        slope = (left * at).sum(axis=-1) / square
        left = left - slope[..., np.newaxis] * at
        free = 1 - 1 / length - at**2 / square[:, np.newaxis]  # of each sample, beside the line of its cycle
        squares = left**2 / free
        return cls(
            count,
            (left**2).sum(axis=(-2, -1)),
            squares.mean(axis=-2),
            squares.var(axis=-2, ddof=1),
            np.abs(left).max(axis=(-2, -1)),
        )

    def __add__(self, other: Cycles) -> Cycles:
        """The cycles of two parts together; each part has two or more."""
        count, apart = self.count + other.count, other.at_place - self.at_place
        within = (self.count - 1) * self.scatter + (other.count - 1) * other.scatter
        return Cycles(
            count,
            self.total + other.total,
            self.at_place + apart * (other.count / count),
            (within + apart**2 * (self.count * other.count / count)) / (count - 1),
            np.maximum(self.greatest, other.greatest),
        )

    def noise(self, spent: int) -> RapidNoise:
        """The noise. `spent`: number of coefficients of the fit, with offset and trend."""
        count, length = self.count, self.at_place.shape[-1]
        used = count * length
        freedom = used - 2 * count - (spent - 2)  # the lines hold offset and trend
        rms = np.sqrt(self.total / freedom)
        mean, by_chance = self.at_place.mean(axis=-1), self.scatter.mean(axis=-1)
        independent = np.maximum(2 * freedom * mean**2 + used * (by_chance - 2 * mean**2), 0.0) / freedom**2
        repeated = (self.at_place.var(axis=-1, ddof=1) - by_chance / count) / (length - HELD)
        mean_u = np.sqrt(np.maximum(independent + repeated, 0.0))
        half = np.divide(mean_u, 2 * mean, out=np.zeros_like(mean), where=mean > 0)  # a root has half the relative u
        return RapidNoise(rms, half * rms, self.greatest, length - HELD - 1)


def of_greatest(samples: int) -> float:
    """Relative standard deviation of the greatest absolute value of so many samples of normal noise.

    It is that of the limit, a Gumbel distribution of mode m and scale 1/s (Cramér 1946, 28.6): 4 % low at 250 samples.
    """
    log = math.log(2 * samples)
    s = math.sqrt(2 * log)
    m = s - (math.log(log) + math.log(4 * math.pi)) / (2 * s)
    return math.pi / math.sqrt(6) / (s * m + np.euler_gamma)
