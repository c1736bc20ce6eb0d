"""Element matrices of axisymmetric elasticity on a grid of rectangles, for all rectangles at once.

On a rectangle every integral is a sum of products of an integral over the radius and one over the height,
so forms are integrated on two lines only, and the element matrices are Kronecker products of theirs.
Nodes have hierarchical shape functions in both directions, degree p.
In element matrices the constant 1 replaces the first shape function, so that the first unknown is a value and the
second a difference. A foil of 10 µm that rides on rubber moves 1e8 times its strain: its stiffness times nodal values
would be a difference of numbers that are larger than itself by as much.

Displacement-pressure form: the dilatation is projected on discontinuous polynomials of degree p - 2 (pair
Q_p x Q_(p-2), stable on anisotropic and geometrically graded meshes: Schötzau, Schwab and Stenberg 1999).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from palpate.instrument.arrays import Floats, Indices


@dataclass(frozen=True, slots=True)
class LineIntegrals:
    """Integrals over the intervals of one line, with 1 for the first shape function: (intervals, p + 1, p + 1).

    Rows belong to the first factor named, columns to the second: φ shape function, d its derivative, w the
    weight (r over the radius, 1 over the height). `dilatation` and `value` are ∫ q (wφ)' and ∫ q wφ with q
    orthonormal under w, of shape (intervals, p - 1, p + 1).
    """

    dofs: Indices
    positions: Floats
    value_value: Floats
    slope_slope: Floats
    slope_value: Floats
    hoop: Floats
    dilatation_dilatation: Floats
    dilatation_value: Floats
    dilatation: Floats
    value: Floats


@dataclass(frozen=True, slots=True)
class Constants:
    """Stiffness [Pa] of a material that is the same all around the axis, which is direction 3."""

    c11: float
    c12: float
    c13: float
    c33: float
    c44: float

    @classmethod
    def isotropic(cls, shear: float, lame: float) -> Self:
        """Constants of an isotropic material with shear modulus G and full modulus λ of the dilatation [Pa]."""
        return cls(2 * shear + lame, lame, lame, 2 * shear + lame, shear)


def line(points: Floats, degree: int, radial: bool) -> LineIntegrals:
    """Integrals on a line with grid lines `points` [m], weighted with the radius if `radial`."""
    gauss, weights, shapes, derivatives, tests = _reference(degree)
    count, width = len(points) - 1, np.diff(points)[:, None, None]
    slopes = derivatives / width
    radius = points[:-1, None, None] + width * gauss if radial else np.ones((1, 1, 1))
    weight = radius * width * weights
    hoop = shapes / radius if radial else np.zeros((1, *shapes.shape))
    dilatation = slopes + hoop
    # Shape functions of the grid lines have the first numbers, those inside intervals follow.
    first = np.arange(count)[:, None]
    inner = count + 1 + first * (degree - 1) + np.arange(degree - 1)

    def integrals(one: Floats, other: Floats) -> Floats:
        matrices: Floats = (weight * one) @ np.swapaxes(other, -1, -2)
        return matrices

    orthonormal = np.linalg.inv(np.linalg.cholesky(integrals(tests, tests))) @ tests
    return LineIntegrals(
        dofs=np.concatenate([first, first + 1, inner], axis=1).astype(np.intp, copy=False),
        positions=points,
        value_value=integrals(shapes, shapes),
        slope_slope=integrals(slopes, slopes),
        slope_value=integrals(slopes, shapes),
        hoop=integrals(hoop, hoop),
        dilatation_dilatation=integrals(dilatation, dilatation),
        dilatation_value=integrals(dilatation, shapes),
        dilatation=integrals(orthonormal, dilatation),
        value=integrals(orthonormal, shapes),
    )


@functools.cache
def _reference(degree: int) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Gauss points and weights on [0, 1], values and slopes of the shape functions there, values of the pressure's.

    The constant 1 replaces the first shape function. scikit-fem's `Basis` would compute these anew for each line, which
    took longer than all integrals.
    """
    # The hoop term is divided by the radius: it is no polynomial, and steep where an element is many radii wide.
    gauss, weights = np.polynomial.legendre.leggauss(degree + 13)
    gauss = (gauss + 1) / 2
    shapes, slopes = shape_functions(degree, gauss)
    # 1 is the sum of the first two shape functions: their slopes cancel exactly.
    slopes[0] += slopes[1]
    shapes[0] = 1
    tests = np.polynomial.legendre.legvander(2 * gauss - 1, degree - 2).T.astype(np.float64)
    return gauss, weights / 2, shapes, slopes, tests


def product(radial: Floats, axial: Floats) -> Floats:
    """Kronecker products (n_r, n_z, rows, columns) of all radial with all axial matrices."""
    products: Floats = spread(radial, axial)[:, None] * tiled(axial, radial)
    return products


def spread(matrices: Floats, others: Floats) -> Floats:
    """First factor of a Kronecker product with matrices of the others' shape, as large as the product."""
    _, rows, columns = others.shape
    return matrices.repeat(rows, 1).repeat(columns, 2)


def tiled(matrices: Floats, others: Floats) -> Floats:
    """Second factor of a Kronecker product, as large as the product."""
    return np.tile(matrices, (1, *others.shape[1:]))


