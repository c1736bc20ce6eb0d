"""Moduli from force ratios, by a named model of a named sensor, as rows with two uncertainties.

The *scale* uncertainty is that on the curve of the model: statistics, films, and the model's own error where it is
known. The *absolute* one adds the validation error, by which the curve itself may be off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.curve import RatioCurve, chosen, corrected, ratio_curve
from palpate.instrument.models.price_list import model_error, stored
from palpate.instrument.models.response import AUTO, RatioQuestion
from palpate.instrument.models.validation import ValidationLine, validation_u
from palpate.instrument.uncertainty.budget import coverage_factor

if TYPE_CHECKING:
    from palpate.instrument.calibration.model_calibration import ModelCalibration


# --- Young modulus of the touched object from the force ratio, by any model of any design --------------
#
# curve = ratio_curve(get_design("single"), load, "axisymmetric")
#     modulus_of_ratio(curve, [0.31, 0.99], u=0.005).low
#
# The ends of the ratio's coverage interval are turned into moduli. A monotone map keeps quantiles, so the Monte Carlo
# method of JCGM 101 would find the same interval, plus its own noise. Near the ratios of very soft and very hard
# objects the ratio hardly depends on the modulus; there only a bound is given.


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

    modulus: Floats
    low: Floats
    high: Floats
    sensitivity: Floats
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


def modulus_within(curve: RatioCurve, given: Floats, lowest: Floats, highest: Floats) -> ModulusEstimate:
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


def _moduli_between(curve: RatioCurve, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Logarithms of the least and the greatest modulus whose ratio is between `low` and `high`.

    They are infinite where an end of the curve lies between: the curve tells nothing of moduli beyond its end.
    """
    first, last = np.full(low.shape, np.inf), np.full(low.shape, -np.inf)
    for nodes, ratios in curve.stretches:
        hit = (high >= ratios[0]) & (low <= ratios[-1])
        sides: list[tuple[Floats, Literal["left", "right"]]] = [(low, "left"), (high, "right")]
        for ends, side in sides[: 1 if low is high else 2]:  # on this part of the curve each ratio has one modulus
            modulus = _inverse(curve, nodes, ratios, np.clip(ends[hit], ratios[0], ratios[-1]), side)
            first[hit], last[hit] = np.minimum(first[hit], modulus), np.maximum(last[hit], modulus)
    soft, hard = (float(curve.line(end)) for end in (curve.turns[0], curve.turns[-1]))
    return (
        np.where((low <= soft) & (soft <= high) & (low < high), -np.inf, first),
        np.where((low <= hard) & (hard <= high) & (low < high), np.inf, last),
    )


def _inverse(
    curve: RatioCurve, nodes: Floats, ratios: Floats, wanted: Floats, side: Literal["left", "right"]
) -> Floats:
    """Logarithms of the moduli of some ratios, on a stretch of the curve where the ratio rises from node to node.

    Where the curve is level, `side` says which end of the level part is taken.
    """
    place = np.searchsorted(ratios, wanted, side=side) - 1
    start = np.clip(place, 0, len(nodes) - 2)
    return _root(lambda at, nu=0: curve.line(at, nu) - (0 if nu else wanted), nodes[start], nodes[start + 1])


def _root(of: Callable[..., Floats], below: Floats, above: Floats) -> Floats:
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


def check_ratios(ratio: ArrayLike, u: ArrayLike, coverage: float) -> tuple[Floats, Floats]:
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


# --- moduli as rows ------------------------------------------------------------------------------------


COVERAGE = 0.95
FAR = "beyond the references, whose constant may fade: the interval holds the model's own answer, too"


@dataclass(frozen=True, slots=True)
class ByReferences:
    """A calibration of a model by references, for some ratios.

    Attributes:
        calibration: the calibration.
        same_films: whether the references were measured with the films' calibration of these ratios, which cancels.
        shared_u: part of each ratio's standard uncertainty that cancels, or one for all.
    """

    calibration: ModelCalibration
    same_films: bool = False
    shared_u: float | Sequence[float] = 0.0


