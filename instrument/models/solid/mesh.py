"""Meshes of the solid model: a plan of curved quadrilaterals, and steps along the height.

Every part of a sensor is a plan times a range of heights, so that the mesh is a product too. The plan of one
cell is built for a quarter (square core, rings around the tooth's axis, the rest out to the cell's edge) and
mirrored; steps shrink geometrically towards the edges of tooth, gap and ring, where the stress is singular.
"""

from __future__ import annotations

import itertools
import logging
import math
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from skfem import Basis, ElementLineP2, ElementLinePp, ElementQuad2, ElementQuadP, Mesh, MeshLine, MeshQuad1, MeshQuad2

from palpate.instrument.arrays import Floats
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.sensor.material import FilmMaterial

logging.getLogger("skfem").addHandler(logging.NullHandler())  # it tells of copies of large meshes

Names = NDArray[np.intp]
Entries = TypeVar("Entries", NDArray[np.float64], NDArray[np.intp])

TOOTH, GAP, RING, OVERHANG = range(4)
SWAPPED = [0, 3, 2, 1, 7, 6, 5, 4, 8]  # an element's points with its two directions exchanged


@dataclass(frozen=True, slots=True)
class UnitCell:
    """One sensor's share of the plan: a rectangle around the tooth's axis. Lengths [m]."""

    half_length: float
    half_width: float
    tooth_radius: float
    inner_radius: float
    outer_radius: float


@dataclass(frozen=True, slots=True)
class PlanMesh:
    """Mesh of the plan with labels of its elements.

    Attributes:
        region: (elements,), TOOTH, GAP, RING or OVERHANG.
        cell: (elements,), number of the cell.
    """

    mesh: Mesh
    region: NDArray[np.intp]
    cell: NDArray[np.intp]


def graded(start: float, end: float, layers: int, ratio: float, towards: str) -> Floats:
    """Breaks from `start` to `end` whose steps shrink by `ratio` towards "start", "end", "both" or "none".

    Returns:
        (layers + 1,) breaks for one end, (2 layers + 1,) for both.
    """
    if towards == "none":
        return np.linspace(start, end, layers + 1)
    if towards == "both":
        middle = (start + end) / 2
        left = graded(start, middle, layers, ratio, "start")
        return np.concatenate([left, graded(middle, end, layers, ratio, "end")[1:]])
    steps = np.concatenate([[0.0], ratio ** np.arange(layers - 1, -1, -1.0)])
    return start + (end - start) * steps if towards == "start" else (end - (end - start) * steps)[::-1]


def plan_mesh(
    cell: UnitCell, quarters: dict[tuple[int, int], tuple[float, float, int]], resolution: Resolution
) -> PlanMesh:
    """Plan of some quarters of cells.

    Args:
        quarters: (column, row) of each quarter on the lattice of quarter cells, odd and even alternating in
            orientation, to the position of its tooth's axis (x, y) [m] and the index of its cell.
    """
    lattice, layer, blocks = _quarter(cell, resolution)
    points: list[Floats] = []
    index: dict[tuple[int, int, int], int] = {}
    unit = cell.half_length * 1e-9
    elements: list[NDArray[np.intp]] = []
    regions: list[NDArray[np.intp]] = []
    cells: list[NDArray[np.intp]] = []
    for (column, row), (x, y, number) in quarters.items():
        flip = np.array([1.0 if column % 2 else -1.0, 1.0 if row % 2 else -1.0])
        placed = lattice * flip[:, None] + np.array([[x], [y]])
        names = np.empty(placed.shape[1], dtype=np.intp)
        for k, (px, py) in enumerate(placed.T):
            key = (round(px / unit), round(py / unit), int(layer[k]))
            if key not in index:
                index[key] = len(points)
                points.append(placed[:, k])
            names[k] = index[key]
        nine = names[blocks[0]]
        if flip.prod() < 0:
            nine = nine[SWAPPED]
        elements.append(nine)
        regions.append(blocks[1])
        cells.append(np.full(nine.shape[1], number, dtype=np.intp))
    return PlanMesh(
        mesh=_biquadratic(np.array(points).T, np.concatenate(elements, axis=1)),
        region=np.concatenate(regions),
        cell=np.concatenate(cells),
    )


