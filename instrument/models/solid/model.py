"""Three-dimensional linear elasticity: square plates, one tooth or many, uniform pressure or a point load.

    solve(SolidParameters(sensed_modulus=100e3), refinement=2).force_ratio
    solve_to(SolidParameters(sensed_modulus=100e3), tolerance=1e-3)    # solution and error estimate

The sensor is a lattice of equal cells, one tooth in its ring in the middle of each; the sensed object covers all
of them. Contact holds in both directions (no lift-off). Symmetry planes of sensor and load are used.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements import ladder as between
from palpate.instrument.models.finite_elements.ladder import LEAST, Ladder
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.finite_elements.work import Cost, fits, is_kept, judge, keep, single, total
from palpate.instrument.models.parameters import SHARED_LENGTHS, SolidParameters
from palpate.instrument.models.solid import ladders
from palpate.instrument.models.solid.ladders import Resolution, SolidCurve
from palpate.instrument.notice import LONG, duration

if TYPE_CHECKING:
    from palpate.instrument.models.solid.system import System

ROUND_OFF = 1e-8  # of the force ratio of most sensors
# Object over the length of a cell: meshes of thinner ones may lose digits. In another unit of length a mesh is rounded
# otherwise. What its answers differ by, times this, bounds their rounding.
SHEET, UNIT, ROUNDING = 0.1, 1.37, 20.0
LARGER_TOLERANCE = "give a larger tolerance, or take another model"
SMALLER_QUESTION = "take another model or a design of fewer teeth, or spread the load evenly"
LENGTHS = (*SHARED_LENGTHS, "cell_length", "cell_width")

PlaneStress = tuple[float, float]


@dataclass(frozen=True, slots=True)
class SolidSolution:
    """Forces and stresses of teeth, bases and films. Forces [N] are positive in compression, stresses [Pa] in tension.

    Attributes:
        tooth_forces: force on each tooth, by row and then column.
        base_forces: force on the common base, or on each tooth's own base.
        tooth_films: mean stresses along x and y of the film below each tooth; none on a rigid support.
        base_films: mean stresses of the film of each base; none on a rigid support.
        voltage_error: bound on the error of each voltage [V]; None: only one mesh was solved.
        signals: voltage [V] and short-circuit charge [C] of each film, first of the teeth and then of the bases.
        total_force: force that reaches the floor [N].
        force_ratio: sum of the tooth forces over the total force.
        unknowns: number of displacements.
        seconds: processor time of the mesh, and of the elimination, for all moduli of the object together [s].
    """

    tooth_forces: tuple[float, ...]
    base_forces: tuple[float, ...]
    tooth_films: tuple[PlaneStress, ...]
    base_films: tuple[PlaneStress, ...]
    signals: tuple[tuple[float, float], ...]
    total_force: float
    force_ratio: float
    unknowns: int
    seconds: tuple[float, float]
    voltage_error: float | None = None


def solve(parameters: SolidParameters, refinement: int) -> SolidSolution:
    """Answer of the mesh of one refinement.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: the stiffness is singular to working precision.
    """
    return solve_on(parameters, ladders.resolution(parameters, refinement))


def solve_on(parameters: SolidParameters, resolution: Resolution) -> SolidSolution:
    """Answer of any mesh.

    Raises:
        EstimateError: the stiffness is singular to working precision.
    """
    (found,) = read(curve_on(parameters, resolution), parameters, np.array([parameters.sensed_modulus]))
    return found


def read(
    of: SolidCurve, parameters: SolidParameters, moduli: Floats, voltage_errors: Floats | None = None
) -> list[SolidSolution]:
    """The answers of a mesh at moduli of the object [Pa], under the parameters' force.

    Args:
        of: the mesh.
        parameters: the sensor.
        moduli: moduli of the object [Pa].
        voltage_errors: bounds on the errors of the voltages under 1 N [V], where they are known.
    """
    force = parameters.force
    with single():
        values = force * of.poles.values(moduli)[..., 0]
        voltages, charges = (
            force * answers(moduli)[..., 0] @ whole.T
            for whole, answers in (
                (of.films / of.films.sum(axis=1, keepdims=True), of.poles.voltages),
                (of.films, of.poles.shorted),
            )
        )
    teeth, bases, stresses = np.split(values, np.cumsum([of.teeth, of.bases]), axis=1)
    total = bases.sum(axis=1)
    errors = [None] * len(moduli) if voltage_errors is None else (force * voltage_errors).tolist()
    columns = (
        *(each.tolist() for each in (teeth, bases, stresses, voltages, charges, total, teeth.sum(axis=1) / total)),
        errors,
    )
    solutions = []
    for tooth, base, stress, volts, coulombs, whole, ratio, error in zip(*columns, strict=True):
        plane = list(zip(stress[: len(stress) // 2], stress[len(stress) // 2 :], strict=True))
        solutions.append(
            SolidSolution(
                tooth_forces=tuple(tooth),
                base_forces=tuple(base),
                tooth_films=tuple(plane[: of.teeth]),
                base_films=tuple(plane[of.teeth :]),
                signals=tuple(zip(volts, coulombs, strict=True)),
                total_force=whole,
                force_ratio=ratio,
                unknowns=of.unknowns,
                seconds=of.seconds,
                voltage_error=error,
            )
        )
    return solutions


def curve_on(parameters: SolidParameters, resolution: Resolution) -> SolidCurve:
    """Answers of a mesh over the modulus of the object, under the parameters' load of 1 N; kept in memory and on disk.

    Raises:
        EstimateError: the stiffness is singular to working precision.
    """
    return curve_of_one(_of_one(parameters), resolution)


def _of_one(parameters: SolidParameters) -> SolidParameters:
    """A sensor whose object has 1 Pa, under 1 N: of others curves know."""
    return replace(parameters, sensed_modulus=1.0, force=1.0)


@functools.lru_cache(maxsize=64)
def curve_of_one(parameters: SolidParameters, resolution: Resolution) -> SolidCurve:
    return keep(_text(parameters, resolution), SolidCurve, lambda: found_on(parameters, resolution))


def _text(parameters: SolidParameters, resolution: Resolution) -> str:
    """Name under which a curve is kept."""
    return f"solid;{resolution};{parameters.canonical()}"


def found_on(parameters: SolidParameters, resolution: Resolution) -> SolidCurve:
    """Compute what `curve_on` gives, without keeping it; the parameters have an object of 1 Pa and a force of 1 N."""
    system = _priced.pop((parameters, resolution), None) or _system(parameters, resolution)
    return system.curve([system.load(parameters.load_at)])


def _system(parameters: SolidParameters, resolution: Resolution) -> System:
    # What builds meshes takes a moment to import, and kept curves do not need it.
    from palpate.instrument.models.solid.system import System

    return System(parameters, resolution)


_priced: dict[tuple[SolidParameters, Resolution], System] = {}  # those whose cost is known and that are needed next


@functools.lru_cache(maxsize=64)
def judged(parameters: SolidParameters, meshes: int) -> None:
    """Judge, before anything is solved, what the first meshes of a sensor cost, with all that their estimate asks.

    If they take long, it is also said what the next one would need. Parameters are as in `found_on`.

    Raises:
        EstimateError: they do not fit into memory.
    """
    finer = len(ladders.refinements(parameters)) > meshes
    try:
        needed = _cost(_new(parameters, meshes), _priced)
        then = "; answers for all moduli are then kept"
        if finer and needed.seconds > LONG and fits(needed):
            further = _cost(set(_new(parameters, meshes + 1)) - set(_new(parameters, meshes)), {})
            more = f"takes {duration(further.seconds)} more" if fits(further) else "does not fit into memory"
            then += f"; a finer mesh, if these do not meet the tolerance, {more}"
        judge(needed, LARGER_TOLERANCE if meshes > LEAST else SMALLER_QUESTION, then)
    except EstimateError:
        _priced.clear()
        raise


def _new(parameters: SolidParameters, meshes: int) -> list[tuple[SolidParameters, Resolution]]:
    """Sensors and meshes that so many meshes and their estimate need, and of which no curve is kept."""
    own = ladders.meshes(parameters).resolutions[:meshes]
    asked = [(parameters, each) for each in own] + beside(parameters, meshes)
    if _may_lose_digits(parameters):
        asked.append((in_other_units(parameters), own[-1]))
    return [each for each in dict.fromkeys(asked) if not is_kept(_text(*each))]


def _cost(
    of: Iterable[tuple[SolidParameters, Resolution]], systems: dict[tuple[SolidParameters, Resolution], System]
) -> Cost:
    """The cost of some curves; what is set up for it is put into `systems`."""
    costs = []
    for each in of:
        systems[each] = _system(*each)
        costs.append(systems[each].cost())
    return total(costs)


def point_loads(
    parameters: SolidParameters, places: Sequence[tuple[float, float]], refinement: int
) -> NDArray[np.float64]:
    """Forces on the teeth under one point load after another, from one elimination.

    Args:
        parameters: the sensor.
        places: positions of the load, (x, y) from the corner of the object [m].
        refinement: number of the refinement, from 0.

    Returns:
        Forces (places, teeth) [N].

    Raises:
        RangeError: a place is off the object, or there is no such refinement.
        EstimateError: the stiffness is singular to working precision.
    """
    from palpate.instrument.models.solid.system import System, symmetry

    symmetries = [symmetry(replace(parameters, load_at=place)) for place in places]
    mirrored = (all(along for along, _ in symmetries), all(across for _, across in symmetries))
    resolution = ladders.resolution(parameters, refinement)
    system = System(replace(parameters, load_at=places[0]), resolution, mirrored)
    found = system.curve([system.load(place) for place in places])
    values = found.poles.values(np.array([parameters.sensed_modulus]))[0, : found.teeth]
    return parameters.force * values.T


def solve_to(parameters: SolidParameters, tolerance: float) -> tuple[SolidSolution, float]:
    """`Ladder.solve_at` the parameters' own modulus of the object, under their force."""
    (found,) = ladder(parameters).solve_at(np.array([parameters.sensed_modulus]), tolerance)
    return found


