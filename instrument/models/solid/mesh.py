"""Meshes of the solid model: a plan of curved quadrilaterals, and steps along the height.

Every part of a sensor is a plan times a range of heights, so that the mesh is a product too. The plan of one
cell is built for a quarter (square core, rings around the tooth's axis, the rest out to the cell's edge) and
mirrored; steps shrink geometrically towards the edges of tooth, gap and ring, where the stress is singular.
"""

from __future__ import annotations

import itertools
import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from skfem import Mesh, MeshQuad1, MeshQuad2

from palpate.instrument.models.solid.curve import Resolution

logging.getLogger("skfem").addHandler(logging.NullHandler())  # it tells of copies of large meshes

Vector = NDArray[np.float64]

TOOTH, GAP, RING, OVERHANG = range(4)
SWAPPED = [0, 3, 2, 1, 7, 6, 5, 4, 8]  # an element's points with its two directions exchanged


@dataclass(frozen=True, slots=True)
class Cell:
    """One sensor's share of the plan: a rectangle around the tooth's axis. Lengths [m]."""

    half_length: float
    half_width: float
    tooth_radius: float
    inner_radius: float
    outer_radius: float


@dataclass(frozen=True, slots=True)
class Plan:
    """Mesh of the plan with labels of its elements.

    Attributes:
        region: (elements,), TOOTH, GAP, RING or OVERHANG.
        cell: (elements,), number of the cell.
    """

    mesh: Mesh
    region: NDArray[np.intp]
    cell: NDArray[np.intp]


def graded(start: float, end: float, layers: int, ratio: float, towards: str) -> Vector:
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


def plan_mesh(cell: Cell, quarters: dict[tuple[int, int], tuple[float, float, int]], resolution: Resolution) -> Plan:
    """Plan of some quarters of cells.

    Args:
        quarters: (column, row) of each quarter on the lattice of quarter cells, odd and even alternating in
            orientation, to the position of its tooth's axis (x, y) [m] and the index of its cell.
    """
    lattice, layer, blocks = _quarter(cell, resolution)
    points: list[Vector] = []
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
    return Plan(
        mesh=_biquadratic(np.array(points).T, np.concatenate(elements, axis=1)),
        region=np.concatenate(regions),
        cell=np.concatenate(cells),
    )


def _biquadratic(points: Vector, nine: NDArray[np.intp]) -> Mesh:
    """Mesh of elements given by corners, middles of sides 01, 12, 23, 03, and centre."""
    corners, renumbered = np.unique(nine[:4], return_inverse=True)
    straight = MeshQuad1(points[:, corners], renumbered.reshape(4, -1))
    curved = MeshQuad2.from_mesh(straight)
    places = curved.doflocs.copy()
    places[:, curved.dofs.element_dofs] = points[:, nine]
    return MeshQuad2(places, curved.t)


def _quarter(cell: Cell, resolution: Resolution) -> tuple[Vector, NDArray[np.intp], tuple[NDArray[np.intp], ...]]:
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


def locate(basis: Any, point: tuple[float, float]) -> tuple[NDArray[np.intp], Vector]:
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
