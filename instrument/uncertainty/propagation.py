"""Uncertainty of a function of uncertain inputs: by a linear budget where that holds, else by Monte Carlo.

    found = propagate("force", "N", lambda v, s: v / s, (Input("voltage", 0.2, 1e-3), Input("sensitivity", 0.07, 2e-3)),
                      seed=1)
    found.u, found.low, found.high, found.method, found.why

The linear budget follows the GUM (JCGM 100). Monte Carlo follows JCGM 101, with a fixed number of trials; clause 8
there decides whether the linear interval agrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import (
    COVERAGE,
    Budget,
    Component,
    Correlations,
    Kind,
    correlation_factor,
    groups,
)

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
