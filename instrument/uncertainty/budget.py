"""Uncertainty budget of a result, after the GUM (JCGM 100).

    budget = Budget("load", 2.98, "N", (
        Component("calibration", u=0.004, degrees_of_freedom=5),
        Component("resolution", u=1e-3 / math.sqrt(12), sensitivity=97.0),
    ))
    budget.u, budget.expanded(), budget.rows()

`propagate` makes a budget from a function of its inputs, and checks whether a linear budget is good enough.
"""

from __future__ import annotations

import functools
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, RangeError

# --- the budget ----------------------------------------------------------------------------------------


Correlations = Mapping[tuple[str, str], float]
Kind = Literal["A", "B"]

COVERAGE = 0.95
INDEFINITE = 1e-9
"""How far below zero an eigenvalue of a correlation matrix may be, since coefficients have nine digits at most."""


@dataclass(frozen=True, slots=True)
class Component:
    """One input of a result.

    Args:
        name: what is uncertain, such as "calibration".
        u: standard uncertainty of the input, in the input's own unit.
        sensitivity: change of the result over change of the input, in the result's unit over the input's.
        degrees_of_freedom: degrees of freedom of `u`, above 0; infinite where it is known exactly.
        kind: "A" from repeats, "B" from anything else.
    """

    name: str
    u: float
    sensitivity: float = 1.0
    degrees_of_freedom: float = math.inf
    kind: Kind = "B"

    def __post_init__(self) -> None:
        if not (math.isfinite(self.u) and self.u >= 0 and math.isfinite(self.sensitivity)):
            raise EstimateError(
                f"{self.name}: standard uncertainty {self.u} with sensitivity {self.sensitivity} makes no budget;"
                " the first must be zero or more, both finite"
            )
        if not self.degrees_of_freedom > 0:
            raise EstimateError(
                f"{self.name}: {self.degrees_of_freedom} degrees of freedom; an uncertainty needs more than 0 of them:"
                " repeat the measurement"
            )

    @property
    def contribution(self) -> float:
        """Uncertainty that it adds to the result, with the sign of its sensitivity, in the result's unit."""
        return self.sensitivity * self.u


