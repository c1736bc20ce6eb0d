"""Element matrices of one part of the solid model: a plan times a range of heights.

Shape functions are products of one of degree p in the plan and one of degree q along the height, so that every element
matrix is a sum of products of one in the plan and one along the height. The pressure is a discontinuous polynomial of
degree p - 1 (Qp/Pp-1), and of degree q - 1 along the height alone: it is condensed element by element, and rubber does
not lock.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementLineP2, ElementLinePp, ElementQuad2, ElementQuadP, MeshLine

from palpate.instrument.models.solid.mesh import Plan
from palpate.instrument.sensor.film_material import FilmMaterial

Vector = NDArray[np.float64]
Names = NDArray[np.intp]
Entries = TypeVar("Entries", NDArray[np.float64], NDArray[np.intp])

# Least G / λ that element matrices bear without rounding errors that count; below it, results are extrapolated.
LEAST_COMPLIANCE = 3e-3


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
    def step(self) -> float:
        """Addition to 1/λ by which element matrices bear it [1/Pa]; 0 where they do already."""
        least = LEAST_COMPLIANCE / self.shear
        return least if 0 <= self.compliance < least else 0.0


class PlanElements:
    """Integrals over some of the plan's elements.

    Attributes:
        elements: numbers of these elements in the whole plan.
        nodes: names in the whole plan of the shape functions that do not vanish on these elements.
        local: (elements, shapes), places of each element's shape functions in `nodes`.
        integrals: integral of each shape function over these elements.
        areas: areas of the elements [m2].
        mass, xx, yy, yx, vx, vy: (elements, shapes, shapes), integrals of products of shape functions and their
            derivatives.
        pressure: integrals of x derivative, y derivative and value of shape functions times orthonormal polynomials, by
            the degree of these; each (elements, polynomials, shapes).
    """

    def __init__(self, basis: Any, elements: Names, degree: int) -> None:
        part = basis.with_elements(elements)
        self.elements = elements
        names = basis.element_dofs[:, elements].T
        self.nodes, local = np.unique(names, return_inverse=True)
        self.local = local.reshape(names.shape)
        weight = part.dx
        shapes = [field[0] for field in part.basis]
        v = np.stack([np.broadcast_to(np.asarray(shape), weight.shape) for shape in shapes], axis=1)
        x, y = (np.stack([shape.grad[axis] for shape in shapes], axis=1) for axis in (0, 1))

        def product(test: Vector, trial: Vector) -> Vector:
            result: Vector = (test * weight[:, None]) @ trial.transpose(0, 2, 1)
            return result

        self.areas = weight.sum(axis=1)
        self.integrals = np.bincount(self.local.ravel(), weights=(v @ weight[..., None]).ravel())
        self.mass, self.xx, self.yy, self.yx = product(v, v), product(x, x), product(y, y), product(y, x)
        self.vx, self.vy = product(v, x), product(v, y)
        self.pressure = []
        for count in np.cumsum(np.arange(1, degree + 1)):
            polynomials = _orthonormal(np.asarray(part.global_coordinates()), weight, degree - 1)[:, :count]
            self.pressure.append((product(polynomials, x), product(polynomials, y), product(polynomials, v)))


def _orthonormal(places: Vector, weight: Vector, degree: int) -> Vector:
    """Polynomials (elements, polynomials, points) at the quadrature points, orthonormal on each element."""
    area = weight.sum(axis=-1)[:, None]
    centre = (places * weight).sum(axis=-1, keepdims=True) / area
    size = np.sqrt(((places - centre) ** 2 * weight).sum(axis=-1, keepdims=True) / area)
    a, b = (places - centre) / size
    # The degree rises, so that the first polynomials span every lower degree.
    monomials = np.stack([a ** (k - m) * b**m for k in range(degree + 1) for m in range(k + 1)], axis=-1)
    root = np.sqrt(weight)[..., None]
    polynomials: Vector = np.moveaxis(np.linalg.qr(root * monomials)[0] / root, -1, 1)
    return polynomials


class HeightElements:
    """Integrals over each step along the height.

    Only the first shape function is not zero at the bottom, and only the last one at the top.

    Attributes:
        breaks: heights between the steps [m].
        degree: degree of the shape functions.
        count: number of shape functions.
        local: (steps, shapes), names of each step's shape functions.
        one, places: coefficients of the function 1 and of the height [m].
        mass, zz, zv: (steps, shapes, shapes), integrals of products of shape functions and their derivatives.
        pressure: (degree, steps, shapes), integrals of value and slope of shape functions times Legendre polynomials.
    """

    def __init__(self, breaks: Vector, degree: int) -> None:
        basis = height_basis(breaks, degree)
        steps = len(breaks) - 1
        order = np.concatenate([np.arange(steps), np.arange(steps + 1, basis.N), [steps]])
        self.breaks, self.degree = breaks, degree
        self.count = basis.N
        self.local = np.argsort(order)[basis.element_dofs].T
        # Hierarchical shape functions add nothing at the ends.
        self.one = np.where((order <= steps) | (degree == 2), 1.0, 0.0)
        self.places = np.where(self.one == 1, basis.doflocs[0][order], 0.0)
        weight = basis.dx
        v = np.stack([np.broadcast_to(np.asarray(field[0]), weight.shape) for field in basis.basis], axis=1)
        z = np.stack([field[0].grad[0] for field in basis.basis], axis=1)

        def product(test: Vector, trial: Vector) -> Vector:
            result: Vector = (test * weight[:, None]) @ trial.transpose(0, 2, 1)
            return result

        self.mass, self.zz, self.zv = product(v, v), product(z, z), product(z, v)
        places = np.asarray(basis.global_coordinates())[0]
        middle, half = (breaks[1:] + breaks[:-1])[:, None] / 2, np.diff(breaks)[:, None] / 2
        levels = np.arange(degree)[:, None, None]
        legendre = np.polynomial.legendre.legvander((places - middle) / half, degree - 1).transpose(2, 0, 1)
        legendre = legendre * np.sqrt((2 * levels + 1) / (2 * half))
        pairs = [(product(level[:, None], v), product(level[:, None], z)) for level in legendre]
        self.pressure = [(value[:, 0], slope[:, 0]) for value, slope in pairs]


class Body:
    """One part: a plan, a range of heights, and a material.

    Its elements are numbered along the height first, then along the plan. Element matrices have the unknowns
    displacement (x, y, z), then height, then node of the plan.
    """

    def __init__(self, plan: PlanElements, height: HeightElements, material: Elastic | FilmMaterial) -> None:
        self.plan, self.height, self.material = plan, height, material
        self.shape = (3, height.count, len(plan.nodes))

    @property
    def count(self) -> int:
        """Number of elements."""
        return len(self.plan.local) * len(self.height.local)

    def local(self, names: Entries, elements: Names | None = None) -> Entries:
        """Entries (elements, unknowns) of `names`, which has the body's shape, that belong to each element."""
        plan, step = self._places(elements)
        heights, nodes = self.height.local[step], self.plan.local[plan]
        picked = names[:, heights[:, :, None], nodes[:, None, :]]
        return np.moveaxis(picked, 0, 1).reshape(len(plan), 3 * heights.shape[1] * nodes.shape[1])

    def _places(self, elements: Names | None) -> tuple[Names, Names]:
        """Place in the plan and step along the height of some elements; None: of all."""
        numbers = np.arange(self.count) if elements is None else elements
        plan, step = np.divmod(numbers, len(self.height.local))
        return plan, step

    def stiffness(self, elements: Names | None = None, added: float = 0.0) -> Vector:
        """Stiffness (elements, unknowns, unknowns) of some elements; None: of all.

        Args:
            elements: numbers of the elements.
            added: addition to the material's 1/λ [1/Pa].
        """
        if isinstance(self.material, FilmMaterial):
            return self._film_stiffness(self.material, elements)
        p, h = self.plan, self.height
        plan, step = self._places(elements)
        shear = self.material.shear
        mass, zz, zv = (matrix[step] for matrix in (h.mass, h.zz, h.zv))
        xx, yy, flat, yx, vx, vy = (shear * matrix[plan] for matrix in (p.xx, p.yy, p.mass, p.yx, p.vx, p.vy))
        dilatation = self.dilatation(elements)
        matrix = dilatation.transpose(0, 2, 1) @ (dilatation / (self.material.compliance + added))
        _add(
            matrix,
            {
                (0, 0): [(2 * xx + yy, mass), (flat, zz)],
                (1, 1): [(xx + 2 * yy, mass), (flat, zz)],
                (2, 2): [(xx + yy, mass), (2 * flat, zz)],
                (0, 1): [(yx, mass)],
                (0, 2): [(vx, zv)],
                (1, 2): [(vy, zv)],
            },
        )
        return matrix

    def _film_stiffness(self, film: FilmMaterial, elements: Names | None) -> Vector:
        """Stiffness of a film: a material with three planes of symmetry, thin, and far from incompressible."""
        p, h = self.plan, self.height
        plan, step = self._places(elements)
        (c, _, _), (c44, c55, c66) = film.stiff(), film.shear
        mass, zz, zv = (matrix[step] for matrix in (h.mass, h.zz, h.zv))
        xx, yy, flat, yx, vx, vy = (matrix[plan] for matrix in (p.xx, p.yy, p.mass, p.yx, p.vx, p.vy))
        vz, xy, xv, yv = (matrix.swapaxes(1, 2) for matrix in (zv, yx, vx, vy))
        size = 3 * mass.shape[1] * flat.shape[1]
        matrix = np.zeros((len(plan), size, size))
        _add(
            matrix,
            {
                (0, 0): [(c[0, 0] * xx + c66 * yy, mass), (c55 * flat, zz)],
                (1, 1): [(c66 * xx + c[1, 1] * yy, mass), (c44 * flat, zz)],
                (2, 2): [(c55 * xx + c44 * yy, mass), (c[2, 2] * flat, zz)],
                (0, 1): [(c[0, 1] * xy + c66 * yx, mass)],
                (0, 2): [(c[0, 2] * xv, vz), (c55 * vx, zv)],
                (1, 2): [(c[1, 2] * yv, vz), (c44 * vy, zv)],
            },
        )
        return matrix

    def polarised(self, film: FilmMaterial, one: Vector) -> Vector:
        """Forces (elements, unknowns) of a film under 1 V, against its voltage [N/V].

        Args:
            film: material of the film.
            one: coefficients of the function 1 in the plan, by node of the body.
        """
        p, h = self.plan, self.height
        _, stress, _ = film.stiff()
        along, across, flat = (np.einsum("eij,ei->ej", of, one[p.local]) for of in (p.vx, p.vy, p.mass))
        mass, slope = (np.einsum("sij,sj->si", of, h.one[h.local]) for of in (h.mass, h.zv))
        pairs = ((along, mass), (across, mass), (flat, slope))
        forces = [e * np.einsum("en,sh->eshn", *pair) for e, pair in zip(stress, pairs, strict=True)]
        by_axis: Vector = np.stack(forces, axis=2) / np.ptp(h.breaks)
        return by_axis.reshape(self.count, -1)

    def dilatation(self, elements: Names | None = None) -> Vector:
        """Operator (elements, pressures, unknowns) from unknowns to orthonormal dilatations."""
        plan, step = self._places(elements)
        rows = []
        for level, (value, slope) in enumerate(self.height.pressure):
            triple = self.plan.pressure[max(len(self.plan.pressure) - 1 - level, 0)]
            value, slope = (matrix[step][:, None, :, None] for matrix in (value, slope))
            dx, dy, flat = (matrix[plan][:, :, None, :] for matrix in triple)
            rows.append(np.stack([dx * value, dy * value, flat * slope], axis=2))
        joined = np.concatenate(rows, axis=1)
        return joined.reshape(*joined.shape[:2], -1)


