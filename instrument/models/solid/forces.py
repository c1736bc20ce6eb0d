"""Forces on teeth, bases and films of the solid model, from the forces inside its elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.error_estimate import Energies
from palpate.instrument.models.solid.parts import Part, Stack
from palpate.instrument.models.solid.system import Solved, System

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Forces:
    """Forces [N], compression positive, and mean stresses along x and y [Pa], tension positive.

    Attributes:
        teeth: (teeth,), force on each tooth.
        bases: (bases,), force on each base.
        tooth_films: (teeth, 2), stresses of the film below each tooth; none on a rigid support.
        base_films: (bases, 2), stresses of the film of each base; none on a rigid support.
        signals: (teeth + bases, 2), voltage [V] and short-circuit charge [C] of each film, first of the teeth and then
            of the bases; none on a rigid support.
    """

    teeth: Vector
    bases: Vector
    tooth_films: Vector
    base_films: Vector
    signals: Vector


def evaluate(system: System, solved: Solved) -> Forces:
    """Forces and stresses of the whole sensor, mirrored where only a half or a quarter was solved."""
    return _Evaluation(system, solved).forces()


def energies(system: System, pressed: Solved) -> Energies:
    """Energies from which the mesh's error is estimated.

    Args:
        system: the sensor.
        pressed: solution under the parameters' own load.
    """
    p, copies = system.parameters, 2 ** sum(system.mirrored)
    jump = _jump(system)
    solved = system.solve(np.zeros(system.unknowns), jump)
    work = 0.0
    for number, moved in jump.items():
        part = system.stack.parts[number]
        strained = part.strained(solved.displacement) + part.body.local(moved)
        forces = (part.body.stiffness() @ strained[..., None])[..., 0]
        if solved.pressures[number].size:
            forces += (part.body.dilatation().transpose(0, 1, 3, 2) @ solved.pressures[number][..., None])[..., 0]
        work += float((forces * part.body.local(moved)).sum())
    for electrode, voltage in zip(system.electrodes, solved.voltages, strict=True):
        if electrode.cell is not None:
            work -= float(voltage) * float(p.film.stiff()[1][2]) * electrode.area / p.film_thickness
    sinking = float(system.load(p.load_at) @ pressed.displacement) / p.force**2
    return Energies(None if p.load_at else copies * sinking, copies * work)


def _jump(system: System) -> dict[int, Vector]:
    """Jump that raises everything above the teeth's lower side by 1.

    The work of the load on this jump is the teeth's force.
    """
    stack = system.stack
    sides = [(stack.tooth, 0)] + ([(stack.ring, -1)] if system.parameters.support == "rigid" else [])
    found = {}
    for part, level in sides:
        moved = np.zeros(part.body.shape)
        over = stack.over_teeth(part.body)
        moved[2, level, over] = stack.one[part.body.plan.nodes[over]]
        found[stack.parts.index(part)] = moved
    return found


def forces_below(part: Part, stack: Stack, solved: Solved) -> Vector:
    """Forces (elements, shapes) [N] along z on the shape functions of the lower side of a part's elements."""
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
            return Forces(teeth, bases, *3 * (np.empty((0, 2)),))
        below = [self._work(part) for part in stack.base_films]
        work, volume = (self._whole(np.sum(item, axis=0)) for item in zip(*below, strict=True))
        if not p.separate_bases:
            work, volume = work.sum(axis=0, keepdims=True), volume.sum(keepdims=True)
        tooth_work, tooth_volume = (self._whole(item) for item in self._work(stack.tooth))
        signals = self._signals()
        # A film's own voltage adds to its stresses.
        pulled = np.outer(signals[:, 0], p.film.stiff()[1][:2]) / p.film_thickness
        return Forces(
            teeth,
            bases,
            tooth_work / tooth_volume[:, None] + pulled[: len(teeth)],
            work / volume[:, None] + pulled[len(teeth) :],
            signals,
        )

    def _signals(self) -> Vector:
        """Voltages and charges (teeth + bases, 2) of the films, first of the teeth and then of the bases."""
        p, system, solved = self._system.parameters, self._system, self._solved
        cells = np.zeros((2, p.rows * p.columns, 3))
        for electrode, voltage, charge in zip(system.electrodes, solved.voltages, solved.charges, strict=True):
            below_tooth = electrode.cell is not None
            cell = electrode.cell if below_tooth else system.stack.plan.cell[electrode.part.body.plan.elements[0]]
            cells[0 if below_tooth else 1, cell] = voltage, charge, 1.0
        # The mirrored parts of a film have the same voltage, and their charges add up.
        teeth, bases = (self._whole(kind) for kind in cells)
        if not p.separate_bases:
            bases = bases.sum(axis=0, keepdims=True)
        found = np.concatenate([teeth, bases])
        return np.stack([found[:, 0] / found[:, 2], found[:, 1]], axis=1)

    def _whole(self, by_cell: Vector) -> Vector:
        """Values of all cells of the sensor, from those of the half or quarter that was solved."""
        p = self._system.parameters
        grid = by_cell.reshape(p.rows, p.columns, *by_cell.shape[1:])
        if self._system.mirrored[0]:
            grid = grid + grid[:, ::-1]
        if self._system.mirrored[1]:
            grid = grid + grid[::-1]
        return grid.reshape(by_cell.shape)

    def _on_teeth(self) -> Vector:
        stack = self._stack
        p = self._system.parameters
        total = self._over_teeth(stack.tooth, forces_below(stack.tooth, stack, self._solved))
        for electrode, voltage in zip(self._system.electrodes, self._solved.voltages, strict=True):
            if electrode.cell is not None:  # the film's voltage adds a force
                total[electrode.cell] -= voltage * p.film.stiff()[1][2] * electrode.area / p.film_thickness
        if p.support == "rigid":
            # Where there is no gap, the ring's edge is joined to the tooth.
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
        """Stress times volume of each cell, by the inner forces' work on the displacements x and y; and volume."""
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
