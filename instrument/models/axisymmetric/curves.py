"""Curves of the round sensor over the modulus of the sensed object: sensor and object, each condensed onto the contact.

    found = curve_on(RoundParameters(), degree=4, layers=3)
    found.force_ratios(np.array([24e3, 1e5]))

The sensor has its films in short circuit there; `poles` opens them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.models.axisymmetric.mesh import (
    AXIAL,
    RADIAL,
    AxisymmetricBody,
    BodyElements,
    Grid,
    compliance_of,
    constants,
    grid,
    inside,
    keeps_pressure,
    keeps_volume,
    number,
    parts,
    within,
)
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.elimination import Condensed, ElementSystem, condense, extrapolated
from palpate.instrument.models.finite_elements.poles import Curve, Sensor, capacitance, charge, curve
from palpate.instrument.models.finite_elements.work import keep, single
from palpate.instrument.models.parameters import RoundParameters

Number = TypeVar("Number", bound=np.generic)

# --- displacements over every body, and the pressure on the sensor's face --------------------------------


POINTS = 5  # number of points along a side of an element


@dataclass(frozen=True, slots=True)
class DisplacementField:
    """Displacements of a body on a grid of points, for a total force of 1 N.

    Attributes:
        radius, height: coordinates of the undeformed points [m], (columns, rows).
        radial, axial: displacements [m], (columns, rows).
    """

    radius: Floats
    height: Floats
    radial: Floats
    axial: Floats


@dataclass(frozen=True, slots=True)
class FacePressure:
    """Pressure of the object on the sensor's face at Gauss points, from the axis outwards, for a total force of 1 N.

    The pressure is singular at the edges of parts: the finer the mesh, the higher it reaches there. The whole force on
        a part is not affected. Elsewhere the pressure converges more slowly than forces do, most slowly at the axis.

    Attributes:
        radius: radii of the points [m]; none lie over the gap.
        pressure: pressure, positive in compression [Pa]; negative where a bonded object pulls.
        area: area of the face that belongs to each point [m2].
        reach: radius of the tooth [m].
    """

    radius: Floats
    pressure: Floats
    area: Floats
    reach: float

    @property
    def tooth_force(self) -> float:
        """Force on the tooth: integral of the pressure [N]."""
        return float((self.pressure * self.area)[self.radius < self.reach].sum())

    @property
    def force(self) -> float:
        """Force on the whole face: integral of the pressure [N]."""
        return float((self.pressure * self.area).sum())


@dataclass(frozen=True, slots=True)
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


def on(local: NDArray[Number], part: BodyElements) -> NDArray[Number]:
    """Element vectors of a body as (columns, rows, axis, radial shape, axial shape)."""
    shapes = math.isqrt(local.shape[1] // 2)
    return local[part.elements].reshape(len(part.columns), len(part.rows), 2, shapes, shapes)


def displacements(at: OnMesh) -> dict[str, DisplacementField]:
    """Displacement field of every body, by its name."""
    points = np.linspace(0, 1, POINTS)
    shapes, _ = el.shape_functions(at.r.dofs.shape[1] - 1, points)

    def along(lines: Floats, intervals: Indices) -> Floats:
        return (lines[intervals][:, None] + np.diff(lines)[intervals][:, None] * points).ravel()

    found = {}
    for name, part in at.parts.items():
        sampled = np.einsum("xyckl,ki,lj->cxiyj", on(at.displacements, part), shapes, shapes, optimize=True)
        radius, height = np.meshgrid(
            along(at.mesh.radii, part.columns), along(at.mesh.heights, part.rows), indexing="ij"
        )
        radial, axial = sampled.reshape(2, *radius.shape)
        found[name] = DisplacementField(radius, height, radial, axial)
    return found


def face(at: OnMesh) -> FacePressure:
    """Pressure on the face, from the object's forces on the shape functions of its lower side."""
    p, dofs = at.parameters, at.r.dofs
    outer = min(p.ring_outer_radius, p.sensed_radius)
    touching = np.concatenate(
        [inside(at.mesh.radii, part) for part in ((0.0, p.tooth_radius), (p.ring_inner_radius, outer))]
    )
    forces = np.zeros(dofs.max() + 1)
    np.add.at(forces, dofs[at.parts["object"].columns], at.forces("object")[:, 0, AXIAL, :, 0])
    return face_pressure(at.mesh, dofs, touching, forces, p.tooth_radius)