def ladder(parameters: SolidParameters) -> Ladder[SolidCurve, SolidSolution]:
    """The meshes of all refinements, with answers under the parameters' force; their modulus of the object has no
    effect.
    """
    return Ladder(
        "solid",
        refinements=ladders.refinements(parameters),
        judge=lambda count: judged(_of_one(parameters), count),
        mesh=lambda refinement: curve(parameters, refinement),
        poles=lambda mesh: mesh.poles,
        estimates=lambda curves, moduli: estimates(curves, parameters, moduli),
        read=lambda mesh, moduli, voltage_errors: read(mesh, parameters, moduli, voltage_errors),
        rounding=ROUND_OFF,
    )


def curve(parameters: SolidParameters, refinement: int) -> SolidCurve:
    """Answers of the mesh of one refinement; neither the modulus of the object nor the force has an effect.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: the stiffness is singular to working precision.
    """
    return curve_on(parameters, ladders.resolution(parameters, refinement))


def beside(parameters: SolidParameters, meshes: int) -> list[tuple[SolidParameters, Resolution]]:
    """Sensors and meshes that an estimate for the last of so many meshes asks besides these.

    Few teeth: the meshes `Meshes.sketch` and `Meshes.higher`; the second mesh has a higher degree along the height than
    the first, which tells enough of what that leaves. Many teeth: one cell of them, on the last two meshes, on those of
    few teeth, and on what these ask.
    """
    ladder = ladders.meshes(parameters)
    if not ladders.is_judged_by_cell(parameters):
        asked = [ladder.sketch, ladder.higher if meshes > 2 else None]
        return [(parameters, each) for each in asked if each is not None]
    cell = ladders.cell_of(parameters)
    own = ladders.meshes(cell).resolutions
    return [(cell, each) for each in (*ladder.resolutions[meshes - 2 : meshes], *own)] + beside(cell, len(own))


