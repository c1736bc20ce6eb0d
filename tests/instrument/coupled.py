"""Round films in a round sensor, coupled as Appendix I has it: displacements and potential, a field through the film.

Beside which the shipped models are tested, which know one voltage for each film. Plain elements of degree two on the
same rectangles; a film's lower electrode is at zero, its upper one floats.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray
from skfem import Basis, BilinearForm, ElementQuad2, ElementVector, FacetBasis, LinearForm, MeshQuad

from palpate.instrument.models.axisymmetric.mesh import AxisymmetricBody, grid
from palpate.instrument.models.parameters import RoundParameters

Array = NDArray[np.float64]


def coupled(parameters: RoundParameters, layers: int) -> tuple[float, dict[str, float]]:
    """Force ratio, and the voltage of each film under 1 N [V]; a bonded object on an elastic support, an open gap."""
    cut = grid(parameters, layers)
    # Degree two has no use for steps as wide as ours away from the corners.
    full = MeshQuad.init_tensor(
        *(np.unique(np.concatenate([of, (of[1:] + of[:-1]) / 2])) for of in (cut.radii, cut.heights))
    )
    middle = full.p[:, full.t].mean(axis=1)
    bodies = [_inside(body, middle) for body in cut.bodies]
    kept = np.flatnonzero(np.any(bodies, axis=0))
    mesh = full.restrict(kept)
    body_of = np.array([np.flatnonzero([inside[element] for inside in bodies])[0] for element in kept])
    moved = Basis(mesh, ElementVector(ElementQuad2()), intorder=6)
    volts = moved.with_element(ElementQuad2())
    films = [k for k, body in enumerate(cut.bodies) if body.film is not None]
    stiff = [_stiffness(body) for body in cut.bodies]

    def strain(u: Any, w: Any) -> Array:
        return np.stack([u.grad[0, 0], u[0] / w.x[0], u.grad[1, 1], u.grad[0, 1] + u.grad[1, 0]])

    def of_element(values: list[Array]) -> Array:
        return np.moveaxis(np.array(values)[body_of], 0, -1)[..., None]

    c = of_element(stiff)
    elastic = BilinearForm(
        lambda u, v, w: w.x[0] * np.einsum("ijeq,ieq,jeq->eq", c + 0 * w.x[0], strain(v, w), strain(u, w))
    ).assemble(moved)
    size, nodes = moved.N, volts.N
    permittivity = of_element([np.array(b.film.stiff()[2] if b.film else 0.0) for b in cut.bodies])
    piezo = of_element([_piezo(b) for b in cut.bodies])
    field = BilinearForm(
        lambda p, q, w: w.x[0] * permittivity * (p.grad[0] * q.grad[0] + p.grad[1] * q.grad[1])
    ).assemble(volts)
    cross = BilinearForm(
        lambda p, v, w: w.x[0] * np.einsum("ieq,ieq,eq->eq", piezo + 0 * w.x[0], strain(v, w), p.grad[1])
    ).assemble(volts, moved)
    matrix = scipy.sparse.block_array([[elastic, cross], [cross.T, -field]]).tocsc()

    top = mesh.facets_satisfying(lambda x: np.abs(x[1] - cut.heights[-1]) < 1e-12)
    pressure = 1 / (math.pi * parameters.sensed_radius**2)
    load = np.zeros(size + nodes)
    face = FacetBasis(mesh, moved.elem, facets=top, intorder=6)
    load[:size] = LinearForm(lambda v, w: -pressure * w.x[0] * v[1]).assemble(face)

    radius, height = moved.doflocs
    axial = np.zeros(size, dtype=bool)
    for dofs in (moved.nodal_dofs, moved.facet_dofs, moved.interior_dofs):
        axial[dofs[1]] = True
    fixed = np.concatenate([(height < 1e-12) | (~axial & (radius < 1e-12)), np.ones(nodes, dtype=bool)])
    # One unknown for each floating electrode: all its nodes have its potential.
    columns = np.full(size + nodes, -1)
    at_z = volts.doflocs[1]
    for place, k in enumerate(films):
        low, high = cut.bodies[k].heights
        own = np.unique(volts.element_dofs[:, body_of == k])
        inside = own[(at_z[own] > low + 1e-12)]
        fixed[size + inside] = False
        columns[size + inside[np.abs(at_z[inside] - high) < 1e-12]] = place
    floating = columns >= 0
    free = np.flatnonzero(~fixed & ~floating)
    rows = np.concatenate([free, np.flatnonzero(floating)])
    unknown = np.concatenate([np.arange(len(free)), len(free) + columns[floating]])
    carry = scipy.sparse.coo_array(
        (np.ones(len(rows)), (rows, unknown)), shape=(size + nodes, len(free) + len(films))
    ).tocsc()
    reduced, right = (carry.T @ matrix @ carry).tocsc(), carry.T @ load
    # Farads beside newtons per metre: a choice of units.
    scale = 1 / np.sqrt(np.abs(reduced.diagonal()))
    answer = scale * scipy.sparse.linalg.spsolve(
        scipy.sparse.diags_array(scale) @ reduced @ scipy.sparse.diags_array(scale), scale * right
    )
    solution = carry @ answer
    voltages = {cut.bodies[k].name: float(answer[len(free) + place]) for place, k in enumerate(films)}

    # What the sensor's floor carries below the tooth's film is the rest of what the ring brings down.
    ring = _inside(next(body for body in cut.bodies if body.name == "ring"), middle)[kept]
    alone = moved.with_elements(np.flatnonzero(ring))
    held = BilinearForm(
        lambda u, v, w: w.x[0] * np.einsum("ijeq,ieq,jeq->eq", c[:, :, ring] + 0 * w.x[0], strain(v, w), strain(u, w))
    ).assemble(alone)
    below = axial & (np.abs(height - cut.base) < 1e-12)
    return 1 - 2 * math.pi * float((held @ solution[:size])[below].sum()), voltages


def _inside(body: AxisymmetricBody, middle: Array) -> NDArray[np.bool_]:
    (inner, outer), (low, high) = body.radii, body.heights
    found: NDArray[np.bool_] = (middle[0] > inner) & (middle[0] < outer) & (middle[1] > low) & (middle[1] < high)
    return found


def _stiffness(body: AxisymmetricBody) -> Array:
    """The stiffness, in the order of strains along radius, circumference and axis, and of shear."""
    stiffness = np.zeros((4, 4))
    if body.film is not None:
        stiffness[:3, :3], stiffness[3, 3] = body.film.stiff()[0], body.film.shear[0]
    else:
        stiffness[:3, :3] = 2 * body.shear * body.poisson / (1 - 2 * body.poisson)
        stiffness += np.diag([2 * body.shear] * 3 + [body.shear])
    return stiffness


def _piezo(body: AxisymmetricBody) -> Array:
    return np.append(body.film.stiff()[1], 0.0) if body.film is not None else np.zeros(4)