def estimate(
    question: RatioQuestion,
    ratios: Sequence[float],
    u: float | Sequence[float] | None,
    degrees_of_freedom: float | Sequence[float] = math.inf,
    references: ByReferences | None = None,
) -> list[dict[str, Any]]:
    """One row for each ratio: modulus (None: only a bound is known) and coverage intervals (None: no bound) [Pa].

    The interval on the model's scale holds the model's own error (`model_error`) where it is known; the absolute one
    holds the validation error as well. Where that is not known, `absolute_kind` is None.

    Args:
        question: sensor, load and model.
        ratios: force ratios.
        u: standard uncertainty of each ratio, or one for all; None: the scatter with which the design's ratios repeat.
        degrees_of_freedom: degrees of freedom of these uncertainties, for each or one for all.
        references: the model's calibration by references; None: the thesis tells the validation error.

    Raises:
        ConfigError: the calibration belongs to another sensor, model or thickness.
        RangeError: a ratio is not between 0 and 1, the uncertainty is negative or not finite, or the model does not
            answer for this sensor or to this tolerance.
        EstimateError: a linear system cannot be solved accurately.
    """
    sensor = question.sensor()
    uncertainty = sensor.ratio_scatter * np.array(ratios) if u is None else np.broadcast_to(u, len(ratios))
    check_ratios(ratios, uncertainty, COVERAGE)
    curve = ratio_curve(sensor, question.load(sensor.ring.material.modulus), question.model, question.tolerance)
    line = validation_of(question, curve.model, references)
    freedom = np.broadcast_to(degrees_of_freedom, len(ratios))
    shared = np.zeros(len(ratios)) if references is None else np.broadcast_to(references.shared_u, len(ratios))
    apart = np.sqrt(np.maximum(uncertainty**2 - shared**2, 0.0))
    given = _Given(question, line, ratios, uncertainty, apart, freedom)
    errors, bound, found, absolute = _read_off(given, corrected(curve, line.constant))
    beyond = np.zeros(len(ratios), dtype=np.bool_)
    if references is not None:
        beyond = ~references.calibration.reaches(found.modulus)
        _, _, own, own_absolute = _read_off(given, curve)
        found = found.widened(own, beyond)
        if absolute is not None and own_absolute is not None:
            absolute = absolute.widened(own_absolute, beyond)
    rectangle = bound / math.sqrt(3)  # a bound is a rectangle of that half width
    least, greatest = corrected(curve, line.constant).ratios

    def note(index: int) -> str:
        return "; ".join(text for text in (why(index), FAR if beyond[index] else "") if text)

    def why(index: int) -> str:
        if found.outside[index]:
            return f"the model's ratios are {least:.4g} to {greatest:.4g}"
        if found.ambiguous[index]:
            return "several moduli give this ratio"
        if found.sensitivity[index] > MOST_SENSITIVE:
            return f"1 % of the ratio is {found.sensitivity[index]:.0f} % of the modulus here"
        return "" if found.kind[index] == INTERVAL else "the ratio's interval reaches beyond the model's"

    def relative_u(index: int, of_ratio: Floats, validation: float | None) -> float | None:
        if validation is None or not math.isfinite(found.modulus[index]):
            return None
        on_scale = math.hypot(of_ratio[index], rectangle[index]) / ratios[index]
        return float(found.sensitivity[index] * math.hypot(on_scale, validation))

    return [
        {
            "force_ratio": ratio,
            "force_ratio_u": float(uncertainty[index]),
            "modulus_Pa": _finite(found.modulus[index]),
            "scale_u": relative_u(index, uncertainty, 0.0),
            **_ends("scale", found, index),
            "absolute_u": relative_u(index, apart, line.u),
            **_ends("absolute", absolute, index),
            "absolute_kind": None if absolute is None else str(absolute.kind[index]),
            "sensitivity": _finite(found.sensitivity[index]),
            "kind": str(found.kind[index]),
            "note": note(index),
            "model_error": errors[index],
            "curve_error": float(bound[index]),
            "model": curve.model,
        }
        for index, ratio in enumerate(ratios)
    ]


def answering(question: RatioQuestion) -> str:
    """Name of the model that answers a question. Raises RangeError: "auto" finds none."""
    if question.model != AUTO:
        return question.model
    sensor = question.sensor()
    return chosen(sensor, question.load(sensor.ring.material.modulus), question.tolerance).model


