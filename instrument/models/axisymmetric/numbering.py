"""Numbering of the unknowns: which ones the elements of neighbouring bodies share, and which are fixed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric.mesh import Body, Grid, inside
from palpate.instrument.models.finite_elements.elements import Line
from palpate.instrument.models.parameters import RoundParameters

Indices = NDArray[np.intp]

SHEETS = ("object", "base", "tooth", "ring")
RADIAL, AXIAL = 0, 1
WHOLE = 2500  # least number of shared unknowns for two threads; for fewer, they lose more by waiting than they gain


@dataclass(frozen=True, slots=True)
class Part:
    """Elements of one body: their slice of all elements, and their columns and rows of the grid."""

    body: Body
    elements: slice
    columns: Indices
    rows: Indices

    def __len__(self) -> int:
        return int(self.elements.stop - self.elements.start)


@dataclass(frozen=True, slots=True)
class Numbering:
    """Global numbers of the elements' unknowns, as `condensed.Elements` has them."""

    unknowns: Indices
    size: int
    shared: int
    inner: NDArray[np.bool_]
    subdomain: Indices
    subdomains: int
    seam: int


def parts(mesh: Grid) -> list[Part]:
    """Elements of each body, ordered by radius and then by height."""
    found, start = [], 0
    for body in mesh.bodies:
        columns, rows = inside(mesh.radii, body.radii), inside(mesh.heights, body.heights)
        count = len(columns) * len(rows)
        found.append(Part(body, slice(start, start + count), columns, rows))
        start += count
    return found


def number(parameters: RoundParameters, mesh: Grid, r: Line, z: Line, bodies: list[Part]) -> Numbering:
    """Number the unknowns: shared ones first, in the order of elimination, then those inside elements.

    Fixed unknowns have the number `size`.
    """
    local = r.dofs.shape[1]
    names = np.concatenate([_names(parameters, mesh, r, z, part) for part in bodies])
    bubble = np.arange(local) >= 2
    inner = np.tile(np.outer(bubble, bubble).ravel(), 2)
    outer = names[:, ~inner]
    named = np.zeros(outer.max() + 2, dtype=bool)
    named[outer] = True
    named[-1] = False  # fixed unknowns are named -1
    shared, count = int(np.count_nonzero(named)), int(inner.sum())
    size = shared + len(names) * count
    places = np.where(outer >= 0, (np.cumsum(named) - 1)[outer], shared)
    rank = np.full(shared + 1, size)
    order, subdomain, seam = _dissection(mesh, bodies, places, shared)
    rank[order] = np.arange(shared)
    unknowns = np.empty(names.shape, dtype=np.intp)
    unknowns[:, ~inner] = rank[places]
    unknowns[:, inner] = np.arange(shared, size).reshape(len(names), count)
    return Numbering(unknowns, size, shared, inner, subdomain, int(subdomain.max()) + 1, seam)


def _dissection(mesh: Grid, bodies: list[Part], unknowns: Indices, count: int) -> tuple[Indices, Indices, int]:
    """Order of the elements' unknowns (elements, m) below `count` by nested dissection (George 1973).

    The grid is halved by its rows and by its columns in turn. Unknowns in both halves come after those in one half.
    Elimination in this order takes two thirds of the time of SuperLU's own order.

    Returns:
        The order, the half in which each element lies, and the number of unknowns that lie in one half only.
    """
    intervals = len(mesh.radii) - 1, len(mesh.heights) - 1
    halvings = max(intervals).bit_length()
    at = [(np.arange(n) << halvings) // n for n in intervals]
    column, row = (np.sum([(place >> k & 1) << 2 * k for k in range(halvings)], axis=0) for place in at)
    path = np.concatenate([(column[part.columns][:, None] + 2 * row[part.rows]).ravel() for part in bodies])
    first, last = np.full(count + 1, path.max()), np.zeros(count + 1, dtype=np.intp)
    flat, paths = unknowns.ravel(), path.repeat(unknowns.shape[1])
    np.minimum.at(first, flat, paths)
    np.maximum.at(last, flat, paths)
    # Number of the last halvings that separate the elements of an unknown.
    _, apart = np.frexp((first ^ last)[:count].astype(np.float64))
    order = np.lexsort((apart, last[:count] | (1 << apart) - 1))
    if count < WHOLE:
        return order, np.zeros_like(path), count
    first_halving = 2 * halvings - 1
    return order, path >> first_halving, int(np.count_nonzero(apart <= first_halving))


def within(radius: float, mesh: Grid, r: Line) -> NDArray[np.bool_]:
    """Whether each shape function of the radial line, by its number, belongs to an interval within `radius` [m]."""
    return _shapes(mesh, r, (0.0, radius))


def _shapes(mesh: Grid, r: Line, radii: tuple[float, float]) -> NDArray[np.bool_]:
    found = np.zeros(r.dofs.max() + 1, dtype=bool)
    found[r.dofs[inside(mesh.radii, radii)]] = True
    return found


def _names(parameters: RoundParameters, mesh: Grid, r: Line, z: Line, part: Part) -> Indices:
    """A name, an integer, for each unknown (elements, 2 (p + 1)^2): joined unknowns share it, fixed ones have -1."""
    # Axes: column, row, axis, radial shape, axial shape. Vertices have the numbers of their grid lines.
    radial, axial = r.dofs[part.columns][:, None, None, :, None], z.dofs[part.rows][None, :, None, None, :]
    axis = np.array([RADIAL, AXIAL])[:, None, None]
    face, foot = np.searchsorted(mesh.heights, [mesh.face, mesh.base])
    fixed = (radial == 0) & (axis == RADIAL)

    covering = within(parameters.sensed_radius, mesh, r)[radial]
    if part.body.name == "ring" and parameters.ring_inner_radius == parameters.tooth_radius:
        # The object's node over a closed gap belongs to the tooth: a force on a node presses on no ring.
        covering = covering & (radial != r.dofs[part.columns[0], 0])
    touching = (axial == face) & covering
    if parameters.interface != "bonded":
        touching = touching & (axis == AXIAL)
    sheet = np.where(touching, SHEETS.index("object"), SHEETS.index(part.body.sheet))
    place = radial
    if parameters.interface == "capped":
        # A level top: its vertices move as the first one does, and nothing bends it between them.
        first, last = np.searchsorted(mesh.radii, [parameters.ring_inner_radius, parameters.ring_outer_radius])
        level = (axial == face) & (axis == AXIAL) & _shapes(mesh, r, (mesh.radii[first], mesh.radii[last]))[radial]
        sheet = np.where(level, SHEETS.index("object"), sheet)
        fixed = fixed | (level & (radial >= len(mesh.radii)))
        place = np.where(level, first, radial)
    if parameters.support == "rigid":
        held = touching & within(parameters.tooth_radius, mesh, r)[radial]
        fixed = fixed | held | (axial == foot)
    else:
        sheet = np.where(axial == foot, SHEETS.index("base"), sheet)
        fixed = fixed | (axial == 0)
    name = ((sheet * 2 + axis) * (r.dofs.max() + 1) + place) * (z.dofs.max() + 1) + axial
    return np.where(fixed, -1, name).reshape(len(part.columns) * len(part.rows), -1)