def _biquadratic(points: Floats, nine: NDArray[np.intp]) -> Mesh:
    """Mesh of elements given by corners, middles of sides 01, 12, 23, 03, and centre."""
    corners, renumbered = np.unique(nine[:4], return_inverse=True)
    straight = MeshQuad1(points[:, corners], renumbered.reshape(4, -1))
    curved = MeshQuad2.from_mesh(straight)
    places = curved.doflocs.copy()
    places[:, curved.dofs.element_dofs] = points[:, nine]
    return MeshQuad2(places, curved.t)


def _quarter(cell: UnitCell, resolution: Resolution) -> tuple[Floats, NDArray[np.intp], tuple[NDArray[np.intp], ...]]:
    """Points (2, n), layer of each point, and elements (9, m) with their regions, for x, y >= 0."""
    m, layers, ratio = resolution.sectors, resolution.layers, resolution.ratio
    core = 0.5 * cell.tooth_radius
    side = np.linspace(0, 1, 2 * m + 1)
    angle = np.linspace(0, np.pi / 2, 4 * m + 1)
    # The middle of each arc is moved outwards so far that the parabola through its ends has the arc's area.
    half = np.pi / (8 * m)
    bulge = np.cos(half) + (2 * half - np.sin(2 * half)) * 3 / (8 * np.sin(half))
    circle = np.where(np.arange(4 * m + 1) % 2, bulge, 1.0) * np.array([np.cos(angle), np.sin(angle)])
    square = np.array([np.concatenate([np.ones(2 * m), side[::-1]]), np.concatenate([side, np.ones(2 * m)])])
    rectangle = square * np.array([[cell.half_length], [cell.half_width]])
    rings = [(core * square, cell.tooth_radius * circle, "end", TOOTH)]
    if cell.inner_radius > cell.tooth_radius:
        rings.append((cell.tooth_radius * circle, cell.inner_radius * circle, "both", GAP))
    rings.append((cell.inner_radius * circle, cell.outer_radius * circle, "both", RING))
    rings.append((cell.outer_radius * circle, rectangle, "start", OVERHANG))
    curves = [core * square]
    region: list[int] = []
    for inner, outer, towards, label in rings:
        depth = layers if label in (TOOTH, RING) else max(1, layers - 1)
        breaks = graded(0.0, 1.0, depth, ratio, towards)
        for low, high in itertools.pairwise(breaks):
            for share in ((low + high) / 2, high):
                curves.append((1 - share) * inner + share * outer)
            region.append(label)
    around = 4 * m + 1
    inside = [(core * s, core * t) for s in side[:-1] for t in side[:-1]]
    points = np.concatenate([np.array(inside).T, *curves], axis=1)
    layer = np.concatenate([np.full(len(inside), -1), np.repeat(np.arange(len(curves)), around)]).astype(np.intp)

    def core_name(i: int, j: int) -> int:
        if i < 2 * m and j < 2 * m:
            return i * 2 * m + j
        return len(inside) + (j if i == 2 * m else 4 * m - i)

    def ring_name(i: int, j: int) -> int:
        return len(inside) + i * around + j

    corner = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
    nine = [[core_name(2 * i + a, 2 * j + b) for a, b in corner] for i in range(m) for j in range(m)]
    labels = [TOOTH] * len(nine)
    for i, label in enumerate(region):
        for j in range(m):
            nine.append([ring_name(2 * i + a, 2 * j + b) for a, b in corner])
            # These run from the other axis towards the diagonal, so that an edge has the same direction in both its
            # elements.
            nine.append([ring_name(2 * i + a, 4 * m - 2 * j - b) for a, b in corner])
            labels += [label, label]
    return points, layer, (np.array(nine, dtype=np.intp).T, np.array(labels, dtype=np.intp))


