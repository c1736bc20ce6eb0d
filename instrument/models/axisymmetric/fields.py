"""Fields of the round sensor's solution: displacements over every body, and the pressure on the sensor's face."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.mesh import Grid, inside
from palpate.instrument.models.axisymmetric.numbering import AXIAL, Part
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

Number = TypeVar("Number", bound=np.generic)

POINTS = 5  # number of points along a side of an element


@dataclass(frozen=True, slots=True)
class Field:
    """Displacements of a body on a grid of points, for a total force of 1 N.

    Attributes:
        radius, height: coordinates of the undeformed points [m], (columns, rows).
        radial, axial: displacements [m], (columns, rows).
    """

    radius: Array
    height: Array
    radial: Array
    axial: Array


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

    radius: Array
    pressure: Array
    area: Array
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
    r: el.Line
    parts: dict[str, Part]
    displacements: Array
    internal: Array

    def forces(self, body: str) -> Array:
        """Forces [N] of a body over the whole circle: (columns, rows, axis, radial shape, axial shape)."""
        return 2 * math.pi * on(self.internal, self.parts[body])


def on(local: NDArray[Number], part: Part) -> NDArray[Number]:
    """Element vectors of a body as (columns, rows, axis, radial shape, axial shape)."""
    shapes = math.isqrt(local.shape[1] // 2)
    return local[part.elements].reshape(len(part.columns), len(part.rows), 2, shapes, shapes)


def displacements(at: OnMesh) -> dict[str, Field]:
    """Displacement field of every body, by its name."""
    points = np.linspace(0, 1, POINTS)
    shapes, _ = el.shape_functions(at.r.dofs.shape[1] - 1, points)

    def along(lines: Array, intervals: Indices) -> Array:
        return (lines[intervals][:, None] + np.diff(lines)[intervals][:, None] * points).ravel()

    found = {}
    for name, part in at.parts.items():
        sampled = np.einsum("xyckl,ki,lj->cxiyj", on(at.displacements, part), shapes, shapes, optimize=True)
        radius, height = np.meshgrid(
            along(at.mesh.radii, part.columns), along(at.mesh.heights, part.rows), indexing="ij"
        )
        radial, axial = sampled.reshape(2, *radius.shape)
        found[name] = Field(radius, height, radial, axial)
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


def face_pressure(mesh: Grid, dofs: Indices, touching: Indices, forces: Array, reach: float) -> FacePressure:
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


def _quadrature(radii: Array, intervals: Indices, degree: int, count: int) -> tuple[Array, Array, Array]:
    """Shape functions (degree + 1, count), radii [m] and areas [m2] (intervals, count) at Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(count)
    width = np.diff(radii)[intervals][:, None]
    radius = radii[intervals][:, None] + width * (points + 1) / 2
    shapes, _ = el.shape_functions(degree, (points + 1) / 2)
    return shapes, radius, math.pi * radius * width * weights
