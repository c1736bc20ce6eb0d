"""The round single sensor by finite elements: linear elasticity in cylindrical coordinates, hp elements.

    solve(parameters, refinement=3).force_ratio
    solve_to(parameters, tolerance=1e-4)            # solution and error estimate

A refinement adds a geometric layer at each corner and one to the degree: the error falls exponentially,
by 6 to 10 times a refinement.
"""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from instrument.errors import RangeError
from instrument.models import elements as el
from instrument.models.axisymmetric_fields import FacePressure, Field, OnMesh, displacements, face, on
from instrument.models.condensed import Elements
from instrument.models.mesh import Body, grid
from instrument.models.numbering import AXIAL, RADIAL, Numbering, Part, number, parts, within
from instrument.models.parameters import RoundParameters
from instrument.models.refinement import solve as solve_elements
from instrument.models.threads import Each, one_each

Array = NDArray[np.float64]

# The last takes a second and is good to 1e-7; finer meshes are for references.
REFINEMENTS = (1, 2, 3, 4, 5)
# From these Poisson ratios on, a body keeps its pressure as an unknown: any, and one that is softer than the films.
MIXED_POISSON, SOFT_MIXED_POISSON = 0.4, 0.2
# Of the change before, the least that the last is taken for: it can be luck.
LUCK = 0.15
# Greatest λ/G in the factorised matrix; refinement steps carry the answer to the true one.
BULK_BOUND = 1e5
# Error that the second refinement may have though the first agrees, by chance: of 250 sensors one had 4e-6.
CHANCE = 1e-5
# Rounding of the force ratio: up to 1.3e-12, for a foil of 10 µm and 140 GPa.
ROUND_OFF = 1e-11


@dataclass(frozen=True, slots=True)
class Film:
    """A film's force [N] and its mean stresses [Pa] along radius and circumference together, and axis.

    Attributes:
        force: compression through the section below the film.
        plane_stress: (σ_rr + σ_φφ) / 2 averaged over the film's volume.
        normal_stress: σ_zz averaged over the film's volume.
    """

    force: float
    plane_stress: float
    normal_stress: float


# Without slots: it keeps its fields.
@dataclass(frozen=True)
class AxisymmetricSolution:
    """What the sensor does under 1 N, spread evenly over the object. Compression counts positive in forces.

    Attributes:
        force_ratio: tooth force over total force, from the section of the softer neighbour.
        tooth_force_above: force from the object on the tooth [N].
        tooth_force_below: force through the tooth's film [N]; on a rigid support that on the tooth.
        ring_force: force below the ring [N].
        base_force: force through the base [N].
        films: "tooth" and "base"; none on a rigid support.
        unknowns: displacements and pressures.
        residual: of the linear system, relative to the size of its terms.
        seconds: of the processor, to build the element matrices, to solve, and to evaluate the forces.
        on_mesh: what `fields` and `face` are worked out from.
    """

    force_ratio: float
    tooth_force_above: float
    tooth_force_below: float
    ring_force: float
    base_force: float
    films: dict[str, Film]
    unknowns: int
    residual: float
    seconds: tuple[float, float, float]
    on_mesh: OnMesh

    @functools.cached_property
    def fields(self) -> dict[str, Field]:
        """Body name -> displacements."""
        return displacements(self.on_mesh)

    @functools.cached_property
    def face(self) -> FacePressure:
        """Pressure of the object on tooth and ring."""
        return face(self.on_mesh)

    @property
    def imbalance(self) -> float:
        """Greatest difference of the sections' forces from one another, over the total force."""
        return max(
            abs(self.tooth_force_above - self.tooth_force_below),
            abs(self.tooth_force_below + self.ring_force - 1),
            abs(self.base_force - 1),
        )


