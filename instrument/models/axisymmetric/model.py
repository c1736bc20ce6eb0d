"""The round single sensor by finite elements: linear elasticity in cylindrical coordinates, hp elements.

    solve(parameters, refinement=3).force_ratio
    solve_to(parameters, tolerance=1e-4)            # solution and error estimate

Answers are read off curves over the modulus of the object, one for each mesh of a sensor: more moduli cost next to
nothing. A refinement adds a geometric layer at each corner and one to the degree: the error falls exponentially, by 6
to 10 times a refinement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements import ladder as between
from palpate.instrument.models.finite_elements.ladder import Ladder
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import CLOSED, SHARED_LENGTHS, RoundParameters

# The last refinement takes a second and is good to 1e-7; finer meshes are for references.
REFINEMENTS = (1, 2, 3, 4, 5)
ROUND_OFF = 1e-10  # of the force ratio of most sensors
# In another unit of length a mesh is rounded otherwise. What its answers differ by, times this, bounds their rounding.
UNIT, ROUNDING = 1.37, 20.0
# Special sensors: of a flat object, of nearly incompressible material, of a narrow gap.
FLAT, INCOMPRESSIBLE, NARROW = 8.0, 0.4995, 0.03
TALL = 100.0  # height over gap from which on rounding is looked for in any sensor
# A mesh before the first one, in degree and layers: what it is off by tells whether the first two agree by luck.
SKETCH = (2, 1)
# How errors fall from mesh to mesh: by 5 to 10 times, and beside a closed gap they only halve. The numbers are not
# derived: with these the bounds hold for random sensors (`python -m tests.benchmarks estimates`). Voltages were off by
# up to 5 times their change.
# Of the first two meshes of a sensor, and the one before them, changes tell less than of finer ones.
OPEN = between.Manner(product=0.15, factors=(0.76,), voltages=(8.0,), luck=0.05, far=0.3)
OF_TWO = between.Manner(product=0.25, factors=(0.3, 0.7), voltages=(8.0,), luck=0.05, far=0.3)
# Errors of a flat object may fall by 3 only: one was 1.2 times as large as `OPEN` has it.
OPEN_FLAT = replace(OPEN, factors=(1.0,))
BESIDE_CLOSED = between.Manner(product=1.0, factors=(6.0, 3.0), voltages=(24.0, 12.0), luck=0.1)
FILMS = ("tooth", "base")
LENGTHS = (*SHARED_LENGTHS, "sensed_radius", "plate_radius")


@dataclass(frozen=True, slots=True)
class FilmStresses:
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
    films: dict[str, FilmStresses]


def solve_to(parameters: RoundParameters, tolerance: float) -> tuple[Solution, float]:
    """`Ladder.solve_at` the parameters' own modulus of the object."""
    (found,) = ladder(parameters).solve_at(np.array([parameters.sensed_modulus]), tolerance)
    return found


def ladder(parameters: RoundParameters) -> Ladder[Curve, Solution]:
    """The meshes of all refinements; the parameters' modulus of the object has no effect."""
    return Ladder(
        "axisymmetric",
        refinements=REFINEMENTS,
        judge=lambda _count: None,  # even the finest takes a second
        mesh=lambda refinement: curve(parameters, refinement),
        poles=lambda mesh: mesh,
        estimates=lambda curves, moduli: estimates(curves, parameters, moduli),
        read=read,
        rounding=ROUND_OFF,
    )


def estimates(curves: Sequence[Curve], parameters: RoundParameters, moduli: Floats) -> tuple[Floats, Floats]:
    """Bounds on the errors of force ratio and voltages [V] of the last of some meshes, at each modulus.

    Args:
        curves: all refinements from the first on, two or more.
        parameters: the sensor; its modulus of the object has no effect.
        moduli: moduli of the object [Pa].
    """
    ratio, voltage = _between(curves, parameters, moduli)
    rounded, rounded_voltage = rounding(curves, parameters, moduli)
    return ratio + rounded, voltage + rounded_voltage