@dataclass(frozen=True, slots=True)
class Budget:
    """A result with its uncertain inputs.

    Args:
        quantity, unit: name and unit of the result, for people.
        value: value in `unit`.
        components: the uncertain inputs, each with a name of its own.
        correlations: correlation coefficients of two inputs by their names, −1 to 1; all other pairs are independent.
            A coefficient of 0 says that the two are uncorrelated, but that one estimate of scatter gave both
            uncertainties: they share its degrees of freedom.
        prior: name of an independent input whose scatter is drawn from a prior, so that the result is a mixture of
            distributions (`mixture_factor`); empty: there is none.

    Raises:
        EstimateError: a value is not finite, two components share a name, a correlation names an unknown input, or the
            coefficients cannot hold together.
    """

    quantity: str
    value: float
    unit: str
    components: tuple[Component, ...]
    correlations: Correlations = field(default_factory=dict)
    prior: str = ""

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise EstimateError(f"{self.quantity} is {self.value}: without a finite value there is no budget")
        correlation_factor([c.name for c in self.components], self.correlations)

    @property
    def u(self) -> float:
        """Combined standard uncertainty."""
        return _length(self._contributions(), self._factor())

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom, by Welch and Satterthwaite (JCGM 100, G.4.1).

        Inputs that `correlations` connects count as one input, with the fewest degrees of freedom among them. With a
        `prior` they are those with which Student's interval is as wide as that of the mixture.
        """
        contributions, factor = self._contributions(), self._factor()
        total = _length(contributions, factor)
        if total == 0:
            return math.inf
        spent, mixed, freedom = 0.0, 0.0, math.inf
        for group in groups([c.name for c in self.components], self.correlations):
            fewest = min(self.components[i].degrees_of_freedom for i in group)
            part = _length(contributions[group], factor[group]) / total
            if self.prior in {self.components[i].name for i in group}:
                mixed, freedom = part**2, fewest
            elif math.isfinite(fewest):
                spent += part**4 / fewest
        if mixed == 0 or math.isinf(freedom):
            return 1 / spent if spent > 0 else math.inf
        return equivalent_freedom(mixture_factor(mixed, freedom, (1 - mixed) ** 2 / spent if spent > 0 else math.inf))

    def expanded(self, coverage: float = COVERAGE) -> float:
        """Expanded uncertainty: half the width of the interval that covers the value with this probability."""
        return coverage_factor(self.degrees_of_freedom, coverage) * self.u

    def interval(self, coverage: float = COVERAGE) -> tuple[float, float]:
        half = self.expanded(coverage)
        return self.value - half, self.value + half

    def rows(self) -> list[dict[str, Any]]:
        """One row for each component, for a table or JSON.

        `share` is the component's share of the variance. Half of what a correlation adds counts for each of its two
        inputs. Shares add up to 1; a share is negative where a correlation takes away more than the input adds.
        """
        contributions, factor = self._contributions(), self._factor()
        total = self.u
        together = factor.T @ (contributions / total) if total > 0 else np.zeros(factor.shape[1])
        shares = contributions / (total or 1.0) * (factor @ together)
        return [
            {
                "name": c.name,
                "kind": c.kind,
                "u": c.u,
                "sensitivity": c.sensitivity,
                "contribution": c.contribution,
                "degrees_of_freedom": c.degrees_of_freedom if math.isfinite(c.degrees_of_freedom) else None,
                "share": float(share),
            }
            for c, share in zip(self.components, shares, strict=True)
        ]

    def summary(self) -> dict[str, Any]:
        """The whole budget as JSON has it; None stands for infinitely many degrees of freedom."""
        freedom = self.degrees_of_freedom
        return {
            "quantity": self.quantity,
            "value": self.value,
            "unit": self.unit,
            "u": self.u,
            "degrees_of_freedom": freedom if math.isfinite(freedom) else None,
            "coverage": COVERAGE,
            "expanded": self.expanded(),
            "components": self.rows(),
            "correlations": [{"of": list(pair), "coefficient": r} for pair, r in self.correlations.items()],
        }

    def _contributions(self) -> Floats:
        return np.array([c.contribution for c in self.components], dtype=np.float64)

    def _factor(self) -> Floats:
        return correlation_factor([c.name for c in self.components], self.correlations)


# Quantile (1 + COVERAGE) / 2 of the normal distribution: to import scipy for it would take longer than all else.
NORMAL_FACTOR = 1.959963984540054


def coverage_factor(degrees_of_freedom: float, coverage: float = COVERAGE) -> float:
    """Student's factor for a two-sided interval. Degrees of freedom need not be whole.

    Raises:
        EstimateError: the degrees of freedom are not above 0, or the coverage is not between 0 and 1.
    """
    if not (degrees_of_freedom > 0 and 0 < coverage < 1):
        raise EstimateError(f"no coverage factor for {degrees_of_freedom} degrees of freedom and coverage {coverage}")
    if math.isinf(degrees_of_freedom) and coverage == COVERAGE:
        return NORMAL_FACTOR
    from scipy.special import ndtri, stdtrit

    upper = (1 + coverage) / 2
    return float(ndtri(upper) if math.isinf(degrees_of_freedom) else stdtrit(degrees_of_freedom, upper))


def correlation_factor(names: Sequence[str], correlations: Correlations) -> Floats:
    """Matrix F (n, n) for which F Fᵀ is the matrix of correlations.

    It is found by eigenvalues; eigenvalues that are zero except for round-off are left out. Sums of squares and
    products instead would leave 1e-8 where inputs cancel.

    Raises:
        EstimateError: two names are equal, a name is unknown, or the coefficients cannot hold together.
    """
    place = {name: i for i, name in enumerate(names)}
    if len(place) < len(names):
        raise EstimateError(f"two inputs of one name among {', '.join(names)}; give each a name of its own")
    matrix = np.eye(len(names))
    for (one, other), coefficient in correlations.items():
        if one not in place or other not in place or one == other:
            raise EstimateError(f"correlation of {one!r} and {other!r}: give two of {', '.join(names)}")
        if not -1 <= coefficient <= 1:
            raise EstimateError(f"correlation {coefficient} of {one!r} and {other!r} is outside -1 to 1")
        matrix[place[one], place[other]] = matrix[place[other], place[one]] = coefficient
    if not any(correlations.values()):
        return matrix
    values, vectors = np.linalg.eigh(matrix)
    if values[0] < -INDEFINITE * len(names):
        raise EstimateError(
            f"correlations {dict(correlations)} cannot be true together: their matrix has the eigenvalue"
            f" {values[0]:.2g}; all must be zero or more"
        )
    factor: Floats = vectors * np.sqrt(np.where(values > INDEFINITE * len(names), values, 0.0))
    return factor


def groups(names: Sequence[str], correlations: Correlations) -> list[list[int]]:
    """Groups of inputs that correlations connect, as lists of their numbers.

    An independent input is a group of its own.
    """
    found = [{name} for name in names]
    for pair in correlations:
        joined = set().union(*(group for group in found if group & set(pair)))
        found = [group for group in found if not group & set(pair)] + [joined]
    return [[i for i, name in enumerate(names) if name in group] for group in found]


def _length(contributions: Floats, factor: Floats) -> float:
    """√(cᵀ F Fᵀ c), without overflow or underflow."""
    largest = float(np.abs(contributions).max(initial=0.0))
    return largest * float(np.linalg.norm(factor.T @ (contributions / largest))) if largest > 0 else 0.0


# -------------------------------------------------------------------------------------------------------
# Half-width of an interval of a sum of two independent parts whose scatters are both known from few data
#
# mixture_factor(share=0.7, freedom=2, rest=9)     # 3.76, where Welch and Satterthwaite would have 2.80
#
# Each part is normal with a scatter that is itself distributed: an inverse χ² with the part's degrees of freedom. So
# the sum is a mixture of normal distributions (Behrens and Fisher). This is what a prior for a scatter says: with two
# degrees of freedom, the effective ones of Welch and Satterthwaite make an interval that holds 90 % where it says 95.

NODES = 24, 12  # at which the distributions of the two scatters are asked
SETTLED = 1e-6  # relative step of Newton's method after which no further one moves anything
FEWEST = 2.0  # degrees of freedom of the table of `mixture_factors`
SHARES = np.linspace(0.0, 1.0, 21) ** 2
FREEDOM = np.array([math.inf, 25, 10, 6, 4, 3, 2.4, 2])
REST = np.array([math.inf, 50, 16, 9, 6, 4, 3, 2.5, 2])


def mixture_factor(share: float, freedom: float, rest: float) -> float:
    """Half-width of the 95 % interval over the combined standard uncertainty.

    Args:
        share: share of one part in the variance, 0 to 1.
        freedom: its degrees of freedom, above 0; infinite where its scatter is known.
        rest: those of the other part.
    """
    return float(_factors(np.array([share]), np.array([freedom]), np.array([rest]))[0])


def mixture_factors(share: Floats, freedom: Floats, rest: Floats) -> Floats:
    """`mixture_factor` of many plans at once, from a table; fewer than two degrees of freedom count as two."""
    from scipy.ndimage import map_coordinates

    inverse = (1 / np.maximum(each, FEWEST) for each in (freedom, rest))
    places = [
        np.interp(values, axis, np.arange(axis.size))
        for values, axis in zip((share, *inverse), (SHARES, 1 / FREEDOM, 1 / REST), strict=True)
    ]
    found: Floats = map_coordinates(_grid(), np.broadcast_arrays(*places), order=1, mode="nearest")
    return found


def equivalent_freedom(factor: float) -> float:
    """The degrees of freedom with which Student's factor is the given one; infinite for that of the normal."""
    from scipy.special import stdtridf

    return math.inf if factor <= NORMAL_FACTOR * (1 + 1e-9) else float(stdtridf((1 + COVERAGE) / 2, factor))


