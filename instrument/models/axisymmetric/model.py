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
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.models.axisymmetric.bodies import assemble, keeps_pressure
from palpate.instrument.models.axisymmetric.fields import FacePressure, Field, OnMesh, displacements, face
from palpate.instrument.models.axisymmetric.forces import (
    below,
    capacitance_of,
    charge_of,
    charging,
    counts_above,
    over_tooth,
    pressing,
    raising,
    sinking,
    stresses,
)
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.axisymmetric.numbering import Part, number, parts
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.condensed import Elements
from palpate.instrument.models.finite_elements.coupling import Circuits
from palpate.instrument.models.finite_elements.error_estimate import SAFETY, Bounds, Energies, Judged, bounds
from palpate.instrument.models.finite_elements.refinement import Source
from palpate.instrument.models.finite_elements.refinement import solve as solve_elements
from palpate.instrument.models.finite_elements.threads import one_each
from palpate.instrument.models.parameters import CLOSED, RoundParameters

Array = NDArray[np.float64]

# The last refinement takes a second and is good to 1e-7; finer meshes are for references.
REFINEMENTS = (1, 2, 3, 4, 5)
# Rounding of the force ratio: up to 1.3e-12, for a foil of 10 µm and 140 GPa.
ROUND_OFF = 1e-11
# Of two meshes alone, how often the greater of change and product counts: they may differ one way and go on the other.
# Of random sensors none took more than 1.8.
FIRST = 4.0


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


# No slots: cached properties need a dictionary.
@dataclass(frozen=True)
class AxisymmetricSolution:
    """Solution for a force of 1 N that is spread evenly over the object. Compressive forces are positive.

    Attributes:
        force_ratio: tooth force over total force, from the section of the softer neighbour.
        tooth_force_above: force from the object on the tooth [N].
        tooth_force_below: force through the tooth's film [N]; on a rigid support the force on the tooth.
        ring_force: force below the ring [N].
        base_force: force through the base [N].
        films: films "tooth" and "base"; none on a rigid support.
        unknowns: number of displacements and pressures.
        residual: residual of the linear system, relative to the size of its terms.
        energies: energies from which errors are estimated.
        seconds: processor time to build the element matrices, to solve, and to evaluate the forces [s].
        on_mesh: solution from which `fields` and `face` are computed.
    """

    force_ratio: float
    tooth_force_above: float
    tooth_force_below: float
    ring_force: float
    base_force: float
    films: dict[str, Film]
    unknowns: int
    residual: float
    energies: Energies
    seconds: tuple[float, float, float]
    on_mesh: OnMesh

    @functools.cached_property
    def fields(self) -> dict[str, Field]:
        """Displacement field of each body by its name."""
        return displacements(self.on_mesh)

    @functools.cached_property
    def face(self) -> FacePressure:
        """Pressure of the object on tooth and ring."""
        return face(self.on_mesh)

    @property
    def judged(self) -> Judged:
        """Numbers from which the mesh's error is estimated."""
        voltages = tuple(film.voltage for film in self.films.values())
        return Judged(self.force_ratio, voltages, self.energies, self.imbalance)

    @property
    def imbalance(self) -> float:
        """Greatest difference between the forces through the sections, over the total force."""
        return max(
            abs(self.tooth_force_above - self.tooth_force_below),
            abs(self.tooth_force_below + self.ring_force - 1),
            abs(self.base_force - 1),
        )


# A sweep asks for the same sensor and sample at every load.
@functools.lru_cache(maxsize=64)
def solve_to(parameters: RoundParameters, tolerance: float) -> tuple[AxisymmetricSolution, float]:
    """Refine until the error estimate of the force ratio meets `tolerance`. Returns the solution and the estimate.

    Raises:
        RangeError: the tolerance is not positive and finite, or the finest mesh does not meet it.
        EstimateError: a linear system cannot be solved accurately.
    """
    if not (0 < tolerance < math.inf):
        raise RangeError(f"tolerance {tolerance:g} is not above 0 and finite; give a positive one")
    if tolerance < ROUND_OFF:
        raise RangeError(
            f"tolerance {tolerance:g}: model 'axisymmetric' rounds its ratio by up to {ROUND_OFF:g}; give a larger one"
        )
    meshes = [solve(parameters, REFINEMENTS[0]).judged]
    best = math.inf
    for refinement in REFINEMENTS[1:]:
        solution = solve(parameters, refinement)
        meshes.append(solution.judged)
        found = error_estimate(meshes, parameters)
        if found.force_ratio <= tolerance:
            films = {name: replace(film, voltage_error=found.voltage) for name, film in solution.films.items()}
            return replace(solution, films=films), found.force_ratio
        best = min(best, found.force_ratio)
    raise RangeError(
        f"model 'axisymmetric' cannot meet tolerance {tolerance:g}: its least error here is {best:.1e}; give a larger"
        " tolerance"
    )


