"""How hard the touched object is: its Young modulus from the force ratio, by any model of any design.

    curve = ratio_curve(get_design("single"), load, "axisymmetric")
    modulus_of_ratio(curve, [0.31, 0.99], u=0.005).low

The uncertainty goes through by the ends of its coverage interval. A monotone map carries quantiles over as they
are, so that the Monte Carlo method of JCGM 101 would find the same interval, plus its own noise. Where ratio and
modulus hardly hang together any more, next to the ratios of very soft and very hard objects, a bound is all there is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.models.stored.curve import RatioCurve
from palpate.instrument.uncertainty.budget import coverage_factor

Array = NDArray[np.float64]

INTERVAL, AT_LEAST, AT_MOST, ANY = "interval", "at least", "at most", "any"
# Relative error of the modulus over that of the ratio. The column model gets here at a ratio of 0.97: from there
# on, a model that is wrong by 1 % answers with moduli that are wrong by a third.
MOST_SENSITIVE = 30.0
NEAR = 0.1  # to the ratio at an end of the curve, over the ratio: elsewhere level ground has two sides


@dataclass(frozen=True, slots=True)
class ModulusEstimate:
    """Moduli of sensed objects [Pa], each array of the shape of the ratios.

    Attributes:
        modulus: nan where only a bound is known, or where several moduli give the ratio.
        low, high: coverage interval; 0 and inf where it has no bound. Where several moduli give a ratio, from the
            least to the greatest of them.
        sensitivity: relative error of the modulus over that of the ratio, d ln E / d ln R; nan where the ratio is
            outside the model's, or belongs to several moduli.
        kind: "interval", "at least" `low`, "at most" `high`, or "any" where every modulus agrees with the ratio.
        outside: the ratio is one that the model gives for no modulus.
        ambiguous: several moduli give the ratio.
    """

    modulus: Array
    low: Array
    high: Array
    sensitivity: Array
    kind: NDArray[np.str_]
    outside: NDArray[np.bool_]
    ambiguous: NDArray[np.bool_]


def modulus_of_ratio(
    curve: RatioCurve,
    ratio: ArrayLike,
    u: ArrayLike = 0.0,
    coverage: float = 0.95,
    error: ArrayLike = 0.0,
    degrees_of_freedom: ArrayLike = math.inf,
) -> ModulusEstimate:
    """Modulus of the sensed object for each force ratio.

    Where the sensitivity is above 30 next to an end of the curve, the answer is one-sided, and keeps the bound of the
    two-sided interval: it covers more than was asked for.

    Args:
        ratio: force ratios, any shape.
        u: standard uncertainty of each, or of all; the curve's own error is added to its interval.
        coverage: probability that the interval covers the modulus, if the ratio's error is normal.
        error: bound on what else may be wrong with the curve there, for each or for all; it is added as well.
        degrees_of_freedom: of the uncertainties, of each or of all; above 0.

    Raises:
        RangeError: a ratio is not between 0 and 1, an uncertainty is negative or not finite, their shapes do not
            go together, or the coverage is not between 0 and 1. There must be at least one ratio.
    """
    given, uncertainty = check_ratios(ratio, u, coverage)
    factors = [coverage_factor(float(each), coverage) for each in np.atleast_1d(np.asarray(degrees_of_freedom))]
    factor = np.reshape(factors, np.shape(degrees_of_freedom))
    spread = factor * uncertainty + curve.error + np.asarray(error, dtype=np.float64)
    least, greatest = curve.ratios
    left, right = _moduli_between(curve, given, given)
    outside = (given < least) | (given > greatest)
    ambiguous = right - left > 1e-9
    # A ratio outside has no modulus; the interval is that of the nearest one which has.
    low, high = _moduli_between(curve, np.minimum(given - spread, greatest), np.maximum(given + spread, least))
    misfit = ((given + spread < least) | (given - spread > greatest)) & np.isfinite(low) & np.isfinite(high)
    low, high = np.where(misfit, -np.inf, low), np.where(misfit, np.inf, high)

    with np.errstate(divide="ignore"):
        slope = curve.polynomial(np.where(np.isfinite(left), left, curve.turns[0]), 1)
        sensitivity = np.where(outside | ambiguous, np.nan, given / np.abs(slope))
    soft, hard = (np.abs(given - curve.polynomial(end)) for end in (curve.turns[0], curve.turns[-1]))
    # A model's rounding and meshes make its ends wavy.
    flat = (np.minimum(soft, hard) < NEAR * given) & (ambiguous | (sensitivity > MOST_SENSITIVE))
    low, high = np.where(flat & (soft < hard), -np.inf, low), np.where(flat & (soft >= hard), np.inf, high)
    kind = np.select(
        [np.isinf(low) & np.isinf(high), np.isinf(high), np.isinf(low)], [ANY, AT_LEAST, AT_MOST], INTERVAL
    )
    single = (kind == INTERVAL) & ~ambiguous & ~outside
    return ModulusEstimate(
        modulus=np.exp(np.where(single, left, np.nan)),
        low=np.exp(low),
        high=np.exp(high),
        sensitivity=sensitivity,
        kind=kind,
        outside=outside,
        ambiguous=ambiguous,
    )


def _moduli_between(curve: RatioCurve, low: Array, high: Array) -> tuple[Array, Array]:
    """ln of the least and the greatest modulus whose ratio is between `low` and `high`.

    They are infinite where an end of the curve is among them: what lies beyond was not asked for.
    """
    first, last = np.full(low.shape, np.inf), np.full(low.shape, -np.inf)
    for start, end in zip(curve.turns[:-1], curve.turns[1:], strict=True):
        nodes = curve.polynomial.x
        nodes = np.array([start, *nodes[(nodes > start) & (nodes < end)], end])
        ratios = curve.polynomial(nodes)
        if ratios[-1] < ratios[0]:
            nodes, ratios = nodes[::-1], ratios[::-1]
        hit = (high >= ratios[0]) & (low <= ratios[-1])
        sides: list[tuple[Array, Literal["left", "right"]]] = [(low, "left"), (high, "right")]
        for ends, side in sides[: 1 if low is high else 2]:  # a ratio alone has one modulus here
            modulus = _inverse(curve, nodes, ratios, np.clip(ends[hit], ratios[0], ratios[-1]), side)
            first[hit], last[hit] = np.minimum(first[hit], modulus), np.maximum(last[hit], modulus)
    soft, hard = (float(curve.polynomial(end)) for end in (curve.turns[0], curve.turns[-1]))
    return (
        np.where((low <= soft) & (soft <= high) & (low < high), -np.inf, first),
        np.where((low <= hard) & (hard <= high) & (low < high), np.inf, last),
    )


def _inverse(curve: RatioCurve, nodes: Array, ratios: Array, wanted: Array, side: Literal["left", "right"]) -> Array:
    """ln of the modulus on a stretch where the ratio rises from node to node; on level ground its left or right end."""
    from scipy.optimize import elementwise

    find_root: Callable[..., Any] = elementwise.find_root  # its stubs know no arguments
    place = np.searchsorted(ratios, wanted, side=side) - 1
    start = np.clip(place, 0, len(nodes) - 2)
    found = find_root(lambda at, ratio: curve.polynomial(at) - ratio, (nodes[start], nodes[start + 1]), args=(wanted,))
    if not found.success.all():
        raise EstimateError(f"ratio curve of model {curve.model!r}: ratio {wanted[~found.success][0]:g} has no modulus")
    root: Array = found.x
    return root


def check_ratios(ratio: ArrayLike, u: ArrayLike, coverage: float) -> tuple[Array, Array]:
    """Ratios and uncertainties of one shape, if `modulus_of_ratio` takes them: before a curve is solved for.

    Raises:
        RangeError: it does not.
    """
    given, uncertainty = np.asarray(ratio, dtype=np.float64), np.asarray(u, dtype=np.float64)
    if given.size == 0:
        raise RangeError("no force ratio is given; give at least one")
    bad = ~((given > 0) & (given < 1))
    if bad.any():
        raise RangeError(f"force ratio {given[bad].flat[0]:g} is not between 0 and 1; give a share of the force")
    wrong = ~((uncertainty >= 0) & (uncertainty < math.inf))
    if wrong.any():
        raise RangeError(f"uncertainty {uncertainty[wrong].flat[0]:g} is below 0 or not finite; give 0 or more")
    if not (0 < coverage < 1):
        raise RangeError(f"coverage {coverage:g} is not between 0 and 1; give a probability, such as 0.95")
    try:
        given, uncertainty = np.broadcast_arrays(given, uncertainty)
    except ValueError:
        raise RangeError(
            f"uncertainties of shape {uncertainty.shape} do not go with ratios of shape {given.shape};"
            " give one, or one for each ratio"
        ) from None
    return given, uncertainty