def locate(basis: Any, point: tuple[float, float]) -> tuple[NDArray[np.intp], Floats]:
    """Nodes of the element around a point of the plan, and the values of their shape functions there."""
    target = np.array(point)
    corners = basis.mesh.doflocs[:, basis.mesh.dofs.element_dofs]
    mapping = basis.mesh.elem()
    slack = 0.05 * (corners.max(axis=(1, 2)) - corners.min(axis=(1, 2)))[:, None]
    near = ((corners.min(axis=1) - slack <= target[:, None]) & (corners.max(axis=1) + slack >= target[:, None])).all(0)
    best, nodes, values = np.inf, np.empty(0, dtype=np.intp), np.empty(0)
    for element in np.flatnonzero(near):
        local = np.array([0.5, 0.5])
        places = basis.mesh.doflocs[:, basis.mesh.dofs.element_dofs[:, element]]
        for _ in range(30):
            pairs = [mapping.lbasis(local[:, None], i) for i in range(9)]
            shape = np.array([np.ravel(pair[0])[0] for pair in pairs])
            slope = np.array([np.ravel(pair[1]) for pair in pairs])
            local = np.clip(local - np.linalg.lstsq(places @ slope, places @ shape - target, rcond=None)[0], -0.5, 1.5)
        off = float(np.max(np.abs(local - 0.5)) - 0.5)
        if off < best:
            best, nodes = off, basis.element_dofs[:, element]
            values = np.array([np.ravel(basis.elem.lbasis(local[:, None], i)[0])[0] for i in range(len(nodes))])
    return nodes, values


# --- element matrices of one part: a plan times a range of heights ---------------------------------------

# Shape functions are products of one of degree p in the plan and one of degree q along the height, so that every
# element matrix is a sum of products of one in the plan and one along the height, by the law of its material. The
# pressure is a discontinuous polynomial of degree p - 1 (Qp/Pp-1), and of degree q - 1 along the height alone: it is
# condensed element by element, and rubber does not lock.


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
    def law(self) -> Floats:
        """Stress by the derivatives of displacements without the dilatation, as `SolidBody.add_law` takes it [Pa]."""
        one = np.eye(3)
        law: Floats = self.shear * (np.einsum("ab,de->adbe", one, one) + np.einsum("ae,bd->adbe", one, one))
        return law

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
        products: (elements, 3, 3, shapes, shapes), integrals of a shape function's x derivative, y derivative and
            value times those of another.
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

        def product(test: Floats, trial: Floats) -> Floats:
            result: Floats = (test * weight[:, None]) @ trial.transpose(0, 2, 1)
            return result

        self.areas = weight.sum(axis=1)
        self.integrals = np.bincount(self.local.ravel(), weights=(v @ weight[..., None]).ravel())
        self.products = np.stack([np.stack([product(own, other) for other in (x, y, v)], 1) for own in (x, y, v)], 1)
        self.pressure = []
        for count in np.cumsum(np.arange(1, degree + 1)):
            polynomials = _orthonormal(np.asarray(part.global_coordinates()), weight, degree - 1)[:, :count]
            self.pressure.append((product(polynomials, x), product(polynomials, y), product(polynomials, v)))


