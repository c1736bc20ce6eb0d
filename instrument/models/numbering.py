"""Which unknowns the elements of neighbouring bodies share, and which are fixed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.models.elements import Line
from instrument.models.mesh import Body, Grid, inside
from instrument.models.parameters import RoundParameters

Indices = NDArray[np.intp]

SHEETS = ("object", "base", "tooth", "ring")
RADIAL, AXIAL = 0, 1


@dataclass(frozen=True, slots=True)
class Part:
    """A body's elements: their slice of all elements, and their columns and rows of the grid."""

    body: Body
    elements: slice
    columns: Indices
    rows: Indices


@dataclass(frozen=True, slots=True)
class Numbering:
    """Global numbers of the elements' unknowns, as `condensed.Elements` has them."""

    unknowns: Indices
    size: int
    shared: int
    inner: NDArray[np.bool_]


def parts(mesh: Grid) -> list[Part]:
    """The elements of each body, radius by radius, the height running fastest."""
    found, start = [], 0
    for body in mesh.bodies:
        columns, rows = inside(mesh.radii, body.radii), inside(mesh.heights, body.heights)
        count = len(columns) * len(rows)
        found.append(Part(body, slice(start, start + count), columns, rows))
        start += count
    return found


def number(parameters: RoundParameters, mesh: Grid, r: Line, z: Line, bodies: list[Part]) -> Numbering:
    """Number the unknowns: shared ones first, for elimination, then those inside elements, fixed ones with the size."""
    local = r.dofs.shape[1]
    names = np.concatenate(
        [
            np.concatenate([_names(parameters, mesh, r, z, part, axis) for axis in (RADIAL, AXIAL)], axis=1)
            for part in bodies
        ]
    )
    bubble = np.arange(local) >= 2
    inner = np.tile(np.outer(bubble, bubble).ravel(), 2)
    outer = names[:, ~inner]
    distinct = np.unique(outer[outer >= 0])
    shared, count = len(distinct), int(inner.sum())
    size = shared + len(names) * count
    places = np.where(outer >= 0, np.searchsorted(distinct, outer), shared)
    rank = np.full(shared + 1, size)
    rank[_dissection(mesh, bodies, places, shared)] = np.arange(shared)
    unknowns = np.empty(names.shape, dtype=np.intp)
    unknowns[:, ~inner] = rank[places]
    unknowns[:, inner] = np.arange(shared, size).reshape(len(names), count)
    return Numbering(unknowns, size, shared, inner)


def _dissection(mesh: Grid, bodies: list[Part], unknowns: Indices, count: int) -> Indices:
    """The elements' unknowns (elements, m) below `count` in the order of a nested dissection (George 1973).

    The grid is halved by its rows and by its columns in turn; what lies in both halves comes after what lies in one.
    Elimination in this order takes two thirds of the time of one in SuperLU's.
    """
    intervals = len(mesh.radii) - 1, len(mesh.heights) - 1
    halvings = max(intervals).bit_length()
    at = [(np.arange(n) << halvings) // n for n in intervals]
    column, row = (np.sum([(place >> k & 1) << 2 * k for k in range(halvings)], axis=0) for place in at)
    path = np.concatenate([(column[part.columns][:, None] + 2 * row[part.rows]).ravel() for part in bodies])
    first, last = np.full(count + 1, path.max()), np.zeros(count + 1, dtype=np.intp)
    np.minimum.at(first, unknowns, path[:, None])
    np.maximum.at(last, unknowns, path[:, None])
    # How many of the last halvings leave an unknown's elements apart from one another.
    _, apart = np.frexp((first ^ last)[:count].astype(np.float64))
    order: Indices = np.lexsort((apart, last[:count] | (1 << apart) - 1))
    return order


def within(radius: float, mesh: Grid, r: Line) -> NDArray[np.bool_]:
    """Which of the radial line's shape functions, by number, belong to an interval within `radius` [m]."""
    found = np.zeros(r.dofs.max() + 1, dtype=bool)
    found[r.dofs[inside(mesh.radii, (0.0, radius))]] = True
    return found


def _names(parameters: RoundParameters, mesh: Grid, r: Line, z: Line, part: Part, axis: int) -> Indices:
    """One integer for each node of the body, the same for joined nodes, -1 for fixed ones."""
    local = r.dofs.shape[1]
    # By (column, row, radial shape, axial shape); vertices have the numbers of their grid lines.
    radial, axial = r.dofs[part.columns][:, None, :, None], z.dofs[part.rows][None, :, None, :]
    face, foot = np.searchsorted(mesh.heights, [mesh.face, mesh.base])
    sheet = np.full((len(part.columns), len(part.rows), local, local), SHEETS.index(part.body.sheet))
    fixed = np.broadcast_to(radial == 0 if axis == RADIAL else np.array(False), sheet.shape).copy()

    if axis == AXIAL or parameters.interface == "bonded":
        covering = within(parameters.sensed_radius, mesh, r)[radial]
        if part.body.name == "ring" and parameters.ring_inner_radius == parameters.tooth_radius:
            # The object's node over a closed gap is the tooth's: a force on one node is no force on a ring.
            covering &= radial != r.dofs[part.columns[0], 0]
        touching = (axial == face) & covering
        sheet[touching] = SHEETS.index("object")
        if parameters.support == "rigid":
            fixed |= touching & within(parameters.tooth_radius, mesh, r)[radial]
    if parameters.support == "rigid":
        fixed |= axial == foot
    else:
        np.copyto(sheet, SHEETS.index("base"), where=axial == foot)
        fixed |= axial == 0
    name: Indices = ((sheet * 2 + axis) * (r.dofs.max() + 1) + radial) * (z.dofs.max() + 1) + axial
    return np.where(fixed, -1, name).reshape(-1, local * local)