def error_estimate(meshes: Sequence[Judged], parameters: RoundParameters) -> Bounds:
    """Bounds on the errors of the last of two or more meshes, with the imbalance of its forces added."""
    gap = parameters.ring_inner_radius - parameters.tooth_radius
    closed = gap < CLOSED * parameters.tooth_radius
    found = bounds(meshes, slowly=closed, safety=FIRST if len(meshes) == 2 else SAFETY)
    return replace(found, force_ratio=found.force_ratio + meshes[-1].imbalance + ROUND_OFF)


def solve(parameters: RoundParameters, refinement: int) -> AxisymmetricSolution:
    """Solve with degree `refinement` + 2 and `refinement` + 1 layers.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: the linear system cannot be solved accurately.
    """
    if refinement not in REFINEMENTS:
        raise RangeError(f"refinement {refinement} is outside {REFINEMENTS[0]} to {REFINEMENTS[-1]}; give one of these")
    return solve_on(parameters, degree=refinement + 2, layers=refinement + 1)


def solve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> AxisymmetricSolution:
    """Solve on a mesh of any degree and number of layers.

    Args:
        parameters: the sensor.
        degree: degree of the elements, at least 3.
        layers: number of geometric layers at the corners.
        mixed: whether bodies keep their pressure as an unknown where that gains digits; otherwise none does.

    Raises:
        EstimateError: the linear system cannot be solved accurately.
    """
    start = time.process_time()
    mesh = grid(parameters, layers)
    r, z = el.line(mesh.radii, degree, radial=True), el.line(mesh.heights, degree, radial=False)
    bodies = parts(mesh)
    numbering = number(parameters, mesh, r, z, bodies)
    with one_each(numbering.subdomains) as each:
        keeping = [part for part in bodies if mixed and keeps_pressure(part.body)]
        elements = assemble(numbering, r, z, bodies, keeping, each)
        built = time.process_time()
        films = [part for part in bodies if part.body.film]
        polarised = [_everywhere(elements, part, charging(r, z, part)) for part in films]
        load = elements.gather(_everywhere(elements, bodies[0], pressing(r, bodies[0])))
        raised = bodies[0] if counts_above(parameters) else films[0]
        sources = [Source(load), Source(np.zeros_like(load), raising(elements, mesh, r, parameters, raised))]
        sources += [Source(elements.gather(forces)) for forces in polarised]
        solved = solve_elements(elements, sources, each)
    done = time.process_time()
    named = {part.body.name: part for part in bodies}
    found = [OnMesh(parameters, mesh, r, named, s.displacement[elements.unknowns], s.internal) for s in solved]
    polarised = [el.nodal(forces) for forces in polarised]
    return _evaluate(found, polarised, elements, solved[0].residual, (start, built, done))


def _everywhere(elements: Elements, part: Part, forces: Array) -> Array:
    """Forces (elements, n) that act on one part alone."""
    found = np.zeros(elements.unknowns.shape)
    found[part.elements] = forces
    return found


def _evaluate(
    found: list[OnMesh],
    polarised: list[Array],
    elements: Elements,
    residual: float,
    marks: tuple[float, float, float],
) -> AxisymmetricSolution:
    """Solution with open films, from those under the load, under the jump and under each film's voltage."""
    start, built, done = marks
    (pressed, jumped, *charged), parameters = found, found[0].parameters
    films = [part.body for part in pressed.parts.values() if part.body.film is not None]
    circuits = Circuits(
        np.array([capacitance_of(body) for body in films]),
        np.array([[charge_of(by, body) for by in charged] for body in films]).reshape(2 * (len(films),)),
    )
    shorted = {body.name: charge_of(pressed, body) for body in films}

    def opened(at: OnMesh) -> tuple[OnMesh, Array]:
        charges = np.array([charge_of(at, body) for body in films])
        voltages = circuits.voltages(charges)
        displacements, internal = at.displacements, at.internal
        for voltage, by, forces in zip(voltages, charged, polarised, strict=True):
            displacements = displacements - voltage * by.displacements
            internal = internal + voltage * (forces - by.internal)
        return replace(at, displacements=displacements, internal=internal), voltages

    (at, voltages), (jump, _) = opened(pressed), opened(jumped)
    # The forces on the vertices that the jump raises by 1 are its work.
    from_above = counts_above(parameters)
    work = over_tooth(jump) if from_above else float(below(jump, films[0].name).sum())
    above = over_tooth(at)
    ring = float(below(at, "ring").sum())
    felt: dict[str, Film] = {}
    for name, body, voltage in zip(("tooth", "base"), films, voltages.tolist(), strict=False):
        plane, normal = stresses(at, body)
        felt[name] = Film(float(below(at, body.name).sum()), plane, normal, voltage, shorted[body.name])
    tooth, base = (felt["tooth"].force, felt["base"].force) if felt else (above, above + ring)
    return AxisymmetricSolution(
        force_ratio=above if from_above else tooth,
        tooth_force_above=above,
        tooth_force_below=tooth,
        ring_force=ring,
        base_force=base,
        films=felt,
        unknowns=elements.size + elements.dilatation.shape[0] * elements.dilatation.shape[1],
        residual=residual,
        energies=Energies(sinking(at), work),
        seconds=(built - start, done - built, time.process_time() - done),
        on_mesh=at,
    )