@functools.cache
def _grid() -> Floats:
    """Factors at all nodes of the axes of `mixture_factors`."""
    cells = np.meshgrid(SHARES, FREEDOM, REST, indexing="ij")
    return _factors(*(each.ravel() for each in cells)).reshape(cells[0].shape)


def _factors(share: Floats, freedom: Floats, rest: Floats) -> Floats:
    from scipy.special import erf, stdtrit

    (one, of_one), (other, of_other) = scales(freedom, NODES[0]), scales(rest, NODES[1])
    variance = (share[:, None] * one)[:, :, None] + ((1 - share)[:, None] * other)[:, None, :]
    with np.errstate(divide="ignore"):
        inverse = np.sqrt(0.5 / variance)
    weight = of_one[:, None] * of_other[None, :]
    welch = 1 / np.maximum(share**2 / freedom + (1 - share) ** 2 / rest, 1e-9)
    factor = np.asarray(stdtrit(welch, (1 + COVERAGE) / 2), dtype=np.float64)
    while True:  # it is never too great, and the distribution is concave: Newton's method climbs and passes no root
        reach = factor[:, None, None] * inverse
        missing = COVERAGE - (weight * erf(reach)).sum(axis=(1, 2))
        slope = (weight * 2 / math.sqrt(math.pi) * np.exp(-(reach**2)) * inverse).sum(axis=(1, 2))
        step = np.maximum(missing / slope, 0.0)
        factor += step
        if not (step > SETTLED * factor).any():
            return factor