def validation_of(question: RatioQuestion, model: str, references: ByReferences | None = None) -> ValidationLine:
    """Validation error of the model that answers a question. Raises as `validation_u` and `check_question` do."""
    if references is not None:
        references.calibration.check_question(question, model)
        names = question.design, question.parameters, model
        return validation_u(*names, references.calibration, same_films=references.same_films)
    plain = RatioQuestion(question.design, question.model, question.parameters)
    modulus = plain.sensor().ring.material.modulus
    same = question.sensor() == plain.sensor() and question.load(modulus) == plain.load(modulus)
    return validation_u(question.design, question.parameters, model, changed=() if same else question.changed)


@dataclass(frozen=True, slots=True)
class _Given:
    """What is known of some ratios: their standard uncertainties, in all and without what references share."""

    question: RatioQuestion
    line: ValidationLine
    ratios: Sequence[float]
    u: Floats
    apart: Floats
    freedom: Floats


def _read_off(
    given: _Given, curve: RatioCurve
) -> tuple[list[float | None], Floats, ModulusEstimate, ModulusEstimate | None]:
    """Errors of the model, bounds on those of the curve, and the moduli on the scale and absolute."""
    errors, found = _priced(given.question, curve, given.ratios, given.u, given.freedom)
    # The curve that model "auto" answers with holds the model's error already.
    bound = np.array([curve.error + (0.0 if given.question.model == AUTO else error or 0.0) for error in errors])
    absolute = None
    if given.line.u is not None:
        absolute = _absolute(curve, given.line, np.array(given.ratios), given.apart, given.freedom, bound)
    return errors, bound, found, absolute


def _absolute(
    curve: RatioCurve, line: ValidationLine, ratios: Floats, u: Floats, freedom: Floats, bound: Floats
) -> ModulusEstimate:
    """Intervals that hold the validation error, too. It is a share of the ratio, so they are those of its logarithm."""
    validation = line.u or 0.0
    together = np.hypot(u / ratios, validation)
    # Welch and Satterthwaite.
    spent = (u / ratios) ** 4 / freedom + validation**4 / line.degrees_of_freedom
    with np.errstate(divide="ignore", invalid="ignore"):
        freedoms = np.where(spent > 0, together**4 / spent, math.inf)
    reach = np.exp(
        [coverage_factor(float(each), COVERAGE) * total for each, total in zip(freedoms, together, strict=True)]
    )
    return modulus_within(curve, ratios, ratios / reach - bound, ratios * reach + bound)


def _ends(name: str, found: ModulusEstimate | None, index: int) -> dict[str, float | None]:
    """Both ends of an interval under their names in JSON."""
    low, high = (math.nan, math.nan) if found is None else (found.low[index], found.high[index])
    return {f"{name}_low_Pa": _finite(low) or None, f"{name}_high_Pa": _finite(high)}


def _priced(
    question: RatioQuestion, curve: RatioCurve, ratios: Sequence[float], u: Floats, freedom: Floats
) -> tuple[list[float | None], ModulusEstimate]:
    """The model's error between the moduli of each interval, None where it is not priced; intervals that hold it."""
    sensor, (lowest, *_, highest) = question.sensor(), stored().moduli_Pa

    def priced(low: float, high: float) -> float | None:
        return model_error(sensor, question.load(lowest), curve.model, max(low, lowest), min(high, highest))

    found = modulus_of_ratio(curve, ratios, u, COVERAGE, degrees_of_freedom=freedom)
    ends = [(float(low), float(high)) for low, high in zip(found.low, found.high, strict=True)]
    priceable = [all(lowest <= end <= highest for end in pair if 0 < end < math.inf) for pair in ends]
    errors = [priced(*pair) if inside else None for pair, inside in zip(ends, priceable, strict=True)]
    if question.model == AUTO:
        return errors, found  # its curve has them
    while True:
        found = modulus_of_ratio(curve, ratios, u, COVERAGE, [error or 0.0 for error in errors], freedom)
        # A wider interval may reach moduli of a greater error, which make it wider still.
        wider = [
            None if error is None else max(error, priced(float(low), float(high)) or 0.0)
            for error, low, high in zip(errors, found.low, found.high, strict=True)
        ]
        if wider == errors:
            return errors, found
        errors = wider


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
