"""The round single sensor by finite elements: linear elasticity in cylindrical coordinates, hp elements.

    solve(parameters, refinement=3).force_ratio
    solve_to(parameters, tolerance=1e-4)            # solution and error estimate

Answers are read off curves over the modulus of the object, one for each mesh of a sensor: more moduli cost next to
nothing. A refinement adds a geometric layer at each corner and one to the degree: the error falls exponentially, by 6
to 10 times a refinement.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.models.axisymmetric.curves import curve_on
from palpate.instrument.models.finite_elements.error_estimate import Bounds, estimate
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import RoundParameters

# The last refinement takes a second and is good to 1e-7; finer meshes are for references.
REFINEMENTS = (1, 2, 3, 4, 5)
ROUND_OFF = 1e-10  # of the force ratio
FILMS = ("tooth", "base")


@dataclass(frozen=True, slots=True)
class Film:
    """An open film: its force [N], and its mean stresses [Pa] along radius and circumference together, and axis.

    Attributes:
        force: compressive force through the section below the film [N].
        plane_stress: (σ_rr + σ_φφ) / 2 averaged over the film's volume.
        normal_stress: σ_zz averaged over the film's volume.
        voltage: voltage of the upper electrode against the lower one [V].
        charge: charge that leaves the upper electrode when all films are short-circuited [C].
        voltage_error: bound on the voltage's error [V]; None: only one mesh was solved.
    """

    force: float
    plane_stress: float
    normal_stress: float
    voltage: float
    charge: float
    voltage_error: float | None = None


@dataclass(frozen=True, slots=True)
class Solution:
    """Answers for a force of 1 N that is spread evenly over the object.

    Attributes:
        force_ratio: tooth force over total force.
        films: films "tooth" and "base"; none on a rigid support.
    """

    force_ratio: float
    films: dict[str, Film]


def solve_to(parameters: RoundParameters, tolerance: float) -> tuple[Solution, float]:
    """Refine until the error estimate of the force ratio meets `tolerance`. Returns the solution and the estimate.

    Raises:
        RangeError: the tolerance is not positive and finite, or the finest mesh does not meet it.
        EstimateError: a stiffness is not positive definite to working precision.
    """
    if not (0 < tolerance < math.inf):
        raise RangeError(f"tolerance {tolerance:g} is not above 0 and finite; give a positive one")
    if tolerance < ROUND_OFF:
        raise RangeError(
            f"tolerance {tolerance:g}: model 'axisymmetric' rounds its ratio by up to {ROUND_OFF:g}; give a larger one"
        )
    best = math.inf
    for count in range(2, len(REFINEMENTS) + 1):
        curves = [curve(parameters, refinement) for refinement in REFINEMENTS[:count]]
        found = error_estimate(curves, parameters)
        if found.force_ratio <= tolerance:
            return _read(curves[-1], parameters, found.voltage), found.force_ratio
        best = min(best, found.force_ratio)
    raise RangeError(
        f"model 'axisymmetric' cannot meet tolerance {tolerance:g}: its least error here is {best:.1e}; give a larger"
        " tolerance"
    )


def error_estimate(curves: Sequence[Curve], parameters: RoundParameters) -> Bounds:
    """Bounds on the errors of the last of two or more meshes."""
    found = estimate(curves, parameters.sensed_modulus)
    return replace(found, force_ratio=found.force_ratio + ROUND_OFF)


def solve(parameters: RoundParameters, refinement: int) -> Solution:
    """Solve on the mesh of one refinement.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: a stiffness is not positive definite to working precision.
    """
    return _read(curve(parameters, refinement), parameters)


def curve(parameters: RoundParameters, refinement: int) -> Curve:
    """The sensor's curve on the mesh of one refinement; the modulus of the object has no effect.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: a stiffness is not positive definite to working precision.
    """
    return curve_on(parameters, *resolution_of(refinement))


def resolution_of(refinement: int) -> tuple[int, int]:
    """Degree and number of layers of a refinement.

    Raises:
        RangeError: there is no such refinement.
    """
    if refinement not in REFINEMENTS:
        raise RangeError(f"refinement {refinement} is outside {REFINEMENTS[0]} to {REFINEMENTS[-1]}; give one of these")
    return refinement + 2, refinement + 1


def _read(of: Curve, parameters: RoundParameters, voltage_error: float | None = None) -> Solution:
    """The answers at the modulus of the object."""
    modulus = np.array([parameters.sensed_modulus])
    ratio, voltages, charges, stresses = (
        found(modulus)[0, ..., 0].tolist() for found in (of.force_ratios, of.voltages, of.shorted, of.values)
    )
    each = zip((ratio, 1.0), stresses[::2], stresses[1::2], voltages, charges, strict=False)
    films = {name: Film(*film, voltage_error) for name, film in zip(FILMS, each, strict=False)}
    return Solution(ratio, films)
