"""What is asked of the solid model: forces on teeth and bases, and mean stresses of films.

Each is the work of inner forces of some elements on given displacements of these: a force that passes through a
surface, on displacements of 1 m that end there; a mean stress, on a uniform strain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.body import Names
from palpate.instrument.models.solid.parts import Part, Stack
from palpate.instrument.sensor.film_material import FilmMaterial

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Work:
    """Work of the inner forces of some elements of a part.

    Attributes:
        part: the part.
        elements: numbers of the elements.
        moved: displacements, an array of the body's shape.
    """

    part: Part
    elements: Names
    moved: Vector

    def forces(self, unknowns: int, added: float) -> Vector:
        """Work by each unknown's displacement of 1 m, (unknowns,); added: as in `Body.stiffness`, in steps."""
        body = self.part.body
        moved = body.local(self.moved, self.elements)
        forces = body.stiffness(self.elements, added * self.part.step) @ moved[..., None]
        total = np.zeros(unknowns + 1)
        np.add.at(total, body.local(self.part.names, self.elements), forces[..., 0])
        return total[:-1]

    def energy(self, added: float) -> float:
        """Work of the forces that the displacements alone cause [J]."""
        moved = self.part.body.local(self.moved, self.elements)
        stiffness = self.part.body.stiffness(self.elements, added * self.part.step)
        return float(np.einsum("ei,eij,ej->", moved, stiffness, moved))


@dataclass(frozen=True, slots=True)
class Electrode:
    """Electrodes of the film under one tooth or of one base, or the solved half or quarter of them.

    Attributes:
        part: the film.
        elements: numbers of the film's elements between the electrodes.
        cell: number of the cell in the plan.
        area: area [m2].
    """

    part: Part
    elements: Names
    cell: int
    area: float

    def inside(self, stack: Stack) -> Vector:
        """Forces (elements, unknowns) of the film under 1 V, against its voltage [N/V]."""
        body = self.part.body
        assert isinstance(body.material, FilmMaterial)
        return body.polarised(body.material, stack.one[body.plan.nodes])[self.elements]

    def forces(self, stack: Stack) -> Vector:
        """The same on all unknowns."""
        total = np.zeros(stack.unknowns + 1)
        np.add.at(total, self.part.body.local(self.part.names, self.elements), self.inside(stack))
        return total[:-1]

    def charge(self, stack: Stack, goal: Work) -> float:
        """Change of a goal with the voltage, which is also the charge by the goal's displacements [C]."""
        if goal.part is not self.part:
            return 0.0
        common = np.isin(self.elements, goal.elements)
        moved = self.part.body.local(goal.moved, self.elements[common])
        return float((self.inside(stack)[common] * moved).sum())


@dataclass(frozen=True, slots=True)
class Goals:
    """Goals of the whole sensor, each a sum over works in its solved half or quarter.

    Attributes:
        works: works in the solved share of the sensor.
        shares: (goals, works), factors of the sums. Goals are the forces on teeth, the forces on bases, and the mean
            stresses along x of each tooth's film and then of each base's, and along y (none on a rigid support). The
            last row is the force on all teeth.
        electrodes: electrodes of the films in the solved share; none on a rigid support.
        films: (films, electrodes), by which the charges of the electrodes are those of the films.
        teeth, bases: number of teeth and of bases.
    """

    works: Sequence[Work]
    shares: Vector
    electrodes: Sequence[Electrode]
    films: Vector
    teeth: int
    bases: int


