"""Element matrices of axisymmetric elasticity on a grid of rectangles, for all rectangles at once.

On a rectangle every integral is a sum of products of an integral over the radius and one over the height,
so scikit-fem assembles forms on two lines only, and the element matrices are Kronecker products of theirs.
Shape functions are the hierarchical ones of scikit-fem (`ElementLinePp`) in both directions, degree p.

Displacement-pressure form: the dilatation is projected on discontinuous polynomials of degree p - 2 (pair
Q_p x Q_(p-2), stable on anisotropic and geometrically graded meshes: Schötzau, Schwab and Stenberg 1999).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Line:
    """Integrals over the intervals of one line, each of shape (intervals, p + 1, p + 1).

    Rows belong to the first factor named, columns to the second: φ shape function, d its derivative, w the
    weight (r over the radius, 1 over the height). `dilatation` and `value` are ∫ q (wφ)' and ∫ q wφ with q
    orthonormal under w, of shape (intervals, p - 1, p + 1).
    """

    dofs: Indices
    positions: Array
    value_value: Array
    slope_slope: Array
    slope_value: Array
    hoop: Array
    dilatation_dilatation: Array
    dilatation_value: Array
    dilatation: Array
    value: Array


def line(points: Array, degree: int, radial: bool) -> Line:
    """Integrals on a line with grid lines `points` [m], weighted with the radius if `radial`."""
    from skfem import Basis, BilinearForm, ElementLineP1, ElementLineP2, ElementLinePp, MeshLine

    def weight(w: Any) -> Any:
        return w.x[0] if radial else 1.0

    def dilatation(u: Any, w: Any) -> Any:
        return u.grad[0] + u / w.x[0] if radial else u.grad[0]

    mesh = MeshLine(points)
    # The hoop term divides by the radius: no polynomial, and steep where an element is many radii wide.
    basis = Basis(mesh, ElementLinePp(degree), intorder=2 * degree + 24)
    pressure = {1: ElementLineP1, 2: ElementLineP2}.get(degree - 2, lambda: ElementLinePp(degree - 2))()
    tests = basis.with_element(pressure)

    def local(form: Any, *bases: Any) -> Array:
        # COOData.tolocal mixes up rows and columns of forms that are not symmetric.
        trial, test = bases[0], bases[-1]
        data = BilinearForm(form).elemental(*bases).data
        matrices: Array = data.reshape(trial.Nbfun, test.Nbfun, -1).transpose(2, 1, 0)
        return matrices

    mass = local(lambda u, v, w: weight(w) * u * v, tests)
    orthonormal = np.linalg.inv(np.linalg.cholesky(mass))
    return Line(
        dofs=np.asarray(basis.element_dofs.T, dtype=np.intp),
        positions=points,
        value_value=local(lambda u, v, w: weight(w) * u * v, basis),
        slope_slope=local(lambda u, v, w: weight(w) * u.grad[0] * v.grad[0], basis),
        slope_value=local(lambda u, v, w: weight(w) * u * v.grad[0], basis),
        hoop=local(lambda u, v, w: u * v / w.x[0] if radial else 0 * u * v, basis),
        dilatation_dilatation=local(lambda u, v, w: weight(w) * dilatation(u, w) * dilatation(v, w), basis),
        dilatation_value=local(lambda u, v, w: weight(w) * u * dilatation(v, w), basis),
        dilatation=orthonormal @ local(lambda u, v, w: weight(w) * dilatation(u, w) * v, basis, tests),
        value=orthonormal @ local(lambda u, v, w: weight(w) * u * v, basis, tests),
    )


def product(radial: Array, axial: Array) -> Array:
    """Kronecker products of all radial with all axial matrices: (n_r * n_z, rows, columns)."""
    (n, a, b), (m, c, d) = radial.shape, axial.shape
    products: Array = np.einsum("xab,ycd->xyacbd", radial, axial).reshape(n * m, a * c, b * d)
    return products


def stiffness(r: Line, z: Line, columns: Indices, rows: Indices, shear: float, lame: float) -> Array:
    """Stiffness of the elements in `columns` x `rows`, per radian: (elements, 2 (p + 1)^2, the same).

    Unknowns of an element: radial displacement, then axial, each with the axial shape function running
    fastest. `shear` is the modulus G, `lame` the modulus λ of the dilatation taken in full [Pa].
    """

    def of(radial: Array, axial: Array) -> Array:
        return product(radial[columns], axial[rows])

    rr = of(2 * shear * (r.slope_slope + r.hoop) + lame * r.dilatation_dilatation, z.value_value)
    rr += of(shear * r.value_value, z.slope_slope)
    zz = of((2 * shear + lame) * r.value_value, z.slope_slope) + of(shear * r.slope_slope, z.value_value)
    rz = of(shear * r.slope_value.transpose(0, 2, 1), z.slope_value)
    if lame:
        rz += of(lame * r.dilatation_value, z.slope_value.transpose(0, 2, 1))
    return np.concatenate(
        [np.concatenate([rr, rz], axis=2), np.concatenate([rz.transpose(0, 2, 1), zz], axis=2)], axis=1
    )


def dilatation(r: Line, z: Line, columns: Indices, rows: Indices) -> Array:
    """Projected dilatation of the elements in `columns` x `rows`: (elements, (p - 1)^2, 2 (p + 1)^2)."""
    return np.concatenate(
        [product(r.dilatation[columns], z.value[rows]), product(r.value[columns], z.dilatation[rows])], axis=2
    )


def shape_functions(degree: int, points: Array) -> Array:
    """Values of the shape functions of a line at `points` in [0, 1]: (degree + 1, points)."""
    from skfem import ElementLinePp

    element = ElementLinePp(degree)
    return np.array([element.lbasis(points[None, :], index)[0] for index in range(degree + 1)])
