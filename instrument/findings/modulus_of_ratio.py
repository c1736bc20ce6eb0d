"""Young modulus of the touched object from the force ratio, by any model of any design.

    curve = ratio_curve(get_design("single"), load, "axisymmetric")
    modulus_of_ratio(curve, [0.31, 0.99], u=0.005).low

The ends of the ratio's coverage interval are turned into moduli. A monotone map keeps quantiles, so the Monte Carlo
method of JCGM 101 would find the same interval, plus its own noise. Near the ratios of very soft and very hard objects
the ratio hardly depends on the modulus; there only a bound is given.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.uncertainty.budget import coverage_factor

Array = NDArray[np.float64]

INTERVAL, AT_LEAST, AT_MOST, ANY = "interval", "at least", "at most", "any"
# Greatest relative error of the modulus over that of the ratio. The column model reaches it at a ratio of 0.97: above
# that, an error of 1 % of the ratio is an error of a third of the modulus.
MOST_SENSITIVE = 30.0
STEPS = 200  # of a search; every third halves the interval, so that it ends before
SETTLED = 1e-10  # step of Newton's method after which no further one moves anything
NARROWEST = 1e-14  # interval that is not halved any more
NEAR = 0.1  # relative distance within which a ratio counts as that at an end of the curve


@dataclass(frozen=True, slots=True)
class ModulusEstimate:
    """Moduli of sensed objects [Pa], each array of the shape of the ratios.

    Attributes:
        modulus: nan where only a bound is known, or where several moduli give the ratio.
        low, high: coverage interval; 0 and inf where there is no bound. Where several moduli give the ratio, the
            interval holds all of them.
        sensitivity: relative error of the modulus over that of the ratio, d ln E / d ln R; nan where no modulus or
            several moduli give the ratio.
        kind: "interval", "at least" `low`, "at most" `high`, or "any" where every modulus agrees with the ratio.
        outside: whether the model gives this ratio for no modulus.
        ambiguous: whether several moduli give the ratio.
    """

    modulus: Array
    low: Array
    high: Array
    sensitivity: Array
    kind: NDArray[np.str_]
    outside: NDArray[np.bool_]
    ambiguous: NDArray[np.bool_]

    def widened(self, other: ModulusEstimate, where: NDArray[np.bool_]) -> ModulusEstimate:
        """The estimate with intervals that also hold those of another one, where `where` is true."""
        low = np.where(where, np.minimum(self.low, other.low), self.low)
        high = np.where(where, np.maximum(self.high, other.high), self.high)
        return replace(self, low=low, high=high, kind=_kind(low > 0, np.isfinite(high)))


def modulus_of_ratio(
    curve: RatioCurve,
    ratio: ArrayLike,
    u: ArrayLike = 0.0,
    coverage: float = 0.95,
    error: ArrayLike = 0.0,
    degrees_of_freedom: ArrayLike = math.inf,
) -> ModulusEstimate:
    """Modulus of the sensed object for each force ratio.

    Where the sensitivity is above 30 next to an end of the curve, the answer is a bound on one side. It is the bound of
    the two-sided interval, so it covers more than was asked for.

    Args:
        curve: force ratio over modulus, by a model.
        ratio: force ratios, any shape.
        u: standard uncertainty of each ratio, or one for all; the curve's own error is added to the interval.
        coverage: probability that the interval covers the modulus, if the ratio's error is normal.
        error: bound on any other error of the curve, for each ratio or one for all; it is added as well.
        degrees_of_freedom: degrees of freedom of the uncertainties, for each or one for all; above 0.

    Raises:
        RangeError: there is no ratio, a ratio is not between 0 and 1, an uncertainty is negative or not finite, shapes
            do not match, or the coverage is not between 0 and 1.
    """
    given, uncertainty = check_ratios(ratio, u, coverage)
    factors = [coverage_factor(float(each), coverage) for each in np.atleast_1d(np.asarray(degrees_of_freedom))]
    factor = np.reshape(factors, np.shape(degrees_of_freedom))
    spread = factor * uncertainty + curve.error + np.asarray(error, dtype=np.float64)
    return modulus_within(curve, given, given - spread, given + spread)


def modulus_within(curve: RatioCurve, given: Array, lowest: Array, highest: Array) -> ModulusEstimate:
    """Modulus of the sensed object for each force ratio, whose interval is known.

    Args:
        curve: force ratio over modulus, by a model.
        given: force ratios between 0 and 1.
        lowest, highest: ends of the interval of each ratio.
    """
    least, greatest = curve.ratios
    left, right = _moduli_between(curve, given, given)
    outside = (given < least) | (given > greatest)
    ambiguous = right - left > 1e-9
    # A ratio outside the curve has no modulus; its interval is that of the nearest ratio on the curve.
    low, high = _moduli_between(curve, np.minimum(lowest, greatest), np.maximum(highest, least))
    misfit = ((highest < least) | (lowest > greatest)) & np.isfinite(low) & np.isfinite(high)
    low, high = np.where(misfit, -np.inf, low), np.where(misfit, np.inf, high)

    with np.errstate(divide="ignore"):
        slope = curve.line(np.where(np.isfinite(left), left, curve.turns[0]), 1)
        sensitivity = np.where(outside | ambiguous, np.nan, given / np.abs(slope))
    soft, hard = (np.abs(given - curve.line(end)) for end in (curve.turns[0], curve.turns[-1]))
    # Rounding and meshes make the ends of a model's curve wavy.
    flat = (np.minimum(soft, hard) < NEAR * given) & (ambiguous | (sensitivity > MOST_SENSITIVE))
    low, high = np.where(flat & (soft < hard), -np.inf, low), np.where(flat & (soft >= hard), np.inf, high)
    kind = _kind(np.isfinite(low), np.isfinite(high))
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


def _kind(below: NDArray[np.bool_], above: NDArray[np.bool_]) -> NDArray[np.str_]:
    """What intervals say that are bounded below, or above."""
    return np.select([~below & ~above, ~above, ~below], [ANY, AT_LEAST, AT_MOST], INTERVAL)


def _moduli_between(curve: RatioCurve, low: Array, high: Array) -> tuple[Array, Array]:
    """Logarithms of the least and the greatest modulus whose ratio is between `low` and `high`.

    They are infinite where an end of the curve lies between: the curve tells nothing of moduli beyond its end.
    """
    first, last = np.full(low.shape, np.inf), np.full(low.shape, -np.inf)
    for nodes, ratios in curve.stretches:
        hit = (high >= ratios[0]) & (low <= ratios[-1])
        sides: list[tuple[Array, Literal["left", "right"]]] = [(low, "left"), (high, "right")]
        for ends, side in sides[: 1 if low is high else 2]:  # on this part of the curve each ratio has one modulus
            modulus = _inverse(curve, nodes, ratios, np.clip(ends[hit], ratios[0], ratios[-1]), side)
            first[hit], last[hit] = np.minimum(first[hit], modulus), np.maximum(last[hit], modulus)
    soft, hard = (float(curve.line(end)) for end in (curve.turns[0], curve.turns[-1]))
    return (
        np.where((low <= soft) & (soft <= high) & (low < high), -np.inf, first),
        np.where((low <= hard) & (hard <= high) & (low < high), np.inf, last),
    )


def _inverse(curve: RatioCurve, nodes: Array, ratios: Array, wanted: Array, side: Literal["left", "right"]) -> Array:
    """Logarithms of the moduli of some ratios, on a stretch of the curve where the ratio rises from node to node.

    Where the curve is level, `side` says which end of the level part is taken.
    """
    place = np.searchsorted(ratios, wanted, side=side) - 1
    start = np.clip(place, 0, len(nodes) - 2)
    return _root(lambda at, nu=0: curve.line(at, nu) - (0 if nu else wanted), nodes[start], nodes[start + 1])


def _root(of: Callable[..., Array], below: Array, above: Array) -> Array:
    """Roots by Newton's method from the chord, or by halving where it leaves the interval or hardly moves its ends.

    Args:
        of: function, with its derivative by `nu=1`, of which the roots are sought.
        below, above: ends of each interval, where the function is not above 0 and not below.
    """
    least, greatest = of(below), of(above)
    with np.errstate(divide="ignore", invalid="ignore"):
        chord = below - (above - below) * least / (greatest - least)
    at = np.where(least == 0, below, np.where(greatest == 0, above, chord))
    for step in range(STEPS):
        value, slope = of(at), of(at, nu=1)
        below, above = np.where(value <= 0, at, below), np.where(value >= 0, at, above)
        with np.errstate(divide="ignore", invalid="ignore"):
            after = at - value / slope
        found = (value == 0) | (np.abs(after - at) <= SETTLED) | (np.abs(above - below) <= NARROWEST)
        inside = (after - below) * (after - above) <= 0
        at = np.where(inside & (found | (step % 3 < 2)), after, np.where(found, at, (below + above) / 2))
        if found.all():
            break
    return at


def check_ratios(ratio: ArrayLike, u: ArrayLike, coverage: float) -> tuple[Array, Array]:
    """Check ratios and uncertainties before a curve is computed, and return them as arrays of one shape.

    Raises:
        RangeError: `modulus_of_ratio` would refuse them.
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