def _orthonormal(places: Floats, weight: Floats, degree: int) -> Floats:
    """Polynomials (elements, polynomials, points) at the quadrature points, orthonormal on each element."""
    area = weight.sum(axis=-1)[:, None]
    centre = (places * weight).sum(axis=-1, keepdims=True) / area
    size = np.sqrt(((places - centre) ** 2 * weight).sum(axis=-1, keepdims=True) / area)
    a, b = (places - centre) / size
    # The degree rises, so that the first polynomials span every lower degree.
    monomials = np.stack([a ** (k - m) * b**m for k in range(degree + 1) for m in range(k + 1)], axis=-1)
    root = np.sqrt(weight)[..., None]
    polynomials: Floats = np.moveaxis(np.linalg.qr(root * monomials)[0] / root, -1, 1)
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
        products: (steps, 2, 2, shapes, shapes), integrals of a shape function's value and slope times those of another.
        pressure: (degree, steps, shapes), integrals of value and slope of shape functions times Legendre polynomials.
    """

    def __init__(self, breaks: Floats, degree: int) -> None:
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

        def product(test: Floats, trial: Floats) -> Floats:
            result: Floats = (test * weight[:, None]) @ trial.transpose(0, 2, 1)
            return result

        self.products = np.stack([np.stack([product(own, other) for other in (v, z)], 1) for own in (v, z)], 1)
        places = np.asarray(basis.global_coordinates())[0]
        middle, half = (breaks[1:] + breaks[:-1])[:, None] / 2, np.diff(breaks)[:, None] / 2
        levels = np.arange(degree)[:, None, None]
        legendre = np.polynomial.legendre.legvander((places - middle) / half, degree - 1).transpose(2, 0, 1)
        legendre = legendre * np.sqrt((2 * levels + 1) / (2 * half))
        pairs = [(product(level[:, None], v), product(level[:, None], z)) for level in legendre]
        self.pressure = [(value[:, 0], slope[:, 0]) for value, slope in pairs]


class SolidBody:
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

    def stiffness(self, elements: Names | None = None, added: float = 0.0) -> Floats:
        """Stiffness (elements, unknowns, unknowns) of some elements; None: of all.

        Args:
            elements: numbers of the elements.
            added: addition to the material's 1/λ [1/Pa].
        """
        if isinstance(self.material, FilmMaterial):
            return self.by_law(self.material.law, elements)
        dilatation = self.dilatation(elements)
        matrix: Floats = dilatation.transpose(0, 2, 1) @ (dilatation / (self.material.compliance + added))
        self.add_law(matrix, self.material.law, elements)
        return matrix

    def by_law(self, law: Floats, elements: Names | None = None) -> Floats:
        """Stiffness as `stiffness` gives it, of a material without pressure that `add_law` takes."""
        size = math.prod(self._of_each)
        matrix = np.zeros((self.count if elements is None else len(elements), size, size))
        self.add_law(matrix, law, elements)
        return matrix

    def add_law(self, matrix: Floats, law: Floats, elements: Names | None = None) -> None:
        """Add the stiffness of a material to that (elements, unknowns, unknowns) of some elements.

        Args:
            matrix: what it is added to.
            law: (3, 3, 3, 3), stress of axes a and d by the derivative along axis e of the displacement along axis b.
            elements: numbers of the elements; None: all.
        """
        plan, step = self._places(elements)
        # Derivatives along z are those of the height, all others those of the plan.
        slopes = np.array([0, 0, 1])
        upright = np.einsum("adbe,sdehk->sabhkde", law, self.height.products[:, slopes[:, None], slopes])
        upright = upright.reshape(len(upright), -1, 9)
        flat = self.plan.products.reshape(len(self.plan.products), 9, -1)
        _, heights, nodes = self._of_each
        # One element after the other stays in the cache.
        for own, k, s in zip(matrix.reshape(-1, *self._of_each, *self._of_each), plan, step, strict=True):
            product = (upright[s] @ flat[k]).reshape(3, 3, heights, heights, nodes, nodes)
            own += product.transpose(0, 2, 4, 1, 3, 5)

    @property
    def _of_each(self) -> tuple[int, int, int]:
        """Axes, heights and nodes of an element's unknowns."""
        return 3, self.height.local.shape[1], self.plan.local.shape[1]

    def polarised(self, film: FilmMaterial, one: Floats) -> Floats:
        """Forces (elements, unknowns) of a film under 1 V, against its voltage [N/V].

        Args:
            film: material of the film.
            one: coefficients of the function 1 in the plan, by node of the body.
        """
        p, h = self.plan, self.height
        _, stress, _ = film.stiff()
        along, across, flat = np.einsum("edij,ei->dej", p.products[:, 2], one[p.local])
        mass, slope = np.einsum("sdij,sj->dsi", h.products[:, :, 0], h.one[h.local])
        pairs = ((along, mass), (across, mass), (flat, slope))
        forces = [e * np.einsum("en,sh->eshn", *pair) for e, pair in zip(stress, pairs, strict=True)]
        by_axis: Floats = np.stack(forces, axis=2) / np.ptp(h.breaks)
        return by_axis.reshape(self.count, -1)

    def dilatation(self, elements: Names | None = None) -> Floats:
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


def plan_basis(plan: PlanMesh, degree: int) -> Any:
    """Shape functions of a plan, of a degree."""
    return Basis(plan.mesh, ElementQuad2() if degree == 2 else ElementQuadP(degree), intorder=2 * degree + 2)


def height_basis(breaks: Floats, degree: int, points: Floats | None = None) -> Any:
    """Shape functions along the height, at given points of each step (0 to 1), or at those of an exact quadrature."""
    element = ElementLineP2() if degree == 2 else ElementLinePp(degree)
    if points is None:
        return Basis(MeshLine(breaks), element, intorder=2 * degree)
    return Basis(MeshLine(breaks), element, quadrature=(points[None], np.full(len(points), 1 / len(points))))