def scales(freedom: Floats, nodes: int) -> tuple[Floats, Floats]:
    """Variances over their estimates (n, nodes), and their weights (nodes,), by a rule of Gauss and Legendre.

    The rule takes the cube root of the probability, because a scatter of few degrees of freedom may be huge.
    """
    from scipy.special import gammaincinv

    places, weights = _rule(nodes)
    root = (places + 1) / 2
    half = np.minimum(freedom, 1e9)[:, None] / 2
    return half / gammaincinv(half, root**3), 1.5 * root**2 * weights


@functools.cache
def _rule(nodes: int) -> tuple[Floats, Floats]:
    """Nodes and weights of Gauss and Legendre."""
    places, weights = np.polynomial.legendre.leggauss(nodes)
    return places, weights


# -------------------------------------------------------------------------------------------------------
# How much groups of repeats scatter beyond what the repeats within them do, and whether that can be told from
# nothing
#
# found = between_groups([[0.221, 0.230, 0.226], [0.215, 0.223, 0.219], [0.228, 0.224, 0.233]]) found.u,
# found.bound_u, found.significant


@dataclass(frozen=True, slots=True)
class Between:
    """Relative scatter of groups, by the means of some of them.

    Attributes:
        means_u: relative standard deviation of the groups' means.
        degrees_of_freedom: its degrees of freedom, groups less one.
        within_u: what the repeats within the groups alone add to it.
        within_freedom: the degrees of freedom of that.
    """

    means_u: float
    degrees_of_freedom: int
    within_u: float
    within_freedom: int

    @property
    def u(self) -> float:
        """Relative standard deviation from group to group beyond that of their repeats; 0: the means lie closer."""
        return math.sqrt(max(self.means_u**2 - self.within_u**2, 0.0))

    @property
    def significant(self) -> bool:
        """Whether the means lie farther apart than those of groups that are alike do in 95 % of cases (F)."""
        from scipy.special import fdtri

        limit = float(fdtri(self.degrees_of_freedom, self.within_freedom, COVERAGE))
        return self.means_u**2 > limit * self.within_u**2

    @property
    def bound_u(self) -> float:
        """The scatter that groups have at most, in 95 % of cases (χ²); what their repeats add is left in it."""
        from scipy.special import chdtri

        return self.means_u * math.sqrt(self.degrees_of_freedom / float(chdtri(self.degrees_of_freedom, COVERAGE)))


def between_groups(groups: Sequence[Sequence[float]]) -> Between:
    """The scatter of groups of values above 0. Raises RangeError: they are not two or more, of two values or more."""
    if len(groups) < 2 or min(map(len, groups)) < 2:
        raise RangeError("a scatter of groups needs two groups or more, of two values or more; measure more")
    logs = [[math.log(value) for value in group] for group in groups]
    within = math.fsum(statistics.variance(group) / len(group) for group in logs) / len(logs)
    means = statistics.stdev(math.fsum(group) / len(group) for group in logs)
    return Between(means, len(logs) - 1, math.sqrt(within), sum(map(len, logs)) - len(logs))


# --- rounding of a display -----------------------------------------------------------------------------

# A reading with noise σ is rounded to steps q. Averaged over all positions between two steps, the mean of many readings
# is off by
#
#     B(σ)² = q² Σ exp(−4 π² k² σ²/q²) / (2 π² k²), k = 1, 2, …
#
# This is q²/12 without noise, and practically zero at σ = q (Fourier series of the quantiser's error; Widrow and
# Kollár, Quantization Noise, 2008). The readings themselves scatter by s² = σ² + q²/12 − B².
#
# The errors of two such means are not independent. If the true readings are y and z, their covariance is
#
#     q² Σ cos(2π k (y − z)/q) exp(−4 π² k² σ²/q²) / (2 π² k²)
#
# Readings that are a whole number of steps apart are rounded alike.