# A sample is mounted again and again, and a sweep asks for the same sensor at every load.
@functools.lru_cache(maxsize=64)
def solve_to(parameters: RoundParameters, tolerance: float) -> tuple[AxisymmetricSolution, float]:
    """Refine until a bound on the error of the force ratio meets `tolerance`: the solution, and the bound.

    Raises:
        RangeError: the tolerance is not positive and finite, or the finest mesh does not meet it.
        EstimateError: a linear system cannot be solved accurately.
    """
    if not (0 < tolerance < math.inf):
        raise RangeError(f"tolerance {tolerance:g} is not above 0 and finite; give a positive one")
    ratios = [solve(parameters, REFINEMENTS[0]).force_ratio]
    best = math.inf
    for refinement in REFINEMENTS[1:]:
        solution = solve(parameters, refinement)
        ratios.append(solution.force_ratio)
        estimate = error_estimate(ratios, solution.imbalance)
        if estimate <= tolerance:
            return solution, estimate
        best = min(best, estimate)
    raise RangeError(
        f"model 'axisymmetric' cannot answer to {tolerance:g}: its best here is {best:.1e}; give a larger tolerance"
    )


def error_estimate(ratios: Sequence[float], imbalance: float) -> float:
    """Bound on the error of the last of at least two force ratios of rising refinement.

    The bound is the change by the last refinement, or a share of the one before where that is larger: one
    small change can be luck, so that the first counts four times, and CHANCE at least. What the forces lack in
    balance is added.
    """
    *before, change = (abs(finer - coarser) for coarser, finer in pairwise(ratios[-3:]))
    bound = max(change, LUCK * before[0]) if before else max(4 * change, CHANCE)
    return bound + imbalance + ROUND_OFF


def solve(parameters: RoundParameters, refinement: int) -> AxisymmetricSolution:
    """Solve with degree `refinement` + 2 and `refinement` + 1 layers.

    Raises:
        RangeError: no such refinement.
        EstimateError: the linear system cannot be solved accurately.
    """
    if refinement not in REFINEMENTS:
        raise RangeError(f"refinement {refinement} is outside {REFINEMENTS[0]} to {REFINEMENTS[-1]}; give one of these")
    return solve_on(parameters, degree=refinement + 2, layers=refinement + 1)


def solve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> AxisymmetricSolution:
    """Solve with elements of that degree, at least 3, and that many geometric layers at the corners.

    Args:
        mixed: bodies keep their pressure as an unknown where that gains digits; else none does.

    Raises:
        EstimateError: the linear system cannot be solved accurately.
    """
    start = time.process_time()
    mesh = grid(parameters, layers)
    r, z = el.line(mesh.radii, degree, radial=True), el.line(mesh.heights, degree, radial=False)
    bodies = parts(mesh)
    numbering = number(parameters, mesh, r, z, bodies)
    with one_each(numbering.subdomains) as each:
        keeping = [part for part in bodies if mixed and _keeps_pressure(part.body, parameters)]
        elements = assemble(numbering, r, z, bodies, keeping, each)
        built = time.process_time()
        load = np.zeros_like(elements.unknowns, dtype=np.float64)
        top = on(load, bodies[0])[:, -1, AXIAL]
        # The first shape function is 1: these are ∫ r φ.
        top[:, :, :2] -= r.value_value[bodies[0].columns][:, :, :1] / (math.pi * parameters.sensed_radius**2)
        solved = solve_elements(elements, elements.gather(load), each)
    done = time.process_time()
    found = OnMesh(
        parameters, mesh, r, {p.body.name: p for p in bodies}, solved.displacement[elements.unknowns], solved.internal
    )
    return _evaluate(found, elements, solved.residual, (start, built, done))


