"""Loads on the elements of the round sensor, and the forces, stresses and charges that follow from a solution."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.fields import OnMesh, on
from palpate.instrument.models.axisymmetric.mesh import Body, Grid
from palpate.instrument.models.axisymmetric.numbering import AXIAL, RADIAL, Part, within
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.condensed import Elements
from palpate.instrument.models.finite_elements.coupling import capacitance, charge
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]


def pressing(elements: Elements, r: el.Line, body: Part) -> Array:
    """Forces of 1 N, spread evenly over the top of the object, per radian: (elements, n)."""
    load = np.zeros(elements.unknowns.shape)
    top = on(load, body)[:, -1, AXIAL]
    # The first shape function is 1, so these are the integrals ∫ r φ.
    top[:, :, :2] -= r.value_value[body.columns][:, :, :1] / (math.pi * body.body.radii[1] ** 2)
    return load


def raising(elements: Elements, mesh: Grid, r: el.Line, parameters: RoundParameters, body: Part) -> Array:
    """Jump that raises a body by 1 from the tooth, or the tooth's film from the plate.

    The work of the load on this jump is the tooth's force.
    """
    nodal = np.zeros(elements.unknowns.shape)
    over = within(parameters.tooth_radius, mesh, r)[r.dofs[body.columns][:, :2]]
    on(nodal, body)[:, 0, AXIAL, :2, 0] = over
    return el.differences(nodal, np.zeros_like(nodal))


def charging(elements: Elements, r: el.Line, z: el.Line, film: Part) -> Array:
    """Forces (elements, n) of a film under 1 V, against its voltage, per radian."""
    assert film.body.film is not None
    low, high = film.body.heights
    _, stress, _ = film.body.film.stiff()
    forces = np.zeros(elements.unknowns.shape)
    plane, normal = stress[0] / (high - low), stress[2] / (high - low)
    forces[film.elements] = el.polarised(r, z, film.columns, film.rows, plane, normal)
    return forces


def counts_above(parameters: RoundParameters) -> bool:
    """Whether the tooth's force is taken above the tooth, not below.

    The softer side is more exact, since forces in a stiff section are differences of large displacements.
    """
    return parameters.support == "rigid" or parameters.sensed_modulus < parameters.film.modulus


def below(at: OnMesh, name: str) -> Array:
    """Forces (columns, 2) on the vertices below a body [N]."""
    return at.forces(name)[:, 0, AXIAL, :2, 0]


def over_tooth(at: OnMesh) -> float:
    """Force of the object on the tooth [N]."""
    vertices = at.r.dofs[at.parts["object"].columns][:, :2]
    return float(below(at, "object")[within(at.parameters.tooth_radius, at.mesh, at.r)[vertices]].sum())


def sinking(at: OnMesh) -> float:
    """Displacement of the object's top, averaged over the pressure on it [m]."""
    part = at.parts["object"]
    top = on(at.displacements, part)[:, -1, AXIAL, :, 1]
    # With hierarchical shape functions, 1 is the sum of the first two.
    weights = at.r.value_value[part.columns][:, :, 0]
    weights = np.concatenate([weights[:, :1] - weights[:, 1:2], weights[:, 1:]], axis=1)
    return float(-2 * (weights * top).sum() / part.body.radii[1] ** 2)


def stresses(at: OnMesh, body: Body) -> tuple[float, float]:
    """Mean stresses [Pa] in the plane and along the axis, by virtual work of the displacements r and z."""
    mesh, part, forces = at.mesh, at.parts[body.name], at.forces(body.name)
    radius = np.stack([mesh.radii[part.columns], mesh.radii[part.columns + 1]], axis=1)
    height = np.stack([mesh.heights[part.rows], mesh.heights[part.rows + 1]], axis=1) - body.heights[0]
    plane = np.einsum("xyab,xa->", forces[:, :, RADIAL, :2, :2], radius)
    normal = np.einsum("xyab,yb->", forces[:, :, AXIAL, :2, :2], height)
    return float(plane) / body.volume / 2, float(normal) / body.volume


def charge_of(at: OnMesh, body: Body) -> float:
    """Charge that leaves a short-circuited film [C]."""
    assert body.film is not None
    plane, normal = stresses(at, body)
    return charge(body.film, body.area, plane, plane, normal)


def capacitance_of(body: Body) -> float:
    """Capacitance of a film [F]."""
    assert body.film is not None
    return capacitance(body.film, body.area, body.heights[1] - body.heights[0])