def estimates(
    curves: Sequence[Curve], parameters: SolidParameters, moduli: Floats, companions: Sequence[Curve] | None = None
) -> tuple[Floats, Floats]:
    """Bounds on the errors of force ratio and voltages under 1 N [V] of the last of some meshes, at each modulus.

    Args:
        curves: all refinements from the first on, two or more.
        parameters: the sensor; its modulus of the object has no effect.
        moduli: moduli of the object [Pa].
        companions: curves of what is asked `beside` these; None: they are found.
    """
    if companions is None:
        companions = [curve_on(*each).poles for each in beside(parameters, len(curves))]
    by_cell = ladders.is_judged_by_cell(parameters)
    before, higher = ([], []) if by_cell else (companions[:1], companions[1:])
    compared, heights = [*before, *curves], [curves[0], *higher]
    if parameters.load_at is not None:
        # Beneath a point load the energy has no end. What of it passes through the contact has one.
        compared = [replace(each, clamped=np.zeros_like(each.clamped)) for each in compared]
    ratio, voltage = between.estimates(compared, moduli, ladders.manner(parameters), heights)
    if by_cell:
        cell = ladders.cell_of(parameters)
        alike, of_cell = companions[:2], companions[2 : 2 + len(ladders.refinements(cell))]
        own, _ = estimates(of_cell, cell, moduli, companions[2 + len(of_cell) :])
        ratio = between.by_likeness(curves, alike, of_cell[-1], own, moduli, ladders.larger(parameters))
    rounded, rounded_voltage = _rounding(curves, parameters, moduli)
    return ratio + rounded, voltage + rounded_voltage


def in_other_units(parameters: SolidParameters) -> SolidParameters:
    """The same sensor in another unit of length."""
    place = None if parameters.load_at is None else (UNIT * parameters.load_at[0], UNIT * parameters.load_at[1])
    return replace(parameters, load_at=place, **{name: UNIT * getattr(parameters, name) for name in LENGTHS})


def _may_lose_digits(parameters: SolidParameters) -> bool:
    return parameters.sensed_thickness <= SHEET * min(parameters.cell_length, parameters.cell_width)


def _rounding(curves: Sequence[Curve], parameters: SolidParameters, moduli: Floats) -> tuple[Floats, Floats]:
    """Bounds on the rounding errors of the last of some meshes; as `estimates`."""
    if not _may_lose_digits(parameters):
        return np.full(len(moduli), ROUND_OFF), np.zeros(len(moduli))
    twin = curve(in_other_units(parameters), len(curves) - 1).poles
    # In a larger unit of length, films of 1 N have a smaller stress by its square, and are thicker by itself.
    ratio, voltage = between.differences(curves[-1], twin, moduli, UNIT)
    return ROUNDING * ratio + ROUND_OFF, ROUNDING * voltage