def assemble(
    numbering: Numbering, r: el.Line, z: el.Line, bodies: list[Part], keeping: list[Part], each: Each
) -> Elements:
    """Element matrices of all bodies, per radian.

    Args:
        keeping: those that keep their pressure.
        each: works on all subdomains at once.
    """
    stiffness, fill = np.empty((len(numbering.unknowns), *2 * numbering.unknowns.shape[1:])), el.Stiffness(r, z)
    mixed: list[int] = []
    pairs = r.dilatation.shape[1] ** 2
    dilatation = [np.zeros((0, pairs, numbering.unknowns.shape[1]))]
    compliance: list[float] = []
    bound: list[float] = []

    kept = [part.body for part in keeping]

    def filled(share: list[Part]) -> None:
        for part in share:
            nu, shear = part.body.poisson, part.body.shear
            lame = 0.0 if part.body in kept else 2 * shear * nu / (1 - 2 * nu)
            fill(part.columns, part.rows, shear, lame, out=stiffness[part.elements])

    by_size, count = sorted(bodies, key=len, reverse=True), numbering.subdomains
    each(filled, [by_size[share::count] for share in range(count)])
    for part in keeping:
        nu, shear = part.body.poisson, part.body.shear
        dilatation.append(el.dilatation(r, z, part.columns, part.rows))
        mixed += range(part.elements.start, part.elements.stop)
        compliance += [(1 - 2 * nu) / (2 * shear * nu)] * len(part)
        bound += [1 / (BULK_BOUND * shear)] * len(part)
    return Elements(
        stiffness=stiffness,
        unknowns=numbering.unknowns,
        inner=numbering.inner,
        size=numbering.size,
        shared=numbering.shared,
        subdomain=numbering.subdomain,
        subdomains=numbering.subdomains,
        seam=numbering.seam,
        mixed=np.array(mixed, dtype=np.intp),
        dilatation=np.concatenate(dilatation),
        compliance=np.array(compliance),
        bound=np.array(bound),
    )


def _keeps_pressure(body: Body, parameters: RoundParameters) -> bool:
    """Nearly incompressible ones lock without; soft ones, pressed by hard ones, err several times less with it."""
    soft = body.modulus < parameters.film_modulus
    return body.poisson >= (SOFT_MIXED_POISSON if soft else MIXED_POISSON)


def _evaluate(
    at: OnMesh, elements: Elements, residual: float, marks: tuple[float, float, float]
) -> AxisymmetricSolution:
    start, built, done = marks
    parameters = at.parameters

    def below(name: str) -> Array:
        """Forces on the vertices below a body: (columns, 2)."""
        return at.forces(name)[:, 0, AXIAL, :2, 0]

    vertices = at.r.dofs[at.parts["object"].columns][:, :2]
    above = float(below("object")[within(parameters.tooth_radius, at.mesh, at.r)[vertices]].sum())
    ring = float(below("ring").sum())
    films: dict[str, Film] = {}
    if parameters.support == "elastic":
        for name in ("tooth", "base"):
            films[name] = _film(at, f"{name} film", float(below(f"{name} film").sum()))
        tooth, base = films["tooth"].force, films["base"].force
    else:
        tooth, base = above, above + ring
    # The difference of large displacements costs the stiffer section more digits.
    soft = parameters.sensed_modulus < parameters.film_modulus
    return AxisymmetricSolution(
        force_ratio=above if soft else tooth,
        tooth_force_above=above,
        tooth_force_below=tooth,
        ring_force=ring,
        base_force=base,
        films=films,
        unknowns=elements.size + elements.dilatation.shape[0] * elements.dilatation.shape[1],
        residual=residual,
        seconds=(built - start, done - built, time.process_time() - done),
        on_mesh=at,
    )


def _film(at: OnMesh, name: str, force: float) -> Film:
    """Mean stresses by virtual work: of the displacement r along the radius, and z along the axis."""
    mesh, part, forces = at.mesh, at.parts[name], at.forces(name)
    low, high = part.body.heights
    inner, outer = part.body.radii
    volume = math.pi * (outer**2 - inner**2) * (high - low)
    radius = np.stack([mesh.radii[part.columns], mesh.radii[part.columns + 1]], axis=1)
    height = np.stack([mesh.heights[part.rows], mesh.heights[part.rows + 1]], axis=1) - low
    plane = np.einsum("xyab,xa->", forces[:, :, RADIAL, :2, :2], radius)
    normal = np.einsum("xyab,yb->", forces[:, :, AXIAL, :2, :2], height)
    return Film(force, plane_stress=float(plane) / volume / 2, normal_stress=float(normal) / volume)
