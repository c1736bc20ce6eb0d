"""The displacements of the round sensor under one object, to the last digit: fields, and the pressure on its face.

    solve(parameters, refinement=3).face.pressure

Answers that need no fields come from curves (`model`).
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.models.axisymmetric.curves import (
    DisplacementField,
    FacePressure,
    OnMesh,
    below,
    capacitance_of,
    charge_of,
    charging,
    counts_above,
    displacements,
    face,
    over_tooth,
    pressing,
    stresses,
)
from palpate.instrument.models.axisymmetric.mesh import BodyElements, assemble, grid, keeps_pressure, number, parts
from palpate.instrument.models.axisymmetric.model import FilmStresses, resolution_of
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.poles import Circuits
from palpate.instrument.models.finite_elements.solving import Elements
from palpate.instrument.models.finite_elements.solving import solve as solve_elements
from palpate.instrument.models.finite_elements.work import one_each
from palpate.instrument.models.parameters import RoundParameters


# No slots: cached properties need a dictionary.
@dataclass(frozen=True)
class DirectSolution:
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
        seconds: processor time to build the element matrices, to solve, and to evaluate the forces [s].
        on_mesh: solution from which `fields` and `face` are computed.
    """

    force_ratio: float
    tooth_force_above: float
    tooth_force_below: float
    ring_force: float
    base_force: float
    films: dict[str, FilmStresses]
    unknowns: int
    residual: float
    seconds: tuple[float, float, float]
    on_mesh: OnMesh

    @functools.cached_property
    def fields(self) -> dict[str, DisplacementField]:
        """Displacement field of each body by its name."""
        return displacements(self.on_mesh)

    @functools.cached_property
    def face(self) -> FacePressure:
        """Pressure of the object on tooth and ring."""
        return face(self.on_mesh)

    @property
    def imbalance(self) -> float:
        """Greatest difference between the forces through the sections, over the total force."""
        return max(
            abs(self.tooth_force_above - self.tooth_force_below),
            abs(self.tooth_force_below + self.ring_force - 1),
            abs(self.base_force - 1),
        )


def solve(parameters: RoundParameters, refinement: int) -> DirectSolution:
    """Solve on the mesh of one refinement.

    Raises:
        RangeError: there is no such refinement.
        EstimateError: the linear system cannot be solved accurately.
    """
    return solve_on(parameters, *resolution_of(refinement))


def solve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> DirectSolution:
    """Solve on a mesh of any degree and number of layers.

    The mesh is that of `curves.curve_on`, which has the same arguments.

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
        solved = solve_elements(elements, [load, *(elements.gather(forces) for forces in polarised)], each)
    done = time.process_time()
    named = {part.body.name: part for part in bodies}
    found = [OnMesh(parameters, mesh, r, named, s.displacement[elements.unknowns], s.internal) for s in solved]
    polarised = [el.nodal(forces) for forces in polarised]
    return _evaluate(found, polarised, elements, solved[0].residual, (start, built, done))


def _everywhere(elements: Elements, part: BodyElements, forces: Floats) -> Floats:
    """Forces (elements, n) that act on one part alone."""
    found = np.zeros(elements.unknowns.shape)
    found[part.elements] = forces
    return found


def _evaluate(
    found: list[OnMesh],
    polarised: list[Floats],
    elements: Elements,
    residual: float,
    marks: tuple[float, float, float],
) -> DirectSolution:
    """Solution with open films, from those under the load and under each film's voltage."""
    start, built, done = marks
    pressed, *charged = found
    films = [part.body for part in pressed.parts.values() if part.body.film is not None]
    circuits = Circuits(
        np.array([capacitance_of(body) for body in films]),
        np.array([[charge_of(by, body) for by in charged] for body in films]).reshape(2 * (len(films),)),
    )
    shorted = {body.name: charge_of(pressed, body) for body in films}

    charges = np.array(list(shorted.values()))
    voltages = circuits.voltages(charges)
    displacements, internal = pressed.displacements, pressed.internal
    for voltage, by, forces in zip(voltages, charged, polarised, strict=True):
        displacements = displacements - voltage * by.displacements
        internal = internal + voltage * (forces - by.internal)
    at = replace(pressed, displacements=displacements, internal=internal)
    above = over_tooth(at)
    ring = float(below(at, "ring").sum())
    felt: dict[str, FilmStresses] = {}
    for name, body, voltage in zip(("tooth", "base"), films, voltages.tolist(), strict=False):
        plane, normal = stresses(at, body)
        felt[name] = FilmStresses(float(below(at, body.name).sum()), plane, normal, voltage, shorted[body.name])
    tooth, base = (felt["tooth"].force, felt["base"].force) if felt else (above, above + ring)
    return DirectSolution(
        force_ratio=above if counts_above(at.parameters) else tooth,
        tooth_force_above=above,
        tooth_force_below=tooth,
        ring_force=ring,
        base_force=base,
        films=felt,
        unknowns=elements.size + elements.dilatation.shape[0] * elements.dilatation.shape[1],
        residual=residual,
        seconds=(built - start, done - built, time.process_time() - done),
        on_mesh=at,
    )
