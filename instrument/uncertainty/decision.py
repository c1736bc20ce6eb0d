"""Whether a measured value lies within its limits, by the probability that it does not (JCGM 106).

measured = Estimate(4.1, u=0.2, degrees_of_freedom=7)
found = decide(measured, Bounds(high=4.5, risk=0.05))
found.outcome, found.below, found.above     # "pass", 0.0, 0.04
deciding_u(measured, Bounds(high=4.3))      # 0.11: a standard uncertainty with which the same value would pass
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import coverage_factor, scales

Outcome = Literal["pass", "fail", "undecided"]
PASS: Outcome = "pass"
FAIL: Outcome = "fail"
UNDECIDED: Outcome = "undecided"

RISK = 0.05
SMALLEST = 1e-9  # the smallest share of its uncertainty with which a value is asked whether it would be decided
HALVINGS = 60
NODES = 100  # normal distributions of which Student's is mixed where there is a prior


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured value as a distribution: the normal one, or Student's with finite degrees of freedom.

    Attributes:
        value: best estimate.
        u: standard uncertainty; 0: it is known exactly.
        degrees_of_freedom: those of `u`.
        interval: ends of the 95 % interval, where it is not symmetric: each side of the value then has half of the
            probability, with a width of its own.
    """

    value: float
    u: float
    degrees_of_freedom: float = math.inf
    interval: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        given = (self.value, self.u, *(self.interval or ()))
        if not all(map(math.isfinite, given)) or self.u < 0 or (self.u > 0 and min(self.sides) <= 0):
            raise EstimateError(
                f"{self.value} with the standard uncertainty {self.u} and the interval {self.interval} is no estimate;"
                " all must be finite, the uncertainty not negative, and the value within the interval"
            )

    @property
    def sides(self) -> tuple[float, float]:
        """Width of the distribution below and above the value; both `u` where it is symmetric."""
        if self.interval is None:
            return self.u, self.u
        factor = coverage_factor(self.degrees_of_freedom)
        return (self.value - self.interval[0]) / factor, (self.interval[1] - self.value) / factor

    def shrunk(self, share: float) -> Estimate:
        """The same value with a share of its uncertainty."""
        if self.interval is None:
            return replace(self, u=share * self.u)
        low, high = (self.value + share * (end - self.value) for end in self.interval)
        return replace(self, u=share * self.u, interval=(low, high))


@dataclass(frozen=True, slots=True)
class NormalPrior:
    """What was known before the measurement, as a normal distribution."""

    mean: float
    sd: float


@dataclass(frozen=True, slots=True)
class Bounds:
    """The limits of a quantity, which belong to what is allowed.

    Attributes:
        low, high: None: there is no limit on this side.
        risk: greatest probability that a value which passes is outside, or that one which fails is inside.
        prior: None: there is no prior information, so that the measurement alone tells the distribution.
    """

    low: float | None = None
    high: float | None = None
    risk: float = RISK
    prior: NormalPrior | None = None

    def hold(self, value: float) -> bool:
        """Whether a value is within the limits."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)

    def nearest(self, value: float) -> float:
        """The limit that is nearest to a value."""
        return min((each for each in (self.low, self.high) if each is not None), key=lambda each: abs(each - value))


@dataclass(frozen=True, slots=True)
class Decision:
    """What limits say of an estimate; `below` and `above`: probabilities to lie beyond each, NaN if not known."""

    outcome: Outcome
    below: float
    above: float

    @property
    def outside(self) -> float:
        """Probability to lie outside the limits: the specific risk of accepting."""
        return self.below + self.above


def decide(measured: Estimate, bounds: Bounds) -> Decision:
    """Pass: outside with at most the risk. Fail: beyond one of the limits with all but the risk. Else undecided.

    A value between two limits that are closer together than its uncertainty is undecided: it may be beyond either.
    """
    below, above = _beyond(measured, bounds)
    if below + above <= bounds.risk:
        return Decision(PASS, below, above)
    return Decision(FAIL if max(below, above) >= 1 - bounds.risk else UNDECIDED, below, above)


def guard_band(measured: Estimate, bounds: Bounds) -> float:
    """How far from its nearest limit a value is decided by this limit alone, if there is no prior (JCGM 106, 8.3)."""
    nearest = bounds.nearest(measured.value)
    width = measured.sides[0 if nearest < measured.value else 1]
    return coverage_factor(measured.degrees_of_freedom, 1 - 2 * bounds.risk) * width if bounds.risk < 0.5 else 0.0


def deciding_u(measured: Estimate, bounds: Bounds) -> float | None:
    """The greatest standard uncertainty with which an undecided value would be decided; None: with none, as on a limit.

    The value and the degrees of freedom stay as they are.
    """

    def decided(share: float) -> bool:
        return decide(measured.shrunk(share), bounds).outcome != UNDECIDED

    if measured.u == 0 or not decided(SMALLEST):
        return None
    least, most = SMALLEST, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if decided(middle) else (least, middle)
    return least * measured.u


def _beyond(measured: Estimate, bounds: Bounds) -> tuple[float, float]:
    """Probabilities to lie below the lower limit and above the upper one."""
    low, high = (
        -math.inf if bounds.low is None else bounds.low,
        math.inf if bounds.high is None else bounds.high,
    )
    if measured.u == 0:
        return float(measured.value < low), float(measured.value > high)
    if bounds.prior is None:
        return _student(measured, low), 1 - _student(measured, high)
    inside = _mass(measured, bounds.prior, low, high)
    below, above = (_mass(measured, bounds.prior, *ends) for ends in ((-math.inf, low), (high, math.inf)))
    total = below + inside + above
    return (below / total, above / total) if total > 0 else (math.nan, math.nan)


def _student(measured: Estimate, limit: float) -> float:
    """Probability that the value is below a limit, by the measurement alone."""
    from scipy.special import ndtr, stdtr

    away = (limit - measured.value) / measured.sides[0 if limit < measured.value else 1]
    freedom = measured.degrees_of_freedom
    return float(ndtr(away) if math.isinf(freedom) else stdtr(freedom, away))


def _mass(measured: Estimate, prior: NormalPrior, low: float, high: float) -> float:
    """Integral of the measurement's distribution times the prior, from one value to another, but for a factor.

    Student's distribution is a mixture of normal ones, each of which gives a normal distribution with the prior.
    """
    from scipy.special import ndtr

    value, found = measured.value, 0.0
    variances, weights = scales(np.array([measured.degrees_of_freedom]), NODES)
    for width, (start, stop) in zip(measured.sides, ((-math.inf, value), (value, math.inf)), strict=True):
        first, last = max(low, start), min(high, stop)
        if first >= last:
            continue
        own = width**2 * variances[0]
        both = own + prior.sd**2
        centre = (value * prior.sd**2 + prior.mean * own) / both
        spread = np.sqrt(own * prior.sd**2 / both)
        density = np.exp(-0.5 * (value - prior.mean) ** 2 / both) / np.sqrt(both)
        found += float(weights @ (density * (ndtr((last - centre) / spread) - ndtr((first - centre) / spread))))
    return found
