"""Stiffness of one part of the solid model: a plan times a range of heights.

Shape functions are products of one in the plan and one along the height, both of degree p, so that every matrix
in space is a sum of Kronecker products of one in the plan and one along the height. The pressure is a
discontinuous polynomial of degree p - 1 (Qp/Pp-1): it is condensed element by element, and rubber does not lock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm, ElementLineP2, ElementLinePp, ElementQuad2, ElementQuadP, LinearForm, MeshLine

from instrument.models.solid_mesh import Plan

Vector = NDArray[np.float64]
Sparse = sparse.csr_array

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
        nodes: names in the whole plan of the n shape functions that do not vanish on the selection.
        integrals: of the shape functions.
        mass, xx, yy, yx, vx, vy: integrals of products of shape functions and their derivatives.
        pressure: by degree, triples (x derivative, y derivative, value) against orthonormal polynomials.
    """

    def __init__(self, basis: Any, elements: NDArray[np.intp], degree: int) -> None:
        part = basis.with_elements(elements) if len(elements) < basis.mesh.nelements else basis
        self.nodes = np.unique(basis.element_dofs[:, elements])
        pick = self.nodes

        def form(function: Any) -> Sparse:
            return sparse.csr_array(BilinearForm(function).assemble(part))[pick][:, pick]

        self.integrals = np.asarray(LinearForm(lambda v, w: v).assemble(part))[pick]
        self.mass = form(lambda u, v, w: u * v)
        self.xx = form(lambda u, v, w: u.grad[0] * v.grad[0])
        self.yy = form(lambda u, v, w: u.grad[1] * v.grad[1])
        self.yx = form(lambda u, v, w: u.grad[0] * v.grad[1])  # row: y derivative, column: x derivative
        self.vx = form(lambda u, v, w: u.grad[0] * v)
        self.vy = form(lambda u, v, w: u.grad[1] * v)
        self.pressure = _pressures(part, elements, pick, degree - 1)


def _pressures(part: Any, elements: NDArray[np.intp], pick: NDArray[np.intp], degree: int) -> list[tuple[Sparse, ...]]:
    x, weight = np.asarray(part.global_coordinates()), part.dx
    centre = (x * weight).sum(-1, keepdims=True) / weight.sum(-1)[None, :, None]
    size = np.sqrt(((x - centre) ** 2 * weight).sum(-1, keepdims=True) / weight.sum(-1)[None, :, None])
    a, b = (x - centre) / size
    # By rising degree, so that the first ones span every lower degree.
    monomials = np.stack([a ** (k - m) * b**m for k in range(degree + 1) for m in range(k + 1)], axis=-1)
    root = np.sqrt(weight)[..., None]
    orthonormal = np.moveaxis(np.linalg.qr(root * monomials)[0] / root, -1, 0)
    count = len(elements)
    columns = part.element_dofs if part.element_dofs.shape[1] == count else part.element_dofs[:, elements]
    shapes = [field[0] for field in part.basis]
    total = []
    for values in (
        np.stack([f.grad[0] for f in shapes]),
        np.stack([f.grad[1] for f in shapes]),
        np.stack([np.broadcast_to(np.asarray(f), weight.shape) for f in shapes]),
    ):
        data = np.einsum("aeq,neq,eq->aen", orthonormal, values, weight)
        rows = np.broadcast_to(np.arange(len(orthonormal) * count).reshape(-1, count, 1), data.shape)
        names = np.broadcast_to(columns.T[None], data.shape)
        entries = (data.ravel(), (rows.ravel(), names.ravel()))
        matrix = sparse.csr_array(entries, shape=(len(orthonormal) * count, part.N))
        total.append(sparse.csr_array(matrix[:, pick]))
    return [tuple(matrix[: count * (k + 1) * (k + 2) // 2] for matrix in total) for k in range(degree + 1)]


class HeightMatrices:
    """Matrices along the height: the first shape function alone reaches the bottom, the last the top."""

    def __init__(self, breaks: Vector, degree: int) -> None:
        basis = Basis(MeshLine(breaks), ElementLineP2() if degree == 2 else ElementLinePp(degree), intorder=2 * degree)
        steps = len(breaks) - 1
        order = np.concatenate([np.arange(steps), np.arange(steps + 1, basis.N), [steps]])
        self.count = basis.N

        def form(function: Any) -> Sparse:
            return sparse.csr_array(BilinearForm(function).assemble(basis))[order][:, order]

        self.mass = form(lambda u, v, w: u * v)
        self.zz = form(lambda u, v, w: u.grad[0] * v.grad[0])
        self.vz = form(lambda u, v, w: u.grad[0] * v)
        rank = np.argsort(order)
        z, weight = np.asarray(basis.global_coordinates())[0], basis.dx
        low, high = z.min(axis=1), z.max(axis=1)
        local = (2 * z - (low + high)[:, None]) / (high - low)[:, None]
        root = np.sqrt(weight)[..., None]
        powers = np.linalg.qr(root * local[..., None] ** np.arange(degree))[0] / root
        names = rank[basis.element_dofs]
        self.pressure: list[tuple[Sparse, Sparse]] = []
        for polynomial in np.moveaxis(powers, -1, 0):
            pair = []
            for shapes in (
                [np.asarray(field[0]) for field in basis.basis],
                [field[0].grad[0] for field in basis.basis],
            ):
                values = np.stack([np.broadcast_to(shape, weight.shape) for shape in shapes])
                data = np.einsum("eq,neq,eq->en", polynomial, values, weight)
                rows = np.broadcast_to(np.arange(steps)[:, None], data.shape)
                pair.append(sparse.csr_array((data.ravel(), (rows.ravel(), names.T.ravel())), shape=(steps, basis.N)))
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
        self.shape = (3, len(plan.nodes), height.count)
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
            dx, dy, flat = plan.pressure[-1 - level]
            rows.append(sparse.hstack([kron(dx, value), kron(dy, value), kron(flat, slope)]))
        self.dilatation = sparse.csr_array(sparse.vstack(rows))
        self.stiffness = sparse.csr_array(
            material.shear * shear + material.lame * (self.dilatation.T @ self.dilatation)
        )


def plan_basis(plan: Plan, degree: int) -> Any:
    """Shape functions of a plan."""
    return Basis(plan.mesh, ElementQuad2() if degree == 2 else ElementQuadP(degree), intorder=2 * degree + 2)
