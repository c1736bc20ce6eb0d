"""What teeth, bases and films of the solid model feel, from the forces inside its elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from instrument.models.solid_parts import Part, Stack
from instrument.models.solid_system import Solved, System

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Forces:
    """Forces [N], compression positive, and mean stresses along x and y [Pa], tension positive.

    Attributes:
        teeth: on each tooth, shape (teeth,).
        bases: on each base, shape (bases,).
        tooth_films: of the film below each tooth, shape (teeth, 2); none on a rigid support.
        base_films: of the film of each base, shape (bases, 2); none on a rigid support.
    """

    teeth: Vector
    bases: Vector
    tooth_films: Vector
    base_films: Vector


def evaluate(system: System, solved: Solved) -> Forces:
    """Forces and stresses of the whole sensor, mirrored where half of it was solved for."""
    return _Evaluation(system, solved).forces()


def forces_below(part: Part, stack: Stack, solved: Solved) -> Vector:
    """Forces along z on the shape functions of the lower side of a part's elements, (elements, shapes) [N]."""
    lowest = np.flatnonzero(part.body.height.local[0] == 0)[0]
    forces: Vector = _inside(part, stack, solved, slice(0, 1))[:, 0, 2, lowest]
    return forces


def _forces_above(part: Part, stack: Stack, solved: Solved) -> Vector:
    height = part.body.height
    highest = np.flatnonzero(height.local[-1] == height.count - 1)[0]
    forces: Vector = _inside(part, stack, solved, slice(-1, None))[:, 0, 2, highest]
    return forces


def _inside(part: Part, stack: Stack, solved: Solved, steps: slice = slice(None)) -> Vector:
    return part.forces(solved.displacement, solved.pressures[stack.parts.index(part)], steps)


class _Evaluation:
    def __init__(self, system: System, solved: Solved) -> None:
        self._system, self._stack, self._solved = system, system.stack, solved

    def forces(self) -> Forces:
        p, stack = self._system.parameters, self._stack
        teeth = self._whole(self._on_teeth())
        cells = self._whole(np.sum([self._on_floor(part) for part in stack.floor], axis=0))
        if p.support == "rigid":
            cells = cells + teeth
        bases = cells if p.separate_bases else cells.sum(keepdims=True)
        if p.support == "rigid":
            return Forces(teeth, bases, np.empty((0, 2)), np.empty((0, 2)))
        below = [self._work(part) for part in stack.base_films]
        work, volume = (self._whole(np.sum(item, axis=0)) for item in zip(*below, strict=True))
        if not p.separate_bases:
            work, volume = work.sum(axis=0, keepdims=True), volume.sum(keepdims=True)
        tooth_work, tooth_volume = (self._whole(item) for item in self._work(stack.tooth))
        return Forces(teeth, bases, tooth_work / tooth_volume[:, None], work / volume[:, None])

    def _whole(self, by_cell: Vector) -> Vector:
        """What the cells of the whole sensor have, from those of the half or quarter that was solved for."""
        p = self._system.parameters
        grid = by_cell.reshape(p.rows, p.columns, *by_cell.shape[1:])
        if self._system.mirrored[0]:
            grid = grid + grid[:, ::-1]
        if self._system.mirrored[1]:
            grid = grid + grid[::-1]
        return grid.reshape(by_cell.shape)

    def _on_teeth(self) -> Vector:
        stack = self._stack
        total = self._over_teeth(stack.tooth, forces_below(stack.tooth, stack, self._solved))
        if self._system.parameters.support == "rigid":
            # Where no gap parts them, the ring's edge hangs on the tooth.
            total += self._over_teeth(stack.ring, _forces_above(stack.ring, stack, self._solved))
        return total

    def _over_teeth(self, part: Part, forces: Vector) -> Vector:
        stack, plan = self._stack, part.body.plan
        by_node = np.zeros(len(plan.nodes))
        np.add.at(by_node, plan.local, forces)
        over = plan.nodes[stack.over_teeth(part.body)]
        return self._by_cell((by_node * stack.one[plan.nodes])[stack.over_teeth(part.body)], stack.cell_of_node()[over])

    def _on_floor(self, part: Part) -> Vector:
        stack, plan = self._stack, part.body.plan
        forces = forces_below(part, stack, self._solved) * stack.one[plan.nodes[plan.local]]
        return self._by_cell(forces.sum(axis=1), stack.plan.cell[plan.elements])

    def _work(self, film: Part) -> tuple[Vector, Vector]:
        """By cell: work of the forces inside on the displacements x and y, which is stress times volume; volume."""
        plan, height = film.body.plan, film.body.height
        inside = np.einsum("esckn,sk->ecn", _inside(film, self._stack, self._solved), height.one[height.local])
        cells = self._stack.plan.cell[plan.elements]
        places = self._stack.places[:, plan.nodes[plan.local]]
        work = [self._by_cell((inside[:, axis] * places[axis]).sum(axis=1), cells) for axis in (0, 1)]
        return np.stack(work, axis=1), self._by_cell(plan.areas * np.ptp(height.breaks), cells)

    def _by_cell(self, values: Vector, cells: NDArray[np.intp]) -> Vector:
        p = self._system.parameters
        total = np.zeros(p.rows * p.columns)
        np.add.at(total, cells, values)
        return total