LEAST_DITHER = 0.2
"""Least noise, as a share of a step, that is told apart from none: less shows in too few readings."""

DITHERED = 5
"""Number of harmonics that noise of `LEAST_DITHER` or more leaves: the next one is below 1e-24."""

SETTLED_ROUNDING = 1e-12
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
    while step > SETTLED_ROUNDING * noise:
        rise = noise * (2 + float(np.sum(np.exp(_EXPONENTS * noise**2))) / (3 * _WITHOUT_NOISE))
        step = _excess(noise, scatter) / rise
        noise -= step
    return noise


def _excess(noise: float, scatter: float) -> float:
    """Square of the scatter that this noise would give, less the square of the given scatter, in q²."""
    return noise**2 + 1 / 12 - _bias(noise) - scatter**2


# --- propagation ---------------------------------------------------------------------------------------

#     found = propagate("force", "N", lambda v, s: v / s, (Input("voltage", 0.2, 1e-3), Input("sensitivity", 0.07,
# 2e-3)),                       seed=1)     found.u, found.low, found.high, found.method, found.why
#
# The linear budget follows the GUM (JCGM 100). Monte Carlo follows JCGM 101, with a fixed number of trials; clause 8
# there decides whether the linear interval agrees.


Function = Callable[..., npt.ArrayLike]
Shape = Literal["normal", "rectangular"]

LINEAR, MONTE_CARLO = "linear", "Monte Carlo"
TRIALS = 100_000
AGREEMENT = 0.05
"""Greatest difference of two intervals' ends that still agree, in standard uncertainties.

It is half a unit of the second digit where the uncertainty begins with 10. JCGM 101 takes half a unit of the last
stated digit; this limit does not change with the unit of the result.
"""
SEEN = 2.0  # number of standard uncertainties within which curvature is looked for
MOSTLY = 0.5  # share of the variance above which a rectangular input changes the interval
MANY = 1e4  # degrees of freedom above which Student's t counts as normal
COARSE = 1024  # least number of steps of a float64 that a difference spans
ROUND_OFF = 64.0  # steps of a float64 by which a function's result may be off


@dataclass(frozen=True, slots=True)
class Input:
    """An uncertain input: its best estimate, its standard uncertainty and its distribution.

    A normal distribution with finite degrees of freedom is a scaled Student's t (JCGM 101, 6.4.9).
    """

    name: str
    value: float
    u: float
    degrees_of_freedom: float = math.inf
    kind: Kind = "B"
    shape: Shape = "normal"

    def __post_init__(self) -> None:
        if not math.isfinite(self.value):
            raise EstimateError(f"{self.name} is {self.value}: an input must be finite")
        Component(self.name, self.u, 1.0, self.degrees_of_freedom)  # raises where the input is invalid


@dataclass(frozen=True, slots=True)
class Propagated:
    """A result with its interval.

    Attributes:
        value: the function at the estimates; by Monte Carlo the mean of the trials.
        u: standard uncertainty.
        low, high: ends of the 95 % interval.
        method: "linear" or "Monte Carlo".
        why: one sentence that says why this method was used.
        budget: the linear budget, by any method, for its components.
    """

    value: float
    u: float
    low: float
    high: float
    method: str
    why: str
    budget: Budget

    def summary(self) -> dict[str, Any]:
        """The result as JSON has it."""
        own = {"value": self.value, "u": self.u, "low": self.low, "high": self.high}
        return {**own, "method": self.method, "why": self.why, "budget": self.budget.summary()}


@dataclass(frozen=True, slots=True)
class _PropagationProblem:
    function: Function
    inputs: tuple[Input, ...]
    correlations: Correlations = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.inputs]

    @property
    def values(self) -> Floats:
        return np.array([each.value for each in self.inputs])[:, np.newaxis]

    @property
    def u(self) -> Floats:
        return np.array([each.u for each in self.inputs])[:, np.newaxis]

    def at(self, points: Floats) -> Floats:
        """Values (n,) of the function at points (inputs, n)."""
        with np.errstate(all="ignore"):
            found = np.asarray(self.function(*points), dtype=np.float64)
        found = np.broadcast_to(found, points.shape[1:]) if found.ndim == 0 else found
        if found.shape != points.shape[1:]:
            raise EstimateError(f"the function gives shape {found.shape} for {points.shape[1]} values of each input")
        return found


