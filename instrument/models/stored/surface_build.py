"""Building a response surface: the finite-element model is solved at Chebyshev nodes until the polynomial is good.

    build(surface_parameters(get_design("single"), load)).save(path)

The error bound is measured at points between the nodes, which the polynomial was not fitted to.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import RoundParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.stored.surface import (
    HIGHEST,
    LOWEST,
    Parameters,
    ResponseSurface,
    design_hash,
    interpolate,
    model_of,
    refinement_of,
)

Array = NDArray[np.float64]

# Greatest relative error of the polynomial: at most a hundredth of the error of the solid's mesh.
ERROR_LIMITS = {"axisymmetric": 1e-6, "solid": 1e-5}
NODES = (25, 49, 97)  # each set of nodes contains the one before
# Modulus ratios at which the mesh is compared with the next finer one. The difference is greatest where tooth and ring
# share the force.
PROBES = (4.0, 40.0)


def build(
    parameters: Parameters, refinement: int | None = None, apply: Callable[..., Iterable[float]] = map
) -> ResponseSurface:
    """Build the surface of a sensor over modulus ratios 0.1 to 1e7; `parameters.sensed_modulus` has no effect.

    Args:
        parameters: the sensor.
        refinement: refinement of the finite-element model; there must be a finer one. None: that of the stored
            surfaces.
        apply: `map`, or an executor's `map`, by which the model is solved at many moduli.

    Raises:
        EstimateError: 97 nodes do not reach a relative error of ERROR_LIMITS.
    """
    start = time.perf_counter()
    used = refinement_of(parameters) if refinement is None else refinement
    limit = ERROR_LIMITS[model_of(parameters)]
    known: dict[Fraction, float] = {}

    def at(angles: Sequence[Fraction]) -> Array:
        missing = [angle for angle in angles if angle not in known]
        found = apply(functools.partial(_solve, parameters, used), [_modulus_ratio(angle) for angle in missing])
        known.update(zip(missing, found, strict=True))
        return np.array([known[angle] for angle in angles])

    bound = math.inf
    for count in NODES:
        coefficients = interpolate(at(_angles(count)))
        # Every second point between the nodes is a node of the set with twice the count.
        between = [Fraction(2 * index + 1, 2 * (count - 1)) for index in range(0, count - 1, 2)]
        places = np.cos(math.pi * np.array(between, dtype=np.float64))
        error = np.abs(np.polynomial.chebyshev.chebval(places, coefficients) / at(between) - 1)
        # Twice the worst error that was seen bounds the errors in between.
        bound = 2 * float(error.max()) + 1e-12
        if bound < limit:
            break
    else:
        raise EstimateError(
            f"response surface: relative error {bound:.1e} at {NODES[-1]} nodes is above {limit:g};"
            f" ask model {model_of(parameters)!r} itself"
        )
    own, finer = (list(apply(functools.partial(_solve, parameters, used + k), PROBES)) for k in (0, 1))
    return ResponseSurface(
        coefficients=coefficients,
        lowest=LOWEST,
        highest=HIGHEST,
        error_bound=bound,
        # A refinement divides the error by three at least, so the change is two thirds of the error or more.
        discretisation=2 * float(np.abs(np.subtract(finer, own)).max()),
        seconds=time.perf_counter() - start,
        model=model_of(parameters),
        design_hash=design_hash(parameters, used),
    )


def _angles(count: int) -> list[Fraction]:
    """Angles over π of the Chebyshev extreme points. Every second one is an angle of half the count."""
    return [Fraction(index, count - 1) for index in range(count)]


def _modulus_ratio(angle: Fraction) -> float:
    low, high = math.log10(LOWEST), math.log10(HIGHEST)
    return float(10 ** (low + (high - low) * (math.cos(math.pi * angle) + 1) / 2))


def _solve(parameters: Parameters, refinement: int, modulus_ratio: float) -> float:
    """Force ratio by the finite-element model. A function of the module, so that another process can call it."""
    modulus = parameters.compliant_modulus * modulus_ratio
    if isinstance(parameters, RoundParameters):
        return axisymmetric.solve(replace(parameters, sensed_modulus=modulus), refinement).force_ratio
    return solid.solve(replace(parameters, sensed_modulus=modulus), refinement).force_ratio