def face_pressure(mesh: Grid, dofs: Indices, touching: Indices, forces: Floats, reach: float) -> FacePressure:
    """The pressure whose work on every shape function of the face is that of the nodal forces.

    Such consistent tractions are far more accurate than stresses from the gradients of displacements (Carey, Chow and
    Seager 1985). They balance the forces exactly, and need no stress of a body whose pressure is an unknown.

    Args:
        mesh: grid of the sensor.
        dofs: numbers of the shape functions of each interval of the radius, (intervals, p + 1).
        touching: intervals where the object touches the sensor.
        forces: forces of the object on the face, by number of the shape function [N].
        reach: radius of the tooth [m].
    """
    from scipy.linalg import solve

    degree = dofs.shape[1] - 1
    numbers, local = np.unique(dofs[touching], return_inverse=True)
    local = local.reshape(len(touching), -1)
    shapes, _, area = _quadrature(mesh.radii, touching, degree, degree + 2)
    mass = np.zeros((len(numbers), len(numbers)))
    np.add.at(mass, (local[:, :, None], local[:, None, :]), np.einsum("eq,iq,jq->eij", area, shapes, shapes))
    scale = 1 / np.sqrt(np.diag(mass))
    nodal = scale * solve(mass * np.outer(scale, scale), scale * forces[numbers], assume_a="pos")
    # These points suffice for the integrals, and the highest polynomial, the least certain part, is zero there.
    shapes, radius, area = _quadrature(mesh.radii, touching, degree, degree)
    return FacePressure(radius.ravel(), (nodal[local] @ shapes).ravel(), area.ravel(), reach)


