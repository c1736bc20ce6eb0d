"""Displacements and contact pressure of the solid model's solution in the plane through the teeth's axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import FacetBasis

from palpate.instrument.models.finite_elements.cost import judge
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.body import PlanElements, height_basis
from palpate.instrument.models.solid.ladders import resolution
from palpate.instrument.models.solid.parts import Part, Stack
from palpate.instrument.models.solid.system import System

Vector = NDArray[np.float64]

POINTS = np.linspace(0.0, 1.0, 5)  # number of points along a side of an element
GAUSS = (np.polynomial.legendre.leggauss(5)[0] + 1) / 2


@dataclass(frozen=True, slots=True)
class SectionField:
    """Displacements of a piece of a body on a grid of points of the section.

    Attributes:
        x, z: (columns, rows), undeformed points from the object's corner and from the sensor's face [m].
        along, up: (columns, rows), displacements along x and z [m].
    """

    x: Vector
    z: Vector
    along: Vector
    up: Vector


@dataclass(frozen=True, slots=True)
class Section:
    """Section in the plane y = constant through the axes of the middle row of teeth; of two rows, the upper one.

    Attributes:
        bodies: pieces of each body by its name, by rising x.
        x: points on the sensor's face that the object touches, from the object's corner [m].
        pressure: pressure of the object there, positive in compression [Pa]. It is singular where tooth and ring end.
    """

    bodies: Mapping[str, tuple[SectionField, ...]]
    x: Vector
    pressure: Vector


def section(p: SolidParameters, refinement: int) -> Section:
    """Solve the solid model, and return displacements and pressure in the plane through the teeth's axes.

    Args:
        p: the sensor, the object and the load.
        refinement: refinement of the mesh; a greater one is finer.

    Raises:
        RangeError, EstimateError: as in `palpate.instrument.models.solid.model.solve`.
    """
    system = System(p, resolution(p, refinement))
    judge(system.cost(), "take a coarser mesh")
    stack, moved = system.stack, p.force * system.displacement(system.load(p.load_at))
    height = (p.rows // 2 + 0.5) * p.cell_width
    line, face = (_Line(stack, height, points) for points in (POINTS, GAUSS))
    bodies: dict[str, list[SectionField]] = {}
    for part in stack.parts:
        bodies.setdefault(part.name, []).extend(_pieces(line, part, moved))
    x, pressure = _pressure(face, system, moved)
    if system.mirrored[0]:
        bodies = {name: _mirrored(pieces, p.length) for name, pieces in bodies.items()}
        x, pressure = np.concatenate([p.length - x[::-1], x]), np.concatenate([pressure[::-1], pressure])
    return Section({name: tuple(pieces) for name, pieces in bodies.items()}, x, pressure)


class _Line:
    """Sides of the plan's elements on a line along x, by rising x.

    Attributes:
        elements: element of the plan for each side.
        x: (sides, points), positions [m].
        values: (sides, points, shapes), values of the shape functions.
        names: (sides, shapes), names of the shape functions in the plan.
    """

    def __init__(self, stack: Stack, height: float, points: Vector) -> None:
        mesh = stack.plan.mesh
        x, y = mesh.p[:, mesh.facets]
        negligible = 1e-9 * mesh.p.max()
        # Beside a ring as wide as its cell there are sides of zero length.
        facets = np.flatnonzero((np.abs(y - height).max(axis=0) < negligible) & (np.ptp(x, axis=0) > negligible))
        facets = facets[np.argsort(mesh.p[0, mesh.facets[:, facets]].mean(axis=0))]
        quadrature = (points[None], np.full(len(points), 1 / len(points)))
        basis: Any = FacetBasis(mesh, stack.basis.elem, facets=facets, quadrature=quadrature)
        self.elements = np.asarray(basis.tind)
        self.x = np.asarray(basis.global_coordinates())[0]
        shapes = [np.broadcast_to(np.asarray(field[0]), self.x.shape) for field in basis.basis]
        order = np.argsort(self.x, axis=1)
        self.x = np.take_along_axis(self.x, order, axis=1)
        self.values = np.stack([np.take_along_axis(shape, order, axis=1) for shape in shapes], axis=-1)
        self.names = stack.basis.element_dofs[:, self.elements].T


def _pieces(line: _Line, part: Part, moved: Vector) -> list[SectionField]:
    body = part.body
    sides = np.flatnonzero(np.isin(line.elements, body.plan.elements))
    if not len(sides):
        return []
    basis = height_basis(body.height.breaks, body.height.degree, POINTS)
    z = np.asarray(basis.global_coordinates())[0]
    upright = np.stack([np.broadcast_to(np.asarray(field[0]), z.shape) for field in basis.basis], axis=-1)
    given = np.append(moved, 0.0)[part.names]
    nodes = np.searchsorted(body.plan.nodes, line.names[sides])
    local = given[:, body.height.local[:, :, None, None], nodes[None, None]]
    sampled = np.einsum("csmfn,fqn,srm->cfqsr", local, line.values[sides], upright, optimize=True)
    breaks = np.flatnonzero(line.x[sides[1:], 0] - line.x[sides[:-1], -1] > 1e-9 * np.ptp(line.x)) + 1
    pieces = []
    for piece in np.split(np.arange(len(sides)), breaks):
        x, heights = np.meshgrid(line.x[sides[piece]].ravel(), z.ravel(), indexing="ij")
        along, _, up = sampled[:, piece].reshape(3, *x.shape)
        pieces.append(SectionField(x, heights, along, up))
    return pieces


def _mirrored(pieces: list[SectionField], length: float) -> list[SectionField]:
    """All pieces of a body, from its half at greater x. A piece that lies on the middle is made whole."""
    whole = list(pieces)
    for piece in pieces:
        x, z, along, up = (array[::-1] for array in (length - piece.x, piece.z, -piece.along, piece.up))
        if abs(piece.x[0, 0] - length / 2) < 1e-9 * length:
            whole.remove(piece)
            joined = (
                np.concatenate(pair) for pair in ((x, piece.x), (z, piece.z), (along, piece.along), (up, piece.up))
            )
            whole.insert(0, SectionField(*joined))
        else:
            whole.insert(0, SectionField(x, z, along, up))
    return whole


def _pressure(line: _Line, system: System, moved: Vector) -> tuple[Vector, Vector]:
    """The pressure whose work on every shape function of the face is that of the object's forces on it."""
    stack = system.stack
    body = stack.object.body
    faces = PlanElements(stack.basis, np.flatnonzero(stack.touching), 1)
    forces = np.zeros(stack.basis.N)
    np.add.at(forces, body.plan.nodes[body.plan.local], system.forces_below_object(moved))
    rows, columns = np.broadcast_arrays(faces.local[:, :, None], faces.local[:, None, :])
    mass = sparse.csc_array((faces.products[:, 2, 2].ravel(), (rows.ravel(), columns.ravel())))
    scale = 1 / np.sqrt(mass.diagonal())
    scaling = sparse.diags_array(scale)
    coefficients = scale * spsolve(sparse.csc_array(scaling @ mass @ scaling), scale * forces[faces.nodes])
    sides = np.flatnonzero(np.isin(line.elements, faces.elements))
    nodes = np.searchsorted(faces.nodes, line.names[sides])
    pressure = np.einsum("fqn,fn->fq", line.values[sides], coefficients[nodes])
    return line.x[sides].ravel(), pressure.ravel()