def propagate(
    quantity: str,
    unit: str,
    function: Function,
    inputs: Sequence[Input],
    correlations: Correlations | None = None,
    *,
    seed: int,
    sensitivities: Sequence[float] | None = None,
    method: str | None = None,
) -> Propagated:
    """Value, uncertainty and 95 % interval of a function of uncertain inputs.

    If no method is given, the function is first examined within two standard uncertainties of the inputs. The linear
    budget is used where the function departs from a straight line by less than 0.05 standard uncertainties of the
    result and no rectangular input holds most of the variance. Otherwise 100,000 trials are drawn, and the linear
    result is used only if its interval agrees with theirs.

    Args:
        quantity, unit: name and unit of the result, for people.
        function: function of a mapping from input names to arrays (n,); it returns an array (n,).
        inputs: the uncertain inputs.
        correlations: correlation coefficients between inputs, by their names.
        seed: seed of the trials.
        sensitivities: derivatives by each input where they are known; else they are found by differences.
        method: "linear" or "Monte Carlo"; None: the better one.

    Raises:
        EstimateError: an input is not finite, the method is unknown, rectangular inputs are correlated, or the function
            is not finite at the estimates or somewhere in the distributions.
    """
    problem = _PropagationProblem(function, tuple(inputs), correlations or {})
    if method not in (None, LINEAR, MONTE_CARLO):
        raise EstimateError(f"no method {method!r} of propagation; valid: {LINEAR}, {MONTE_CARLO}")
    budget = _linear(problem, quantity, unit, sensitivities)
    if method == LINEAR:
        return _of_budget(budget, "asked for")
    if method == MONTE_CARLO:
        return _trials(problem, budget, seed, "asked for")
    curved = _curvature(problem, budget)
    blunt = _rectangular(problem, budget)
    if curved <= AGREEMENT and not blunt:
        return _of_budget(budget, f"within two standard uncertainties a straight line is off by {curved:.2g} u at most")
    because = (
        f"{blunt} is rectangular and holds most of the variance" if blunt else f"curved: a line is {curved:.2g} u off"
    )
    return _trials(problem, budget, seed, because)


def _of_budget(budget: Budget, why: str) -> Propagated:
    return Propagated(budget.value, budget.u, *budget.interval(), LINEAR, why, budget)


def _linear(problem: _PropagationProblem, quantity: str, unit: str, sensitivities: Sequence[float] | None) -> Budget:
    value = float(problem.at(problem.values)[0])
    slopes = _slopes(problem) if sensitivities is None else sensitivities
    components = tuple(
        Component(each.name, each.u, float(slope), each.degrees_of_freedom, each.kind)
        for each, slope in zip(problem.inputs, slopes, strict=True)
    )
    return Budget(quantity, value, unit, components, problem.correlations)


def _slopes(problem: _PropagationProblem) -> Floats:
    """Derivatives by each input, from differences over ± u and ± u/2 that are extrapolated.

    Where u is lost in the digits of the estimate, the difference spans a thousand steps of a float64. The step is the
    real distance of the rounded points. Differences over ± u alone (JCGM 100, 5.1.3) would leave an error of the square
    of u where inputs cancel.
    """
    values = problem.values
    steps = np.where(problem.u > 0, np.maximum(problem.u, COARSE * np.spacing(np.abs(values))), 0.0)[:, 0]
    slopes = []
    for step in (steps, steps / 2):
        points = np.concatenate([values + np.diag(step), values - np.diag(step)], axis=1)
        up, down = np.split(problem.at(points), 2)
        spans = points.diagonal() - points[:, len(step) :].diagonal()
        with np.errstate(invalid="ignore"):
            slopes.append(np.divide(up - down, spans, out=np.zeros(len(step)), where=spans > 0))
    found: Floats = (4 * slopes[1] - slopes[0]) / 3
    if not np.isfinite(found).all():
        lost = problem.inputs[int(np.flatnonzero(~np.isfinite(found))[0])]
        raise EstimateError(
            f"the function is not finite at {lost.name} = {lost.value:g} ± {lost.u:g}: that is too uncertain for an"
            " interval; measure it better, or give a bound"
        )
    return found