def goals(p: SolidParameters, stack: Stack, mirrored: tuple[bool, bool]) -> Goals:
    """The goals of a sensor of which half or a quarter is solved."""
    on_teeth = _whole(p, mirrored)
    on_bases = on_teeth if p.separate_bases else np.array([[2.0 ** sum(mirrored)]])
    sides = [(stack.tooth, 0)] + ([(stack.ring, -1)] if p.support == "rigid" else [])
    kinds = {
        "teeth": [pair for part, level in sides for pair in _lifted(stack, part, level)],
        "floor": [pair for part in stack.floor for pair in _floored(stack, part, p.separate_bases)],
    }
    if p.support != "rigid":
        for axis in (0, 1):
            kinds |= {
                f"tooth films {axis}": _stretched(stack, stack.tooth, axis, by_cell=True),
                f"base films {axis}": [
                    pair
                    for film in stack.base_films
                    for pair in _stretched(stack, film, axis, by_cell=p.separate_bases)
                ],
            }
    works = [work for pairs in kinds.values() for _, work in pairs]

    def rows(kind: str, whole: Vector) -> Vector:
        found = np.zeros((len(whole), len(works)))
        for cell, work in kinds[kind]:
            found[cell, next(place for place, other in enumerate(works) if other is work)] = 1.0
        return whole @ found

    teeth, bases = rows("teeth", on_teeth), rows("floor", on_bases)
    together = teeth.sum(axis=0, keepdims=True)
    shares = [teeth, bases]
    if p.support == "rigid":
        shares = [teeth, bases + (teeth if p.separate_bases else together), together]
        return Goals(works, np.concatenate(shares), [], np.zeros((0, 0)), len(teeth), len(bases))
    for axis in (0, 1):
        for where, whole in (("tooth", on_teeth), ("base", on_bases)):
            own = rows(f"{where} films {axis}", whole)
            shares.append(own / (own @ [_volume(work) for work in works])[:, None])
    electrodes = [
        Electrode(work.part, work.elements, cell, _area(work))
        for where in ("tooth", "base")
        for cell, work in kinds[f"{where} films 0"]
    ]
    films = np.zeros((len(teeth) + len(bases), len(electrodes)))
    for place, electrode in enumerate(electrodes):
        if place < len(kinds["tooth films 0"]):
            films[: len(teeth), place] = on_teeth[:, electrode.cell]
        else:
            films[len(teeth) :, place] = on_bases[:, electrode.cell]
    return Goals(works, np.concatenate([*shares, together]), electrodes, films, len(teeth), len(bases))


def _whole(p: SolidParameters, mirrored: tuple[bool, bool]) -> Vector:
    """What each cell of the whole sensor (cells, cells) has of the values of those that were solved."""
    count = p.rows * p.columns
    grid = np.eye(count).reshape(p.rows, p.columns, count)
    if mirrored[0]:
        grid = grid + grid[:, ::-1]
    if mirrored[1]:
        grid = grid + grid[::-1]
    return grid.reshape(count, count)


def _lifted(stack: Stack, part: Part, level: int) -> list[tuple[int, Work]]:
    """Forces of a part on each tooth below it, by the tooth's cell."""
    body, over = part.body, stack.over_teeth(part.body)
    moved = np.zeros(body.shape)
    moved[2, level, over] = stack.one[body.plan.nodes[over]]
    steps = len(body.height.local)
    found = []
    for cell, plan in _cells(stack, part, by_cell=True):
        touching = plan[over[body.plan.local[plan]].any(axis=1)]
        if len(touching):
            found.append((cell, Work(part, touching * steps + level % steps, moved)))
    return found


def _floored(stack: Stack, part: Part, by_cell: bool) -> list[tuple[int, Work]]:
    """Forces of a part on the floor, by cell or all together."""
    body = part.body
    moved = np.zeros(body.shape)
    moved[2, 0] = stack.one[body.plan.nodes]
    return [
        (cell, Work(part, plan * len(body.height.local), moved)) for cell, plan in _cells(stack, part, by_cell=by_cell)
    ]


def _stretched(stack: Stack, film: Part, axis: int, by_cell: bool) -> list[tuple[int, Work]]:
    """Mean stresses of a film times its volume, by cell or all together."""
    body = film.body
    moved = np.zeros(body.shape)
    moved[axis] = body.height.one[:, None] * stack.places[axis][body.plan.nodes]
    # A film has one step along the height, so that its elements have the numbers of those of its plan.
    return [(cell, Work(film, plan, moved)) for cell, plan in _cells(stack, film, by_cell=by_cell)]


def _cells(stack: Stack, part: Part, by_cell: bool) -> list[tuple[int, Names]]:
    """Cells of a part, and the elements of its plan there; all as those of cell 0 where cells do not count."""
    plan = part.body.plan
    if not by_cell:
        return [(0, np.arange(len(plan.elements)))]
    cells = stack.plan.cell[plan.elements]
    return [(int(cell), np.flatnonzero(cells == cell)) for cell in np.unique(cells)]


def _area(work: Work) -> float:
    return float(work.part.body.plan.areas[work.elements].sum())


def _volume(work: Work) -> float:
    return _area(work) * float(np.ptp(work.part.body.height.breaks))
