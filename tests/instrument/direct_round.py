"""The round sensor solved for one modulus at a time, to the last digit, from one assembled matrix.

Beside which the curves by fronts and poles are tested. Nearly incompressible material keeps its pressure as an unknown:
the factorised matrix has a bounded bulk modulus, and steps of iterative refinement on the equations of displacement
and pressure reach the true answer, also for Poisson ratio 0.5. A high bound costs digits in the factors, and with a low
one the steps converge slowly. So the search begins with a high bound, and lowers it where the residual asks for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.models.axisymmetric.curves import capacitance_of, charging, on, pressing
from palpate.instrument.models.axisymmetric.mesh import (
    AXIAL,
    RADIAL,
    AxisymmetricBody,
    BodyElements,
    Grid,
    compliance_of,
    constants,
    grid,
    keeps_pressure,
    number,
    parts,
    within,
)
from palpate.instrument.models.axisymmetric.model import FilmStresses, resolution_of
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.poles import charge
from palpate.instrument.models.parameters import RoundParameters

BULK_BOUND = 1e5  # greatest λ/G in the factorised matrix
EASINGS = (1.0, 30.0, 1000.0)  # divisors of the bound, which are tried in turn
RESIDUAL_GOAL, STEPS = 1e-13, 20
SETTLED = 1e-10  # share of the displacement; after a step this small the next one would be mere rounding


# --- the system of equations ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Elements:
    """Element matrices with their unknowns.

    Attributes:
        stiffness: (elements, n, n), against the unknowns of `elements.differences`, without the dilatation of `mixed`.
        unknowns: (elements, n), numbers; those that are fixed to zero have the number `size`.
        mixed: numbers of the elements that keep their pressure.
        dilatation: (mixed, q, n), projected dilatation, from the unknowns of `elements.differences`.
        compliance, bound: (mixed,) 1/λ, 0 at Poisson ratio 0.5, and the least that is factorised [1/Pa].
    """

    stiffness: Floats
    unknowns: Indices
    size: int
    mixed: Indices
    dilatation: Floats
    compliance: Floats
    bound: Floats

    def gather(self, forces: Floats) -> Floats:
        """Sum (size + 1,) of element forces on nodes; the last entry is zero."""
        weights = el.nodal(forces.copy()).ravel()
        total = np.bincount(self.unknowns.ravel(), weights=weights, minlength=self.size + 1)
        total[self.size] = 0.0
        return np.asarray(total, dtype=np.float64)

    def matrix(self, stiffness: Floats) -> scipy.sparse.csc_array:
        """The sum of element matrices, which are turned to nodes."""
        count = self.unknowns.shape[1]
        local = el.nodal(stiffness)
        rows = np.repeat(self.unknowns, count, axis=1).ravel()
        columns = np.tile(self.unknowns, (1, count)).ravel()
        free = (rows < self.size) & (columns < self.size)
        entries = (local.ravel()[free], (rows[free], columns[free]))
        return scipy.sparse.coo_array(entries, shape=(self.size, self.size)).tocsc()

    def factorised(self, bounded: Floats) -> Callable[[Floats], Floats]:
        """What gives displacements (size + 1,) under forces (size + 1,), with these compliances."""
        stiffness = self.stiffness.copy()
        stiffness[self.mixed] += self.dilatation.transpose(0, 2, 1) @ (self.dilatation / bounded[:, None, None])
        matrix = self.matrix(stiffness)
        scale = 1 / np.sqrt(matrix.diagonal())
        scaled = scipy.sparse.diags_array(scale) @ matrix @ scipy.sparse.diags_array(scale)
        factors = scipy.sparse.linalg.splu(
            scaled.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        return lambda right: np.append(scale * factors.solve(scale * right[:-1]), 0.0)


def product(matrices: Floats, vectors: Floats) -> Floats:
    """Product of each matrix (elements, m, n) with its vector (elements, n)."""
    found: Floats = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
    return found


def assemble(
    unknowns: Indices, size: int, r: el.LineIntegrals, z: el.LineIntegrals, bodies: list[BodyElements], mixed: bool
) -> Elements:
    """Element matrices of all bodies, per radian; `mixed`: whether bodies keep their pressure where they can."""
    n = unknowns.shape[1]
    stiffness, fill = np.empty((len(unknowns), n, n)), el.Stiffness(r, z)
    numbers: list[int] = []
    dilatation, compliance, bound = [np.zeros((0, r.dilatation.shape[1] ** 2, n))], [], []
    for part in bodies:
        keeps = mixed and keeps_pressure(part.body)
        fill(part.columns, part.rows, constants(part.body, keeps), out=stiffness[part.elements])
        if keeps:
            dilatation.append(el.dilatation(r, z, part.columns, part.rows))
            numbers += range(part.elements.start, part.elements.stop)
            compliance += [compliance_of(part.body) / part.body.shear] * len(part)
            bound += [1 / (BULK_BOUND * part.body.shear)] * len(part)
    return Elements(
        stiffness,
        unknowns,
        size,
        np.array(numbers, dtype=np.intp),
        np.concatenate(dilatation),
        np.array(compliance),
        np.array(bound),
    )


@dataclass(frozen=True)
class ElementSolution:
    """Displacement (size + 1,), its last entry zero; forces on nodes (elements, n); residual over its terms."""

    displacement: Floats
    internal: Floats
    residual: float


def _solutions(elements: Elements, loads: list[Floats]) -> list[ElementSolution]:
    """Displacement and pressure under each load alone. The first is solved to the last digit."""
    tried: list[list[ElementSolution]] = []
    for easing in EASINGS:
        bounded = np.maximum(elements.compliance, easing * elements.bound)
        solver = elements.factorised(bounded)
        tried.append([_refined(elements, load, bounded, solver) for load in loads])
        if tried[-1][0].residual <= RESIDUAL_GOAL:
            break
    return min(tried, key=lambda solved: solved[0].residual)


def _refined(elements: Elements, load: Floats, bounded: Floats, solver: Callable[[Floats], Floats]) -> ElementSolution:
    """Refine as long as steps gain a digit, until they no longer move anything.

    The residual alone does not tell the end: beside rubber it is down to rounding while a foil still moves.
    """
    # A second array holds the digits of the displacements for which a double has no room.
    displacement, rest = np.zeros(elements.size + 1), np.zeros(elements.size + 1)
    spread = elements.dilatation.transpose(0, 2, 1)
    pressure = np.zeros(elements.dilatation.shape[:2])
    right, gap, best = load, np.zeros_like(pressure), math.inf
    for step in range(STEPS):
        change = solver(right)
        moved = el.differences(change[elements.unknowns], np.zeros(elements.unknowns.shape))[elements.mixed]
        pressure += (product(elements.dilatation, moved) + gap) / bounded[:, None]
        total = displacement + change
        kept = total - displacement
        rest += (displacement - (total - kept)) + (change - kept)
        displacement = total
        strained = el.differences(displacement[elements.unknowns], rest[elements.unknowns])
        internal = product(elements.stiffness, strained)
        terms = np.linalg.norm(product(np.abs(elements.stiffness), np.abs(strained)))
        internal[elements.mixed] += product(spread, pressure)
        gap = product(elements.dilatation, strained[elements.mixed])
        gap_terms = np.linalg.norm(product(np.abs(elements.dilatation), np.abs(strained[elements.mixed])))
        gap -= elements.compliance[:, None] * pressure
        lacking = ((load - elements.gather(internal), terms), (gap, gap_terms))
        residual = max(float(np.linalg.norm(left) / of) if of else 0.0 for left, of in lacking)
        if step > 0 and (residual > 0.1 * best or np.linalg.norm(change) <= SETTLED * np.linalg.norm(displacement)):
            break
        best = residual
        forces = internal.copy()
        forces[elements.mixed] += product(spread, gap / bounded[:, None])
        right = load - elements.gather(forces)
    return ElementSolution(displacement, el.nodal(internal), residual)


# --- forces, stresses and charges that follow from a solution ------------------------------------------


@dataclass(frozen=True)
class OnMesh:
    """Solution on the mesh: displacements, and forces on nodes per radian, of each element (elements, 2 (p + 1)^2)."""

    parameters: RoundParameters
    mesh: Grid
    r: el.LineIntegrals
    parts: dict[str, BodyElements]
    displacements: Floats
    internal: Floats

    def forces(self, body: str) -> Floats:
        """Forces [N] of a body over the whole circle: (columns, rows, axis, radial shape, axial shape)."""
        return 2 * math.pi * on(self.internal, self.parts[body])

    def below(self, name: str) -> Floats:
        """Forces (columns, 2) on the vertices below a body [N]."""
        return self.forces(name)[:, 0, AXIAL, :2, 0]

    @property
    def over_tooth(self) -> float:
        """Force of the object on the tooth [N]."""
        vertices = self.r.dofs[self.parts["object"].columns][:, :2]
        return float(self.below("object")[within(self.parameters.tooth_radius, self.mesh, self.r)[vertices]].sum())

    def stresses(self, body: AxisymmetricBody) -> tuple[float, float]:
        """Mean stresses [Pa] in the plane and along the axis, by virtual work of the displacements r and z."""
        mesh, part, forces = self.mesh, self.parts[body.name], self.forces(body.name)
        radius = np.stack([mesh.radii[part.columns], mesh.radii[part.columns + 1]], axis=1)
        height = np.stack([mesh.heights[part.rows], mesh.heights[part.rows + 1]], axis=1) - body.heights[0]
        plane = np.einsum("xyab,xa->", forces[:, :, RADIAL, :2, :2], radius)
        normal = np.einsum("xyab,yb->", forces[:, :, AXIAL, :2, :2], height)
        return float(plane) / body.volume / 2, float(normal) / body.volume

    def charge_of(self, body: AxisymmetricBody) -> float:
        """Charge that leaves a short-circuited film [C]."""
        assert body.film is not None
        plane, normal = self.stresses(body)
        return charge(body.film, body.area, plane, plane, normal)


@dataclass(frozen=True)
class DirectSolution:
    """Solution for a force of 1 N that is spread evenly over the object. Compressive forces are positive.

    Attributes:
        force_ratio: tooth force over total force, from the section of the softer neighbour: forces in a stiff section
            are differences of large displacements.
        tooth_force_above: force from the object on the tooth [N].
        imbalance: greatest difference between the forces through the sections, over the total force.
        films: films "tooth" and "base"; none on a rigid support.
        unknowns: number of displacements and pressures.
        residual: residual of the linear system, relative to the size of its terms.
        on_mesh: displacements and forces of all elements.
    """

    force_ratio: float
    tooth_force_above: float
    imbalance: float
    films: dict[str, FilmStresses]
    unknowns: int
    residual: float
    on_mesh: OnMesh


def solve(parameters: RoundParameters, refinement: int) -> DirectSolution:
    """Solve on the mesh of one refinement. Raises RangeError: there is no such refinement."""
    return solve_on(parameters, *resolution_of(refinement))


def solve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> DirectSolution:
    """Solve on the mesh of `curves.curve_on`, which has the same arguments."""
    mesh = grid(parameters, layers)
    r, z = el.line(mesh.radii, degree, radial=True), el.line(mesh.heights, degree, radial=False)
    bodies = parts(mesh)
    elements = assemble(*number(parameters, mesh, r, z, bodies), r, z, bodies, mixed)

    def everywhere(part: BodyElements, forces: Floats) -> Floats:
        found = np.zeros(elements.unknowns.shape)
        found[part.elements] = forces
        return found

    films = [part for part in bodies if part.body.film]
    polarised = [everywhere(part, charging(r, z, part)) for part in films]
    loads = [everywhere(bodies[0], pressing(r, bodies[0])), *polarised]
    solved = _solutions(elements, [elements.gather(forces) for forces in loads])
    named = {part.body.name: part for part in bodies}
    found = [OnMesh(parameters, mesh, r, named, s.displacement[elements.unknowns], s.internal) for s in solved]
    unknowns = elements.size + elements.dilatation.shape[0] * elements.dilatation.shape[1]
    return _evaluated(found, [el.nodal(forces) for forces in polarised], unknowns, solved[0].residual)


def _evaluated(found: list[OnMesh], polarised: list[Floats], unknowns: int, residual: float) -> DirectSolution:
    """Solution with open films, from those under the load and under each film's voltage."""
    pressed, *charged = found
    films = [part.body for part in pressed.parts.values() if part.body.film is not None]
    shorted = np.array([pressed.charge_of(body) for body in films])
    # Open films carry no charge: what the load moves onto them, their own voltages take away again.
    capacitances = np.diag([capacitance_of(body) for body in films]).reshape(2 * (len(films),))
    charges = np.array([[by.charge_of(body) for by in charged] for body in films]).reshape(2 * (len(films),))
    voltages = np.linalg.solve(capacitances + charges, shorted)
    displacements, internal = pressed.displacements, pressed.internal
    for voltage, by, forces in zip(voltages, charged, polarised, strict=True):
        displacements = displacements - voltage * by.displacements
        internal = internal + voltage * (forces - by.internal)
    at = replace(pressed, displacements=displacements, internal=internal)
    above, ring, p = at.over_tooth, float(at.below("ring").sum()), at.parameters
    felt: dict[str, FilmStresses] = {}
    for name, body, voltage, coulombs in zip(
        ("tooth", "base"), films, voltages.tolist(), shorted.tolist(), strict=False
    ):
        felt[name] = FilmStresses(float(at.below(body.name).sum()), *at.stresses(body), voltage, coulombs)
    tooth, base = (felt["tooth"].force, felt["base"].force) if felt else (above, above + ring)
    return DirectSolution(
        force_ratio=above if p.support == "rigid" or p.sensed_modulus < p.film.modulus else tooth,
        tooth_force_above=above,
        imbalance=max(abs(above - tooth), abs(tooth + ring - 1), abs(base - 1)),
        films=felt,
        unknowns=unknowns,
        residual=residual,
        on_mesh=at,
    )
