"""Cells of an array that are alike: one is condensed onto its edges and its part of the contact, for all of them.

Elements of such cells are each other's translations. Unknowns of the first cell at one place are those of the others at
the same place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.cost import Cost
from palpate.instrument.models.finite_elements.fronts import Condensed, Mesh, condense, cost_of
from palpate.instrument.models.solid.body import Names

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Alike:
    """Two or more cells of a mesh that are alike.

    Attributes:
        elements: (cells, elements), numbers of each cell's elements, in an order that is the same for all.
        places: (elements, n), places of the unknowns of these elements; -1 for those that are fixed in all cells.
        names: (cells, places), unknown of each cell at each place; -1 where it is fixed.
    """

    elements: Names
    places: Names
    names: Names


def alike(unknowns: Names, cells: Names, relative: Vector) -> Alike | None:
    """The cells of a mesh that are like the one with the most free unknowns; None: there is no other.

    Args:
        unknowns: (elements, n), numbers of each element's unknowns; -1 for those that are fixed.
        cells: (elements,), number of each element's cell.
        relative: (elements, m), integers that only elements share which are each other's translations.
    """
    groups = []
    for cell in np.unique(cells):
        own = np.flatnonzero(cells == cell)
        groups.append(own[np.lexsort(relative[own].T)])
    if len(groups) < 2:
        return None
    model = max(groups, key=lambda own: (len(own), np.count_nonzero(unknowns[own] >= 0)))
    free = unknowns[model] >= 0
    known, inverse = np.unique(unknowns[model][free], return_inverse=True)
    places = np.full(unknowns[model].shape, -1)
    places[free] = inverse
    found = []
    for own in groups:
        if not np.array_equal(relative[own], relative[model]):
            continue
        names = np.full(len(known), -1)
        names[inverse] = unknowns[own][free]
        if np.array_equal(np.where(free, names[places], -1), unknowns[own]):
            found.append((own, names))
    if len(found) < 2:
        return None
    return Alike(np.array([own for own, _ in found]), places, np.array([names for _, names in found]))


def condensed(mesh: Mesh, cells: Alike) -> Condensed:
    """What `fronts.condense` leaves of a mesh, with cells that are alike."""
    kept, goes, stays = _parted(mesh, cells)
    # Loads inside the cells, each only once.
    seen: dict[bytes, int] = {}
    columns = np.ascontiguousarray(mesh.loads[goes].transpose(0, 2, 1))
    which = np.array([[seen.setdefault(load.tobytes(), len(seen)) for load in own] for own in columns])
    loads = np.array([np.frombuffer(load) for load in seen]).reshape(len(seen), -1).T
    inside = np.zeros((len(kept), len(seen)))
    inside[~kept] = loads
    one = condense(_one(mesh, cells, kept, inside))
    forces = np.concatenate([mesh.loads, np.zeros((1, mesh.loads.shape[1]))])
    for names, own in zip(cells.names[:, kept], which, strict=True):
        np.add.at(forces, names, one.loads[:, own])

    whole, rest = len(cells.names), _others(mesh, cells)
    joined = condense(
        replace(
            _joined(mesh, cells, kept, stays),
            matrices=lambda elements: _matrices(one.stiffness, whole, mesh, rest, elements),
            loads=forces[:-1][stays],
        )
    )
    return replace(joined, work=joined.work + sum(one.work[np.ix_(own, own)] for own in which))


def costs(mesh: Mesh, cells: Alike) -> Cost:
    """What `condensed` will cost."""
    kept, _, stays = _parted(mesh, cells)
    loads = mesh.loads.shape[1]
    one = _one(mesh, cells, kept, np.broadcast_to(0.0, (len(kept), loads)))
    joined = _joined(mesh, cells, kept, stays)
    joined = replace(joined, loads=np.broadcast_to(0.0, (len(joined.kept), loads)))
    return cost_of(one) + cost_of(joined)


def _parted(mesh: Mesh, cells: Alike) -> tuple[NDArray[np.bool_], Names, NDArray[np.bool_]]:
    """Which unknowns are left of a cell (places,), those inside cells (cells, inside), and which stay (size,)."""
    several = np.zeros(len(mesh.kept), dtype=np.intp)
    for names in (*cells.names, np.unique(mesh.unknowns[_others(mesh, cells)])):
        several[names[names >= 0]] += 1
    stays = mesh.kept | (several != 1)
    kept: NDArray[np.bool_] = np.any(np.append(stays, True)[cells.names], axis=0)  # fixed unknowns have the last place
    goes = cells.names[:, ~kept]
    stays[:] = True
    stays[goes] = False
    return kept, goes, stays


def _others(mesh: Mesh, cells: Alike) -> Names:
    """Numbers of the elements that belong to none of these cells."""
    other = np.ones(len(mesh.unknowns), dtype=bool)
    other[cells.elements] = False
    return np.flatnonzero(other)


def _one(mesh: Mesh, cells: Alike, kept: NDArray[np.bool_], loads: Vector) -> Mesh:
    """The elements of one cell, which stands for all."""
    model = cells.elements[0]
    return Mesh(
        unknowns=cells.places,
        coordinates=mesh.coordinates[model],
        matrices=lambda elements: mesh.matrices(model[elements]),
        kept=kept,
        loads=loads,
    )


def _joined(mesh: Mesh, cells: Alike, kept: NDArray[np.bool_], stays: NDArray[np.bool_]) -> Mesh:
    """The mesh in which each cell is one element, as yet without matrices and loads."""
    numbers, rest = np.append(np.cumsum(stays) - 1, -1), _others(mesh, cells)
    whole, single = numbers[cells.names[:, kept]], numbers[mesh.unknowns[rest]]
    most = max(whole.shape[1], single.shape[1])
    centres = mesh.coordinates[cells.elements].mean(axis=1)
    return Mesh(
        unknowns=np.concatenate(
            [np.pad(each, ((0, 0), (0, most - each.shape[1])), constant_values=-1) for each in (whole, single)]
        ),
        coordinates=np.concatenate([centres, mesh.coordinates[rest]]),
        matrices=lambda _: [],
        kept=mesh.kept[stays],
        loads=mesh.loads[:0],
    )


def _matrices(of_cell: Vector, cells: int, mesh: Mesh, rest: Names, elements: Names) -> list[Vector]:
    """Matrices of some elements of a mesh whose first ones are cells."""
    others = iter(mesh.matrices(rest[elements[elements >= cells] - cells]))
    return [of_cell if element < cells else next(others) for element in elements.tolist()]
