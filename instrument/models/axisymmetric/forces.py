"""Loads on the elements of the round sensor, and the forces, stresses and charges that follow from a solution."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.bodies import constants
from palpate.instrument.models.axisymmetric.fields import OnMesh
from palpate.instrument.models.axisymmetric.mesh import Body
from palpate.instrument.models.axisymmetric.numbering import AXIAL, RADIAL, Part, within
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.coupling import capacitance, charge
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]


def pressing(r: el.Line, part: Part) -> Array:
    """Forces of 1 N, spread evenly over the top of the object, per radian: (elements of the object, n)."""
    shapes = r.dofs.shape[1]
    load = np.zeros((len(part.columns), len(part.rows), 2, shapes, shapes))
    # The first shape function is 1, so these are the integrals ∫ r φ.
    load[:, -1, AXIAL, :, :2] -= r.value_value[part.columns][:, :, :1] / (math.pi * part.body.radii[1] ** 2)
    return load.reshape(len(part), -1)


def charging(r: el.Line, z: el.Line, part: Part) -> Array:
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


def below(at: OnMesh, name: str) -> Array:
    """Forces (columns, 2) on the vertices below a body [N]."""
    return at.forces(name)[:, 0, AXIAL, :2, 0]


def over_tooth(at: OnMesh) -> float:
    """Force of the object on the tooth [N]."""
    vertices = at.r.dofs[at.parts["object"].columns][:, :2]
    return float(below(at, "object")[within(at.parameters.tooth_radius, at.mesh, at.r)[vertices]].sum())


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


def stressing(r: el.Line, z: el.Line, part: Part) -> tuple[Array, Array]:
    """Forces (elements of the film, n) per radian whose work is what strains add to the film's mean stresses.

    These are the stress in the plane and that along the axis.
    """
    c, volume = constants(part.body, mixed=False), part.body.volume
    plane = el.polarised(r, z, part.columns, part.rows, (c.c11 + c.c12) / 2 / volume, c.c13 / volume)
    return plane, el.polarised(r, z, part.columns, part.rows, c.c13 / volume, c.c33 / volume)


def stress_by_voltage(body: Body) -> tuple[float, float]:
    """What 1 V across a film adds to its mean stresses in the plane and along the axis [Pa/V]."""
    assert body.film is not None
    _, stress, _ = body.film.stiff()
    thickness = body.heights[1] - body.heights[0]
    return float(stress[0]) / thickness, float(stress[2]) / thickness