class Stiffness:
    """Stiffness of elements on the grid of two lines, per radian.

    Unknowns of an element: radial displacement, then axial, each with the axial shape function running
    fastest; `differences` gives them.
    """

    def __init__(self, r: LineIntegrals, z: LineIntegrals) -> None:
        # These are computed once for all bodies: on coarse grids they take longer than the products.
        radial = [r.slope_slope + r.hoop, r.value_value, r.slope_slope, r.slope_value.transpose(0, 2, 1)]
        radial += [r.dilatation_dilatation, r.dilatation_value]
        axial = [z.value_value, z.slope_slope, z.slope_value, z.slope_value.transpose(0, 2, 1)]
        self._radial = [spread(factor, z.value_value)[:, None] for factor in radial]
        self._axial = [tiled(factor, r.value_value) for factor in axial]

    def __call__(self, columns: Indices, rows: Indices, of: Constants, out: Floats) -> Floats:
        """Stiffness (elements, 2 (p + 1)^2, 2 (p + 1)^2) of the elements in `columns` x `rows`, in `out`."""
        hoop_slope, value, slope, value_slope, dilatation, dilatation_value = (part[columns] for part in self._radial)
        z_value, z_slope, z_slope_value, z_value_slope = (part[rows] for part in self._axial)
        count = z_value.shape[1]
        matrices = out.reshape(len(columns), len(rows), 2, count, 2, count)
        rr, rz, zr, zz = (matrices[:, :, i, :, j] for i in (0, 1) for j in (0, 1))
        np.multiply((of.c11 - of.c12) * hoop_slope + of.c12 * dilatation, z_value, out=rr)
        rr += of.c44 * value * z_slope
        np.multiply(of.c33 * value, z_slope, out=zz)
        zz += of.c44 * slope * z_value
        np.multiply(of.c44 * value_slope, z_slope_value, out=rz)
        if of.c13:
            rz += of.c13 * dilatation_value * z_value_slope
        zr[:] = rz.swapaxes(2, 3)
        return out


def dilatation(r: LineIntegrals, z: LineIntegrals, columns: Indices, rows: Indices) -> Floats:
    """Projected dilatation (elements, (p - 1)^2, 2 (p + 1)^2) of the elements in `columns` x `rows`."""
    pairs = product(r.dilatation[columns], z.value[rows]), product(r.value[columns], z.dilatation[rows])
    both = np.concatenate(pairs, axis=3)
    return both.reshape(-1, *both.shape[2:])


def polarised(
    r: LineIntegrals, z: LineIntegrals, columns: Indices, rows: Indices, plane: float, normal: float
) -> Floats:
    """Integral of `plane` times the strain in the plane (both directions added) and `normal` times that along the axis.

    Returns:
        (elements, 2 (p + 1)^2), per radian, for the elements in `columns` x `rows`.
    """
    # The first shape function is 1.
    radial, axial = (plane * r.dilatation_value[:, :, 0], normal * r.value_value[:, :, 0])
    pairs = (radial, z.value_value[:, :, 0]), (axial, z.slope_value[:, :, 0])
    by_axis = [np.einsum("xi,yj->xyij", one[columns], other[rows]) for one, other in pairs]
    return np.stack(by_axis, axis=2).reshape(len(columns) * len(rows), -1)


def differences(nodal: Floats, rest: Floats) -> Floats:
    """Unknowns of the element matrices from nodal values (elements, 2 (p + 1)^2) and the rounding errors of these."""
    shapes = math.isqrt(nodal.shape[1] // 2)
    value, small = (np.array(part).reshape(-1, 2, shapes, shapes) for part in (nodal, rest))
    for axis in (3, 2):
        first, second = (np.take(value, index, axis) for index in (0, 1))
        difference = second - first
        # Exact rounding error of the difference (Knuth): a strain may be 1e-16 of a displacement.
        taken = difference - second
        rounding = (second - (difference - taken)) - (first + taken)
        place = (..., 1) if axis == 3 else (..., 1, slice(None))
        small[place] += rounding - np.take(small, 0, axis)
        value[place] = difference
    return (value + small).reshape(nodal.shape)


def nodal(forces: Floats) -> Floats:
    """Turn forces (elements, n) on the unknowns of the element matrices into forces on nodes, in place.

    A stiffness (elements, n, n) is turned along both axes.
    """
    shapes = math.isqrt(forces.shape[1] // 2)
    view = forces.reshape(len(forces), *(forces.ndim - 1) * (2, shapes, shapes))
    for axis in range(1, view.ndim, 3):
        for shape in (axis + 2, axis + 1):
            first, second = (view[(slice(None),) * shape + (index,)] for index in (0, 1))
            first -= second
    return forces


def shape_functions(degree: int, points: Floats) -> tuple[Floats, Floats]:
    """Values and slopes of the shape functions of a line at `points` in [0, 1]: both (degree + 1, points).

    They are those of scikit-fem's `ElementLinePp`, whose import takes as long as a coarse mesh: two straight lines, and
    the integrals of the Legendre polynomials from the first one on, each scaled to a slope of norm 1 on [-1, 1].
    """
    legendre = np.polynomial.legendre.legvander(2 * points - 1, degree).T.astype(np.float64)
    order = np.arange(2, degree + 1)[:, None]
    scale = np.sqrt((2 * order - 1) / 2)
    integrals = (legendre[2:] - legendre[:-2]) / (2 * order - 1)
    values = np.concatenate([[1 - points, points], scale * integrals])
    slopes = np.concatenate([[np.full_like(points, -1), np.ones_like(points)], 2 * scale * legendre[1:-1]])
    return values, slopes