def _quadrature(radii: Floats, intervals: Indices, degree: int, count: int) -> tuple[Floats, Floats, Floats]:
    """Shape functions (degree + 1, count), radii [m] and areas [m2] (intervals, count) at Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    width = np.diff(radii)[intervals][:, None]
    radius = radii[intervals][:, None] + width * (points + 1) / 2
    shapes, _ = el.shape_functions(degree, (points + 1) / 2)
    return shapes, radius, math.pi * radius * width * weights


# --- loads on the elements, and forces, stresses and charges that follow from a solution -----------------


def pressing(r: el.LineIntegrals, part: BodyElements) -> Floats:
    """Forces of 1 N, spread evenly over the top of the object, per radian: (elements of the object, n)."""
    shapes = r.dofs.shape[1]
    load = np.zeros((len(part.columns), len(part.rows), 2, shapes, shapes))
    # The first shape function is 1, so these are the integrals ∫ r φ.
    load[:, -1, AXIAL, :, :2] -= r.value_value[part.columns][:, :, :1] / (math.pi * part.body.radii[1] ** 2)
    return load.reshape(len(part), -1)


def charging(r: el.LineIntegrals, z: el.LineIntegrals, part: BodyElements) -> Floats:
    """Forces of a film under 1 V, against its voltage, per radian: (elements of the film, n)."""
    assert part.body.film is not None
    low, high = part.body.heights
    _, stress, _ = part.body.film.stiff()
    return el.polarised(r, z, part.columns, part.rows, stress[0] / (high - low), stress[2] / (high - low))


def counts_above(parameters: RoundParameters) -> bool:
    """Whether the tooth's force is taken above the tooth, not below.

    The softer side is more exact, since forces in a stiff section are differences of large displacements.
    """
    return parameters.support == "rigid" or parameters.sensed_modulus < parameters.film.modulus


def below(at: OnMesh, name: str) -> Floats:
    """Forces (columns, 2) on the vertices below a body [N]."""
    return at.forces(name)[:, 0, AXIAL, :2, 0]


def over_tooth(at: OnMesh) -> float:
    """Force of the object on the tooth [N]."""
    vertices = at.r.dofs[at.parts["object"].columns][:, :2]
    return float(below(at, "object")[within(at.parameters.tooth_radius, at.mesh, at.r)[vertices]].sum())


def stresses(at: OnMesh, body: AxisymmetricBody) -> tuple[float, float]:
    """Mean stresses [Pa] in the plane and along the axis, by virtual work of the displacements r and z."""
    mesh, part, forces = at.mesh, at.parts[body.name], at.forces(body.name)
    radius = np.stack([mesh.radii[part.columns], mesh.radii[part.columns + 1]], axis=1)
    height = np.stack([mesh.heights[part.rows], mesh.heights[part.rows + 1]], axis=1) - body.heights[0]
    plane = np.einsum("xyab,xa->", forces[:, :, RADIAL, :2, :2], radius)
    normal = np.einsum("xyab,yb->", forces[:, :, AXIAL, :2, :2], height)
    return float(plane) / body.volume / 2, float(normal) / body.volume


def charge_of(at: OnMesh, body: AxisymmetricBody) -> float:
    """Charge that leaves a short-circuited film [C]."""
    assert body.film is not None
    plane, normal = stresses(at, body)
    return charge(body.film, body.area, plane, plane, normal)


def capacitance_of(body: AxisymmetricBody) -> float:
    """Capacitance of a film [F]."""
    assert body.film is not None
    return capacitance(body.film, body.area, body.heights[1] - body.heights[0])


def stressing(r: el.LineIntegrals, z: el.LineIntegrals, part: BodyElements) -> tuple[Floats, Floats]:
    """Forces (elements of the film, n) per radian whose work is what strains add to the film's mean stresses.

    These are the stress in the plane and that along the axis.
    """
    c, volume = constants(part.body, mixed=False), part.body.volume
    plane = el.polarised(r, z, part.columns, part.rows, (c.c11 + c.c12) / 2 / volume, c.c13 / volume)
    return plane, el.polarised(r, z, part.columns, part.rows, c.c13 / volume, c.c33 / volume)


def stress_by_voltage(body: AxisymmetricBody) -> tuple[float, float]:
    """What 1 V across a film adds to its mean stresses in the plane and along the axis [Pa/V]."""
    assert body.film is not None
    _, stress, _ = body.film.stiff()
    thickness = body.heights[1] - body.heights[0]
    return float(stress[0]) / thickness, float(stress[2]) / thickness


# --- curves ----------------------------------------------------------------------------------------------

# Compliance, over that of shear, that is added where a body keeps its volume: less would cost digits.
ADDED = 3e-3
BATCH = 32  # number of elements in a batch; more do not fit into the cache


def curve_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> Curve:
    """The curve on a mesh of any degree and number of layers, under 1 N that is spread evenly over the object.

    Its goals are the mean stresses of each film, in the plane and along the axis [Pa]. The parameters' modulus of the
    object has no effect. The curve is kept for the next time, in memory and on disk.

    Args:
        parameters: the sensor.
        degree: degree of the elements, at least 2.
        layers: number of geometric layers at the corners.
        mixed: whether bodies keep their pressure as an unknown where that gains digits; otherwise none does.

    Raises:
        EstimateError: a stiffness is not positive definite to working precision.
    """
    return _kept(replace(parameters, sensed_modulus=1.0), degree, layers, mixed)


@functools.lru_cache(maxsize=64)
def _kept(parameters: RoundParameters, degree: int, layers: int, mixed: bool) -> Curve:
    text = f"axisymmetric;degree={degree};layers={layers};mixed={mixed};{parameters.canonical()}"
    return keep(text, Curve, lambda: found_on(parameters, degree, layers, mixed))


@single()
def found_on(parameters: RoundParameters, degree: int, layers: int, mixed: bool = True) -> Curve:
    """Compute what `curve_on` gives, without looking for a kept curve and without keeping it."""
    mesh = grid(replace(parameters, sensed_modulus=1.0), layers)
    r, z = el.line(mesh.radii, degree, radial=True), el.line(mesh.heights, degree, radial=False)
    bodies = parts(mesh)
    unknowns, size = (numbering := number(parameters, mesh, r, z, bodies)).unknowns, numbering.size
    films = [part for part in bodies if part.body.film is not None]
    forces = [(film, charging(r, z, film)) for film in films]
    forces += [(film, by) for film in films for by in stressing(r, z, film)]
    sensed = _Side(r, z, bodies[:1], unknowns, size, mixed, [(bodies[0], pressing(r, bodies[0]))])
    sensor = _Side(r, z, bodies[1:], unknowns, size, mixed, forces)
    contact = sensed.touched & sensor.touched

    # The shape functions of the object's vertices on the face add up to 1.
    vertices = on(unknowns, bodies[0])[:, 0, AXIAL, :2, 0]
    over = within(parameters.tooth_radius, mesh, r)[r.dofs[bodies[0].columns][:, :2]]

    def raised(places: NDArray[np.bool_]) -> Floats:
        displacement = np.zeros(size + 1)
        displacement[vertices[places]] = 1.0
        return displacement[:-1][contact]

    felt, pressed = sensor.condensed(contact), sensed.condensed(contact)
    rigid, count = parameters.support == "rigid", len(films)
    found = Sensor(felt, slice(0, count), np.array([capacitance_of(film.body) for film in films]))
    volts = np.array([stress_by_voltage(film.body) for film in films]).reshape(count, 1, 2)
    # A rigid tooth carries what the ring does not.
    jump = raised(~over) if rigid else -raised(over)
    return curve(
        found,
        pressed,
        modes=np.zeros((len(jump), 0)) if rigid else raised(np.ones_like(over))[:, None],
        rows=found.rows(slice(count, 3 * count), (np.eye(count)[:, :, None] * volts).reshape(count, 2 * count)),
        offsets=np.zeros((2 * count, 1)),
        ratio=found.stiffness @ jump,
        share=1.0 if rigid else 0.0,
    )


@dataclass(frozen=True, slots=True)
class _Side:
    """Parts on one side of the contact, and forces on them per radian.

    Attributes:
        r, z: integrals over the radius and over the height.
        parts: the parts.
        unknowns: (elements, n), numbers of the unknowns of all elements.
        size: number of unknowns, and the number of those that are fixed.
        mixed: whether bodies may keep their pressure as an unknown.
        forces: parts, each with forces on its elements.
    """

    r: el.LineIntegrals
    z: el.LineIntegrals
    parts: Sequence[BodyElements]
    unknowns: Indices
    size: int
    mixed: bool
    forces: Sequence[tuple[BodyElements, Floats]]

    @property
    def touched(self) -> NDArray[np.bool_]:
        """Whether an unknown belongs to any part."""
        found = np.zeros(self.size + 1, dtype=bool)
        for part in self.parts:
            found[self.unknowns[part.elements]] = True
        return found[:-1]

    def condensed(self, contact: NDArray[np.bool_]) -> Condensed:
        """What is left on the contact."""
        own = np.flatnonzero(self.touched)
        numbers = np.full(self.size + 1, -1)
        numbers[own] = np.arange(len(own))
        loads = np.zeros((self.size + 1, len(self.forces)))
        for column, (part, forces) in enumerate(self.forces):
            np.add.at(loads[:, column], self.unknowns[part.elements], 2 * math.pi * el.nodal(forces))
        places = [np.meshgrid(part.columns, part.rows, indexing="ij") for part in self.parts]
        bodies = [part.body for part in self.parts]

        def condensed_at(added: float) -> Condensed:
            matrices = self._matrices(added)
            return condense(
                ElementSystem(
                    unknowns=np.concatenate([numbers[self.unknowns[part.elements]] for part in self.parts]),
                    coordinates=np.concatenate([np.stack([x.ravel(), y.ravel()], axis=1) for x, y in places]),
                    matrices=lambda elements: matrices[elements],
                    kept=contact[own],
                    loads=loads[own],
                )
            )

        return (
            extrapolated(condensed_at, ADDED)
            if self.mixed and any(keeps_volume(body) for body in bodies)
            else condensed_at(0.0)
        )

    def _matrices(self, added: float) -> Floats:
        """Stiffness (elements, n, n) on nodes, over the whole circle, with the pressures eliminated.

        Args:
            added: compliance, over that of shear, that is added to that of a body that keeps its volume.
        """
        fill, size = el.Stiffness(self.r, self.z), self.unknowns.shape[1]
        matrices, start = np.empty((sum(map(len, self.parts)), size, size)), 0
        for part in self.parts:
            body, columns, rows = part.body, part.columns, part.rows
            mixed = self.mixed and keeps_pressure(body)
            found = fill(columns, rows, constants(body, mixed), out=matrices[start : start + len(part)])
            if mixed:
                spread = el.dilatation(self.r, self.z, columns, rows)
                compliance = compliance_of(body) + (added if keeps_volume(body) else 0.0)
                for few in range(0, len(part), BATCH):
                    own = spread[few : few + BATCH]
                    found[few : few + BATCH] += own.transpose(0, 2, 1) @ (own * (body.shear / compliance))
            start += len(part)
        matrices *= 2 * math.pi
        # Triangles differ by rounding, of which hard objects on some processors keep ten times less from the lower one.
        return el.nodal(matrices).transpose(0, 2, 1)
