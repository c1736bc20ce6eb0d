"""Stiffness of one part of the solid model: a plan times a range of heights.

Shape functions are products of a biquadratic one in the plan and a quadratic one along the height, so that
every matrix in space is a sum of Kronecker products of one in the plan and one along the height. The pressure
is linear and discontinuous (Q2/P1): it is condensed element by element, and rubber does not lock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm, ElementLineP2, ElementQuad2, MeshLine

from instrument.models.solid_mesh import Plan

Vector = NDArray[np.float64]
Sparse = sparse.csr_array

QUADRATURE = 5
# 2 G e + λ tr e is assembled with λ / G up to this; what is above it comes by iteration on the pressure.
LAME_RATIO_LIMIT = 1000.0


@dataclass(frozen=True, slots=True)
class Elastic:
    """Young modulus [Pa] and Poisson ratio, up to 0.5."""

    modulus: float
    poisson: float

    @property
    def shear(self) -> float:
        """Shear modulus G [Pa]."""
        return self.modulus / (2 * (1 + self.poisson))

    @property
    def compliance(self) -> float:
        """1/λ [1/Pa], 0 for an incompressible body, ∞ at Poisson ratio 0."""
        if self.poisson == 0:
            return np.inf
        return (1 + self.poisson) * (1 - 2 * self.poisson) / (self.modulus * self.poisson)

    @property
    def lame(self) -> float:
        """λ [Pa] that the matrix carries."""
        limit = LAME_RATIO_LIMIT * self.shear
        if self.poisson <= 0 or self.compliance > 1 / limit:
            return 1 / self.compliance
        return limit

    @property
    def pressure_left(self) -> float:
        """Share of the pressure that the matrix does not carry: 0 where λ is not limited."""
        return 1 - self.lame * self.compliance if np.isfinite(self.compliance) else 0.0


class PlanMatrices:
    """Matrices in the plan on a selection of its elements, over the nodes of that selection.

    Attributes:
        nodes: names of the nodes in the whole plan, shape (n,).
        places: shape (2, n).
        mass, forms: integrals of products of shape functions and their derivatives.
        pressure: by degree 0 and 1, triples (x derivative, y derivative, value) against orthonormal pressures.
    """

    def __init__(self, basis: Any, elements: NDArray[np.intp]) -> None:
        part = basis.with_elements(elements) if len(elements) < basis.mesh.nelements else basis
        self.nodes = np.unique(basis.element_dofs[:, elements])
        self.places = basis.doflocs[:, self.nodes]
        pick = self.nodes

        def form(function: Any) -> Sparse:
            return sparse.csr_array(BilinearForm(function).assemble(part))[pick][:, pick]

        self.mass = form(lambda u, v, w: u * v)
        self.xx = form(lambda u, v, w: u.grad[0] * v.grad[0])
        self.yy = form(lambda u, v, w: u.grad[1] * v.grad[1])
        self.yx = form(lambda u, v, w: u.grad[0] * v.grad[1])  # row: y derivative, column: x derivative
        self.vx = form(lambda u, v, w: u.grad[0] * v)
        self.vy = form(lambda u, v, w: u.grad[1] * v)
        self.pressure = _pressures(part, elements, pick)


def _pressures(part: Any, elements: NDArray[np.intp], pick: NDArray[np.intp]) -> list[tuple[Sparse, ...]]:
    x = part.global_coordinates().value
    weight = part.dx
    centre = (x * weight).sum(-1, keepdims=True) / weight.sum(-1)[None, :, None]
    raw = np.stack([np.ones_like(weight), *(x - centre)])
    gram = np.einsum("aeq,beq,eq->eab", raw, raw, weight)
    orthonormal = np.einsum("eab,beq->aeq", np.linalg.inv(np.linalg.cholesky(gram)), raw)
    count = len(elements)
    columns = part.element_dofs if part.element_dofs.shape[1] == count else part.element_dofs[:, elements]
    shapes = [field[0] for field in part.basis]
    total = []
    for values in (
        np.stack([f.grad[0] for f in shapes]),
        np.stack([f.grad[1] for f in shapes]),
        np.stack([np.broadcast_to(f.value, weight.shape) for f in shapes]),
    ):
        data = np.einsum("aeq,neq,eq->aen", orthonormal, values, weight)
        rows = np.broadcast_to(np.arange(3 * count).reshape(3, count, 1), data.shape)
        names = np.broadcast_to(columns.T[None], data.shape)
        matrix = sparse.csr_array((data.ravel(), (rows.ravel(), names.ravel())), shape=(3 * count, part.N))
        total.append(sparse.csr_array(matrix[:, pick]))
    return [tuple(matrix[: count * size] for matrix in total) for size in (1, 3)]


class HeightMatrices:
    """Matrices along the height, nodes from the lowest to the highest.

    Attributes:
        places: shape (n,) [m].
    """

    def __init__(self, breaks: Vector) -> None:
        basis = Basis(MeshLine(breaks), ElementLineP2(), intorder=4)
        order = np.argsort(basis.doflocs[0])
        self.places = basis.doflocs[0][order]

        def form(function: Any) -> Sparse:
            return sparse.csr_array(BilinearForm(function).assemble(basis))[order][:, order]

        self.mass = form(lambda u, v, w: u * v)
        self.zz = form(lambda u, v, w: u.grad[0] * v.grad[0])
        self.vz = form(lambda u, v, w: u.grad[0] * v)
        rank = np.argsort(order)
        length = np.diff(breaks)
        middle = ((breaks[1:] + breaks[:-1]) / 2)[:, None]
        z = basis.global_coordinates().value[0]
        by_element = np.argsort(z[:, 0])
        z, weight = z[by_element], basis.dx[by_element]
        legendre = [
            np.ones_like(z) / np.sqrt(length)[:, None],
            np.sqrt(12 / length**3)[:, None] * (z - middle),
        ]
        names = rank[basis.element_dofs[:, by_element]]
        self.pressure: list[tuple[Sparse, Sparse]] = []
        for polynomial in legendre:
            pair = []
            for which in ("value", "grad"):
                shapes = [field[0].value if which == "value" else field[0].grad[0] for field in basis.basis]
                values = np.stack([np.broadcast_to(shape, basis.dx.shape)[by_element] for shape in shapes])
                data = np.einsum("eq,neq,eq->en", polynomial, values, weight)
                rows = np.broadcast_to(np.arange(len(length))[:, None], data.shape)
                pair.append(
                    sparse.csr_array((data.ravel(), (rows.ravel(), names.T.ravel())), shape=(len(length), basis.N))
                )
            self.pressure.append((pair[0], pair[1]))


class Body:
    """One part: stiffness matrix and the operator from displacements to its orthonormal dilatations.

    The unknowns run over displacement (x, y, z), then node of the plan, then height.

    Attributes:
        stiffness: shape (3 n, 3 n), sparse.
        dilatation: shape (pressures, 3 n), sparse.
    """

    def __init__(self, plan: PlanMatrices, height: HeightMatrices, material: Elastic) -> None:
        self.plan, self.height, self.material = plan, height, material
        self.shape = (3, len(plan.nodes), len(height.places))
        kron = sparse.kron
        xx, yy, zz = kron(plan.xx, height.mass), kron(plan.yy, height.mass), kron(plan.mass, height.zz)
        xy = kron(plan.yx, height.mass)
        xz = kron(plan.vx, height.vz.T)
        yz = kron(plan.vy, height.vz.T)
        shear = sparse.block_array(
            [[2 * xx + yy + zz, xy, xz], [xy.T, xx + 2 * yy + zz, yz], [xz.T, yz.T, xx + yy + 2 * zz]], format="csr"
        )
        rows = []
        for level, (value, slope) in enumerate(height.pressure):
            dx, dy, flat = plan.pressure[1 - level]
            rows.append(sparse.hstack([kron(dx, value), kron(dy, value), kron(flat, slope)]))
        self.dilatation = sparse.csr_array(sparse.vstack(rows))
        self.stiffness = sparse.csr_array(
            material.shear * shear + material.lame * (self.dilatation.T @ self.dilatation)
        )


def plan_basis(plan: Plan) -> Any:
    """Biquadratic shape functions of a plan."""
    return Basis(plan.mesh, ElementQuad2(), intorder=QUADRATURE)