def rounding(curves: Sequence[Curve], parameters: RoundParameters, moduli: Floats) -> tuple[Floats, Floats]:
    """Bounds on the rounding errors of the last of some refinements from the first on; as `estimates`."""
    if not may_round(parameters):
        return np.full(len(moduli), ROUND_OFF), np.zeros(len(moduli))
    in_other_units = replace(parameters, **{name: UNIT * getattr(parameters, name) for name in LENGTHS})
    ratios, voltages = [], []
    # A mesh and its twin may agree by luck. Those before are rounded less, so that theirs counts as well.
    for number in range(max(0, len(curves) - 2), len(curves)):
        twin = curve(in_other_units, REFINEMENTS[number])
        # In a larger unit of length, films of 1 N have a smaller stress by its square, and are thicker by itself.
        ratio, voltage = between.differences(curves[number], twin, moduli, UNIT)
        ratios.append(ratio)
        voltages.append(voltage)
    return ROUNDING * np.max(ratios, axis=0) + ROUND_OFF, ROUNDING * np.max(voltages, axis=0)


def _between(curves: Sequence[Curve], parameters: RoundParameters, moduli: Floats) -> tuple[Floats, Floats]:
    """The bounds that meshes tell of each other."""
    if _gap(parameters) < CLOSED * parameters.tooth_radius:
        return between.estimates(curves, moduli, BESIDE_CLOSED)
    if len(curves) == 2:
        return between.estimates([_curve_on(parameters, SKETCH), *curves], moduli, OF_TWO)
    return between.estimates(curves, moduli, OPEN_FLAT if _is_flat(parameters) else OPEN)


def is_special(parameters: RoundParameters) -> bool:
    """Whether much may be rounded: of flat objects, nearly incompressible material and narrow gaps."""
    return (
        _is_flat(parameters)
        or max(parameters.sensed_poisson, parameters.compliant_poisson) > INCOMPRESSIBLE
        or _gap(parameters) < NARROW * parameters.tooth_radius
    )


def _is_flat(parameters: RoundParameters) -> bool:
    return parameters.sensed_radius > FLAT * parameters.sensed_thickness


def may_round(parameters: RoundParameters) -> bool:
    """Whether rounding may show in the answers: of special sensors, and beside a gap that is narrow for its height."""
    height = max(parameters.sensed_thickness, parameters.sensor_height)
    return is_special(parameters) or height > TALL * _gap(parameters)


def _gap(parameters: RoundParameters) -> float:
    return parameters.ring_inner_radius - parameters.tooth_radius


def solve(parameters: RoundParameters, refinement: int) -> Solution:
    """Solve on the mesh of one refinement.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: a stiffness is not positive definite to working precision.
    """
    (found,) = read(curve(parameters, refinement), np.array([parameters.sensed_modulus]))
    return found


def curve(parameters: RoundParameters, refinement: int) -> Curve:
    """The sensor's curve on the mesh of one refinement; the modulus of the object has no effect.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: a stiffness is not positive definite to working precision.
    """
    return _curve_on(parameters, resolution_of(refinement))


def _curve_on(parameters: RoundParameters, resolution: tuple[int, int]) -> Curve:
    # What builds meshes takes a moment to import, and kept curves do not need it.
    from palpate.instrument.models.axisymmetric.curves import curve_on

    return curve_on(parameters, *resolution)


def resolution_of(refinement: int) -> tuple[int, int]:
    """Degree and number of layers of a refinement.

    Raises:
        RangeError: there is no such refinement.
    """
    if refinement not in REFINEMENTS:
        raise RangeError(f"refinement {refinement} is outside {REFINEMENTS[0]} to {REFINEMENTS[-1]}; give one of these")
    return refinement + 2, refinement + 1


def read(of: Curve, moduli: Floats, voltage_errors: Floats | None = None) -> list[Solution]:
    """The answers at moduli of the object [Pa], with bounds on the errors of voltages [V] where they are known."""
    ratios, voltages, charges, stresses = (
        found(moduli)[..., 0].tolist() for found in (of.force_ratios, of.voltages, of.shorted, of.values)
    )
    errors = [None] * len(moduli) if voltage_errors is None else voltage_errors.tolist()
    solutions = []
    for ratio, volts, coulombs, pascals, error in zip(ratios, voltages, charges, stresses, errors, strict=True):
        each = zip((ratio, 1.0), pascals[::2], pascals[1::2], volts, coulombs, strict=False)
        films = [FilmStresses(*film, error) for film in each]
        solutions.append(Solution(ratio, dict(zip(FILMS, films, strict=False))))
    return solutions