def _curvature(problem: _PropagationProblem, budget: Budget) -> float:
    """Greatest departure from a straight line, in standard uncertainties of the result.

    It is looked for within two standard uncertainties of each input and of pairs of inputs.
    """
    factor = problem.u * correlation_factor(problem.names, problem.correlations)
    axes = np.concatenate([factor, -factor], axis=1)
    corners = (axes[:, :, np.newaxis] + axes[:, np.newaxis, :]).reshape(len(factor), -1) / math.sqrt(2)
    away = SEEN * np.concatenate([axes, corners], axis=1)
    slopes = np.array([c.sensitivity for c in budget.components])
    found = problem.at(problem.values + away)
    departure = np.abs(found - budget.value - slopes @ away)
    if not np.isfinite(departure).all():
        return math.inf
    allowance = ROUND_OFF * np.finfo(float).eps * np.abs([*found, *(slopes * problem.values[:, 0])]).max()
    worst = max(float(departure.max(initial=0.0)) - float(allowance), 0.0)
    return 0.0 if worst == 0 else worst / budget.u if budget.u > 0 else math.inf


def _rectangular(problem: _PropagationProblem, budget: Budget) -> str:
    """Name of a rectangular input that holds most of the variance, or ""."""
    shares = {row["name"]: row["share"] for row in budget.rows()}
    return next((i.name for i in problem.inputs if i.shape == "rectangular" and shares[i.name] > MOSTLY), "")


def _trials(problem: _PropagationProblem, budget: Budget, seed: int, because: str) -> Propagated:
    found = np.sort(problem.at(_draw(problem, np.random.default_rng(seed))))
    lost = int(np.count_nonzero(~np.isfinite(found)))
    if lost:
        raise EstimateError(
            f"{budget.quantity} is not finite in {lost} of {TRIALS} trials: its inputs are too uncertain for an"
            " interval; measure them better, or give a bound"
        )
    ends = TRIALS * np.array([(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    sure = 3 * math.sqrt(ends[0] * (1 + COVERAGE) / 2)  # by this much chance may move an end of the trials' interval
    below, above = (found[np.clip(np.rint(ends + side * sure), 0, TRIALS - 1).astype(int)] for side in (-1, 1))
    linear = np.array(budget.interval())
    apart = float(np.maximum(np.maximum(below - linear, linear - above), 0.0).max())
    if because != "asked for" and apart <= AGREEMENT * budget.u:
        return _of_budget(budget, f"{because}; but {TRIALS} trials give the same interval (JCGM 101, 8)")
    low, high = found[np.rint(ends).astype(int)]
    heavy = min((i.degrees_of_freedom for i in problem.inputs if i.u > 0), default=math.inf) <= 2
    # Student's t of 2 degrees of freedom or fewer has no standard deviation; half the width of the middle 68.27 %
    # replaces it.
    middle = found[np.rint(TRIALS * np.array([0.158655, 0.5, 0.841345])).astype(int)]
    return Propagated(
        value=float(middle[1] if heavy else found.mean()),
        u=float((middle[2] - middle[0]) / 2 if heavy else found.std(ddof=1)),
        low=float(low),
        high=float(high),
        method=MONTE_CARLO,
        why=because,
        budget=budget,
    )


def _draw(problem: _PropagationProblem, generator: np.random.Generator) -> Floats:
    """Random values (inputs, TRIALS) of the inputs."""
    drawn = generator.standard_normal((len(problem.inputs), TRIALS))
    if problem.correlations:
        drawn = correlation_factor(problem.names, problem.correlations) @ drawn
    for group in groups(problem.names, problem.correlations):
        shapes = {problem.inputs[i].shape for i in group}
        fewest = min(problem.inputs[i].degrees_of_freedom for i in group)
        if "rectangular" in shapes:
            if len(group) > 1:
                names = ", ".join(problem.inputs[i].name for i in group)
                raise EstimateError(
                    f"{names} are correlated and rectangular, which defines no joint distribution; take normal ones"
                )
            drawn[group] = generator.uniform(-math.sqrt(3), math.sqrt(3), (1, TRIALS))
        elif fewest < MANY:
            drawn[group] *= np.sqrt(fewest / generator.chisquare(fewest, TRIALS))
    return problem.values + problem.u * drawn