def _add(matrix: Vector, blocks: dict[tuple[int, int], list[tuple[Vector, Vector]]]) -> None:
    """Add products of a matrix in the plan and one along the height to symmetric matrices (elements, n, n).

    They are given by the axes of their unknowns. Blocks below the diagonal are the transposes of those above it.
    """
    of_plan, of_height = next(iter(blocks.values()))[0]
    heights, nodes = of_height.shape[1], of_plan.shape[1]
    by_axis = matrix.reshape(-1, 3, heights, nodes, 3, heights, nodes)
    for (a, b), pairs in blocks.items():
        products = [flat[:, None, :, None, :] * upright[:, :, None, :, None] for flat, upright in pairs]
        product = products[0] if len(products) == 1 else products[0] + products[1]
        by_axis[:, a, :, :, b] += product
        if a != b:
            by_axis[:, b, :, :, a] += product.transpose(0, 3, 4, 1, 2)


def plan_basis(plan: Plan, degree: int) -> Any:
    """Shape functions of a plan, of a degree."""
    return Basis(plan.mesh, ElementQuad2() if degree == 2 else ElementQuadP(degree), intorder=2 * degree + 2)


def height_basis(breaks: Vector, degree: int, points: Vector | None = None) -> Any:
    """Shape functions along the height, at given points of each step (0 to 1), or at those of an exact quadrature."""
    element = ElementLineP2() if degree == 2 else ElementLinePp(degree)
    if points is None:
        return Basis(MeshLine(breaks), element, intorder=2 * degree)
    return Basis(MeshLine(breaks), element, quadrature=(points[None], np.full(len(points), 1 / len(points))))
