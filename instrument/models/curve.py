"""A model's force ratio over the modulus of the sensed object, as a curve that is evaluated in microseconds.

    curve = ratio_curve(get_design("single"), load, "axisymmetric")
    curve.force_ratio([24e3, 1e5])

A finite-element model has its curve in closed form, as a sum of poles. Of any other model the ratio is smooth in the
logarithm of the modulus; a spline of degree five there has the eleventh digit of a closed form from 241 nodes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.models import springs
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import round_parameters, solid_parameters
from palpate.instrument.models.response import AUTO, response
from palpate.instrument.models.table import MODELS
from palpate.instrument.quantity import check_tolerance
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Load, through

if TYPE_CHECKING:
    from palpate.instrument.models.price_list import ModelChoice


# Range of moduli over the ring's in which a curve is sampled. No model's ratio changes any more beyond it.
SOFTEST, HARDEST = 1e-3, 1e7
# Some models have narrower ranges.
ENDS = {"column_fitted": (springs.LOWEST, springs.HIGHEST)}
NODES = (16, 31, 61, 121, 241, 481, 961)  # each set of nodes contains the one before
CLOSED_FORM_TOLERANCE = 1e-11
# Halving small steps of a spline of degree five divides its error by 64; 42 was the least seen.
GAIN = 16.0
MODULI = 81  # at which the error of the curve of a mesh is estimated, 8 in a decade
# Of the curve of a mesh, whose poles are at least as wide as a decade.
NODES_PER_DECADE = 16
HALVINGS = 50  # of the distance between two nodes: down to the last digit


class ModulusFunction(Protocol):
    """A function of ln(modulus / Pa), such as scipy's PPoly.

    Attributes:
        x: ascending nodes from end to end, so close that the function is nearly straight between neighbours.
    """

    x: Floats

    def __call__(self, x: float | Floats, nu: Literal[0, 1] = 0) -> Floats:
        """The function, or its derivative for `nu=1`."""


class PoleLine:
    """The force ratio of a finite-element mesh over ln(modulus / Pa), between two moduli [Pa]."""

    def __init__(self, poles: Curve, lowest: float, highest: float) -> None:
        self._poles = poles
        low, high = math.log(lowest), math.log(highest)
        self.x = np.linspace(low, high, math.ceil(NODES_PER_DECADE * (high - low) / math.log(10)) + 1)

    def __call__(self, x: float | Floats, nu: Literal[0, 1] = 0) -> Floats:
        at = np.asarray(x, dtype=np.float64)
        moduli = np.exp(at.ravel())
        found = moduli * self._poles.slopes(moduli)[:, 0] if nu else self._poles.force_ratios(moduli)[:, 0]
        return found.reshape(at.shape)


@dataclass(frozen=True)
class RatioCurve:
    """A model's force ratio over the modulus of the object.

    Attributes:
        model: name of the model.
        line: ratio over ln(modulus / Pa).
        turns: logarithms of both ends and of the moduli at which the ratio changes its direction.
        error: bound on the error of the ratio, from the model's error estimate and interpolation.
    """

    model: str
    line: ModulusFunction
    turns: Floats
    error: float

    @property
    def moduli(self) -> tuple[float, float]:
        """Least and greatest modulus of the curve [Pa]."""
        return math.exp(self.turns[0]), math.exp(self.turns[-1])

    @cached_property
    def ratios(self) -> tuple[float, float]:
        """Least and greatest force ratio."""
        values = self.line(self.turns)
        return float(values.min()), float(values.max())

    @cached_property
    def stretches(self) -> list[tuple[Floats, Floats]]:
        """Parts between turns: logarithms of moduli, and the ratios there, which rise, each of shape (nodes,)."""
        found = []
        for start, end in pairwise(self.turns):
            nodes = self.line.x
            nodes = np.array([start, *nodes[(nodes > start) & (nodes < end)], end])
            ratios = self.line(nodes)
            found.append((nodes, ratios) if ratios[0] <= ratios[-1] else (nodes[::-1], ratios[::-1]))
        return found

    def force_ratio(self, moduli: ArrayLike) -> Floats:
        """Tooth force over total force, of the shape of `moduli` [Pa].

        Raises:
            RangeError: a modulus is outside the curve, or is no number.
        """
        given = np.asarray(moduli, dtype=np.float64)
        low, high = self.moduli
        bad = ~((given >= low * (1 - 1e-12)) & (given <= high * (1 + 1e-12)))
        if bad.any():
            raise RangeError(
                f"modulus {given[bad].flat[0]:g} Pa is outside {low:g} to {high:g} Pa of the curve of model"
                f" {self.model!r}; give one inside"
            )
        value: Floats = self.line(np.clip(np.log(given), self.turns[0], self.turns[-1]))
        return value


@functools.lru_cache(maxsize=16)
def ratio_curve(design: Design, load: Load, model: str, tolerance: float | None = None) -> RatioCurve:
    """The curve of a model for a design and a load; the modulus of the load's object has no effect.

    "auto" is the cheapest model that meets the tolerance at all moduli of the price list.

    Args:
        design: the sensor.
        load: the load; its object's modulus is replaced.
        model: name of the model.
        tolerance: greatest error of the force ratio, relative to it; None: the model's own.

    Raises:
        UnknownName: there is no such model.
        RangeError: the model does not answer for this design or load, or not to this tolerance.
        EstimateError: a linear system cannot be solved accurately, or the curve does not meet the tolerance.
    """
    ring = design.ring.material.modulus
    softest, hardest = ENDS.get(model, (SOFTEST, HARDEST))
    lowest, highest, own_error = softest * ring, hardest * ring, 0.0
    if tolerance is not None:
        check_tolerance(tolerance, f"tolerance {tolerance:g}")
    if model == AUTO:
        from palpate.instrument.models.price_list import AUTO_TOLERANCE, stored

        tolerance = AUTO_TOLERANCE if tolerance is None else tolerance
        priced = stored().moduli_Pa
        choice = chosen(design, load, tolerance)
        model = choice.model
        if choice.bound is not None:
            lowest, highest, own_error = priced[0], priced[-1], choice.bound
        if model in MODELS and MODELS[model].default_tolerance is None:
            tolerance = None

    exact = _exact(design, through(load, ring), model, tolerance, np.geomspace(lowest, highest, MODULI))
    if exact is not None:
        poles, error = exact
        return pole_curve(poles, lowest, highest, model, max(own_error, error))

    def answer(modulus: float) -> tuple[float, float]:
        found = response(design, through(load, modulus), model, tolerance)
        return found.force_ratio, max(own_error, found.force_ratio * (found.error_estimate or 0.0))

    if model == "experiment" and design.thesis_force_ratio:
        # The model's own six points, and its interpolant between them.
        moduli = sorted(SAMPLES[name].modulus for name in design.thesis_force_ratio)
        return curve_through(moduli, [answer(modulus)[0] for modulus in moduli], model)
    return sampled_curve(answer, lowest, highest, model, CLOSED_FORM_TOLERANCE)


def chosen(design: Design, load: Load, tolerance: float | None = None) -> ModelChoice:
    """The model that answers for "auto" at all moduli of the price list. Raises RangeError: none meets a tolerance."""
    from palpate.instrument.models.price_list import AUTO_TOLERANCE, choose, stored

    priced = stored().moduli_Pa
    ends = [through(load, priced[0]), through(load, priced[-1])]
    return choose(design, ends, AUTO_TOLERANCE if tolerance is None else tolerance)


def _exact(
    design: Design, load: Load, model: str, tolerance: float | None, moduli: Floats
) -> tuple[Curve, float] | None:
    """Poles of a finite-element model, and a bound on their error at moduli [Pa]; None: the model is in closed form."""
    if model == "surface" and tolerance is None:
        from palpate.instrument.models import surface

        found = surface.find(design, load)
        return found.poles, float(found.estimates(moduli)[0].max())
    if model not in MODELS or (own := MODELS[model].default_tolerance) is None:
        return None
    asked = own if tolerance is None else tolerance
    if model == "axisymmetric":
        from palpate.instrument.models.axisymmetric import model as axisymmetric

        return axisymmetric.ladder(round_parameters(design, load)).poles_to(moduli, asked)
    from palpate.instrument.models.solid import model as solid

    return solid.ladder(solid_parameters(design, replace(load, force=1.0))).poles_to(moduli, asked)


def curve_through(moduli: ArrayLike, ratios: ArrayLike, model: str, error: float = 0.0) -> RatioCurve:
    """The curve through given points, monotone between neighbours (PCHIP, Fritsch and Carlson 1980).

    Args:
        moduli: at least two, ascending [Pa].
        ratios: one for each modulus.
        model: name of the model.
        error: bound on the error of the ratios.

    Raises:
        RangeError: there are fewer than two points, or moduli are not positive, finite and ascending.
    """
    from scipy.interpolate import PchipInterpolator, PPoly

    given, values = np.asarray(moduli, dtype=np.float64), np.asarray(ratios, dtype=np.float64)
    if given.ndim != 1 or len(given) < 2 or not (given[0] > 0 and np.all(np.diff(given) > 0) and given[-1] < math.inf):
        raise RangeError(f"moduli {given.tolist()} Pa of a curve: give two or more, positive and ascending")
    pieces = PchipInterpolator(np.log(given), values)
    line = PPoly(pieces.c, pieces.x)
    return _curve(model, line, line.derivative().roots(extrapolate=False), error)


def sampled_curve(
    answer: Callable[[float], tuple[float, float]], lowest: float, highest: float, model: str, tolerance: float
) -> RatioCurve:
    """The curve of any function that gives a smooth force ratio. Nodes are doubled until the tolerance is met.

    Args:
        answer: function of the modulus [Pa] that gives the force ratio and a bound on its error.
        lowest, highest: moduli between which it is asked [Pa].
        model: name of the model.
        tolerance: tolerance of interpolation; a thousandth of the model's own error suffices, too.

    Raises:
        EstimateError: 961 nodes do not meet the tolerance.
    """
    from scipy.interpolate import PPoly, make_interp_spline

    low, high = math.log(lowest), math.log(highest)
    answers: dict[float, tuple[float, float]] = {}
    coarser = None
    for count in NODES:
        nodes = np.linspace(low, high, count)
        for share, node in zip(np.linspace(0, 1, count), nodes, strict=True):
            if share not in answers:
                answers[share] = answer(min(max(math.exp(node), lowest), highest))
        ratios, errors = np.array([answers[share] for share in np.linspace(0, 1, count)]).T
        spline = make_interp_spline(nodes, ratios, k=5)
        if coarser is not None:
            interpolation = float(np.abs(coarser(nodes) - ratios).max()) / GAIN
            if interpolation <= max(tolerance, 1e-3 * errors.max()):
                line = PPoly.from_spline(spline.tck)
                turns = line.derivative().roots(extrapolate=False)
                return _curve(model, line, turns, float(errors.max()) + interpolation)
        coarser = spline
    raise EstimateError(
        f"ratio curve of model {model!r}: error {interpolation:.1e} at {NODES[-1]} nodes is above {tolerance:g};"
        " give a larger tolerance"
    )


def pole_curve(poles: Curve, lowest: float, highest: float, model: str, error: float) -> RatioCurve:
    """The curve of a finite-element mesh between two moduli [Pa]; `error`: bound on the error of the ratio."""
    line = PoleLine(poles, lowest, highest)
    slopes = line(line.x, 1)
    turning = np.flatnonzero(slopes[:-1] * slopes[1:] < 0)
    low, high = line.x[turning], line.x[turning + 1]
    rising = slopes[turning] > 0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        before = (line(middle, 1) > 0) == rising
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return _curve(model, line, low, error)


def _curve(model: str, line: ModulusFunction, turns: Floats, error: float) -> RatioCurve:
    ends = line.x[0], line.x[-1]
    inside = np.unique(np.asarray(turns)[(turns > ends[0]) & (turns < ends[1])])
    return RatioCurve(model, line, np.array([ends[0], *inside, ends[1]]), error)


# --- a curve that references have corrected by a constant factor -----------------------------------------


class CorrectedLine:
    """A line whose ratios are multiplied by a factor."""

    def __init__(self, line: ModulusFunction, factor: float) -> None:
        self.x, self._line, self._factor = line.x, line, factor

    def __call__(self, x: float | Floats, nu: Literal[0, 1] = 0) -> Floats:
        found: Floats = self._factor * self._line(x, nu)
        return found


def corrected(curve: RatioCurve, constant: float) -> RatioCurve:
    """The curve for measured ratios.

    Args:
        curve: a model's own curve.
        constant: ln of the model's ratio over the measured one.
    """
    factor = math.exp(-constant)
    return replace(curve, line=CorrectedLine(curve.line, factor), error=factor * curve.error) if constant else curve
