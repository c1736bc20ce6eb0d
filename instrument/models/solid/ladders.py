"""Meshes of the solid model's sensors, from coarse to fine, and how errors fall from each to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.models.finite_elements.ladder import Manner
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import CLOSED, SolidParameters
from palpate.instrument.sensor.design import MANY_TEETH


@dataclass(frozen=True, slots=True)
class Resolution:
    """Fineness of a mesh.

    Attributes:
        layers: steps that shrink towards each singular edge.
        ratio: size of one step over the next.
        sectors: number of quadrilaterals along an eighth of the circle.
        degree: degree of the shape functions in the plan.
        rubber: their degree along the height of object and rings; None: as in the plan.
        stiff: the same for plates, films and teeth.
    """

    layers: int
    ratio: float
    sectors: int
    degree: int
    rubber: int | None = None
    stiff: int | None = None


@dataclass(frozen=True, slots=True)
class SolidCurve:
    """Answers of one mesh of the solid model, over the modulus of the object.

    Attributes:
        poles: its goals are those of `Goals`.
        films: as in `Goals`, for charges of the whole sensor.
        teeth, bases: number of teeth and of bases.
        unknowns: number of displacements.
        seconds: processor time of the mesh, and of the elimination [s].
    """

    poles: Curve
    films: Floats
    teeth: int
    bases: int
    unknowns: int
    seconds: tuple[float, float]


# --- meshes from coarse to fine --------------------------------------------------------------------------

NARROW, THIN = 0.05, 0.1  # gap and object over the tooth's radius
# Object over the length of a cell, if it keeps its volume and beneath a load in one point; Poisson ratio.
SQUEEZED, POINTED, INCOMPRESSIBLE = 0.5, 0.25, 0.45
# Many teeth err at least so many times as one cell of them; where meshes are hard, too.
LARGER, LARGER_IN_HARD = 1.5, 3.0
IN_NARROW = 4.0  # what is left there is more than what changes: it counts so many times


@dataclass(frozen=True, slots=True)
class Meshes:
    """Meshes of some sensors, and how errors fall from each to the next.

    Attributes:
        resolutions: resolutions by refinement.
        manner: how errors fall, from the sketch on if there is one.
        hard: the same where coarse meshes see too little.
        sketch: a mesh before the first, by which two that agree by luck are told; None: there is none.
        higher: the first mesh with a higher degree along the height than any has; None: all have different ones.
    """

    resolutions: tuple[Resolution, ...]
    manner: Manner
    hard: Manner
    sketch: Resolution | None = None
    higher: Resolution | None = None


# Each mesh has more layers and a higher degree than the one before. Most of their error is along the height of rubber,
# so the degree is higher there on the first two. Other parts of the third do with a lower one.
OF_FEW_TEETH = Meshes(
    resolutions=(
        Resolution(layers=2, ratio=0.15, sectors=1, degree=2, rubber=3),
        Resolution(layers=3, ratio=0.15, sectors=1, degree=3, rubber=4),
        Resolution(layers=4, ratio=0.15, sectors=1, degree=4, stiff=3),
    ),
    manner=Manner(0.05, factors=(1.2, 0.95, 0.9), voltages=(16, 20, 6), luck=0.05, height=0.4, far=0.3, distant=0.003),
    hard=Manner(0.05, factors=(0.2, 4.5, 3.0), voltages=(5, 16, 12), luck=0.3, height=0.6, far=0.3, distant=0.003),
    sketch=Resolution(layers=1, ratio=0.15, sectors=1, degree=2),
    # The third mesh has the degrees of the second along the height. Where these leave most, both err alike.
    higher=Resolution(layers=2, ratio=0.15, sectors=1, degree=2, rubber=5, stiff=4),
)
# A higher degree, more layers, then both. Along the circle a higher degree costs less than more sectors. The third mesh
# has more layers alone, which are no use where the degree leaves most: then a share of the bound before counts.
_MANY = Manner(product=0.15, factors=(2.0, 1.0, 0.5), voltages=(12.0, 8.0, 4.0), luck=0.12, far=1.0)
OF_MANY_TEETH = Meshes(
    resolutions=(
        Resolution(layers=2, ratio=0.2, sectors=1, degree=2),
        Resolution(layers=2, ratio=0.2, sectors=1, degree=3),
        Resolution(layers=3, ratio=0.2, sectors=1, degree=3),
        Resolution(layers=4, ratio=0.2, sectors=1, degree=4),
    ),
    manner=_MANY,
    hard=_MANY.widened(IN_NARROW),
)


def has_many_teeth(parameters: SolidParameters) -> bool:
    """Whether meshes are those of many teeth."""
    return parameters.columns * parameters.rows > MANY_TEETH


def is_judged_by_cell(parameters: SolidParameters) -> bool:
    """Whether errors are known from those of one cell: those of many teeth that share an even load."""
    return has_many_teeth(parameters) and parameters.load_at is None


def cell_of(parameters: SolidParameters) -> SolidParameters:
    """One cell of a sensor, as a sensor of its own."""
    return replace(parameters, rows=1, columns=1)


def larger(parameters: SolidParameters) -> float:
    """By how much errors of many teeth are taken for larger than those of one cell, at least."""
    return LARGER_IN_HARD if is_hard(parameters) else LARGER


def meshes(parameters: SolidParameters) -> Meshes:
    """The meshes of a sensor."""
    return OF_MANY_TEETH if has_many_teeth(parameters) else OF_FEW_TEETH


def manner(parameters: SolidParameters) -> Manner:
    """How errors of a sensor fall from mesh to mesh."""
    ladder = meshes(parameters)
    return ladder.hard if is_hard(parameters) else ladder.manner


def is_hard(parameters: SolidParameters) -> bool:
    """Whether meshes hardly differ in what they see too little of: how force passes across a narrow gap, or how a thin
    object bends.

    With few teeth, meshes are fine enough for gaps that are open. A flat object that keeps its volume is squeezed out
    sideways, and what a load in one point does to a flat object depends on where it stands in an element: the first two
    meshes see too little of both.
    """
    gap, radius = parameters.ring_inner_radius - parameters.tooth_radius, parameters.tooth_radius
    if has_many_teeth(parameters):
        return parameters.sensed_thickness < THIN * radius or gap < NARROW * radius
    thickness = parameters.sensed_thickness / min(parameters.cell_length, parameters.cell_width)
    squeezed = thickness < SQUEEZED and parameters.sensed_poisson > INCOMPRESSIBLE
    pointed = thickness < POINTED and parameters.load_at is not None
    return gap < CLOSED * radius or squeezed or pointed


def refinements(parameters: SolidParameters) -> tuple[int, ...]:
    """Numbers of a sensor's meshes."""
    return tuple(range(len(meshes(parameters).resolutions)))


def resolution(parameters: SolidParameters, refinement: int) -> Resolution:
    """Resolution of a sensor's mesh of a refinement.

    Raises:
        RangeError: there is no such refinement.
    """
    levels = refinements(parameters)
    if refinement not in levels:
        raise RangeError(f"refinement {refinement} is outside {levels[0]} to {levels[-1]}; give one of these")
    return meshes(parameters).resolutions[refinement]
