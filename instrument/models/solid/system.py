"""Sensor and object of the solid model, each condensed onto their contact, and the curve of both."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve
from skfem import FacetBasis

from palpate.instrument.arrays import Floats
from palpate.instrument.models.finite_elements.elimination import (
    NODES,
    Condensed,
    ElementSystem,
    condense,
    cost_of,
    extrapolated,
    extrapolated_number,
)
from palpate.instrument.models.finite_elements.poles import Sensor, capacitance, curve, operations
from palpate.instrument.models.finite_elements.work import Cost, interruptible, judge, single, total
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution, SolidCurve, resolution
from palpate.instrument.models.solid.mesh import Names, PlanElements, height_basis, locate
from palpate.instrument.models.solid.parts import Diagonal, SolidPart, SolidStack, goals

# --- cells of an array that are alike --------------------------------------------------------------------

# Elements of such cells are each other's translations. Unknowns of the first cell at one place are those of the others
# at the same place.


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


def alike(unknowns: Names, cells: Names, relative: Floats) -> Alike | None:
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
    kept, inverse = np.unique(unknowns[model][free], return_inverse=True)
    places = np.full(unknowns[model].shape, -1)
    places[free] = inverse
    found = []
    for own in groups:
        if not np.array_equal(relative[own], relative[model]):
            continue
        names = np.full(len(kept), -1)
        names[inverse] = unknowns[own][free]
        if np.array_equal(np.where(free, names[places], -1), unknowns[own]):
            found.append((own, names))
    if len(found) < 2:
        return None
    return Alike(np.array([own for own, _ in found]), places, np.array([names for _, names in found]))


def condensed(mesh: ElementSystem, cells: Alike) -> Condensed:
    """What `elimination.condense` leaves of a mesh, with cells that are alike."""
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


def costs(mesh: ElementSystem, cells: Alike) -> Cost:
    """What `condensed` will cost."""
    kept, _, stays = _parted(mesh, cells)
    loads = mesh.loads.shape[1]
    one = _one(mesh, cells, kept, np.broadcast_to(0.0, (len(kept), loads)))
    joined = _joined(mesh, cells, kept, stays)
    joined = replace(joined, loads=np.broadcast_to(0.0, (len(joined.kept), loads)))
    return cost_of(one) + cost_of(joined)


def _parted(mesh: ElementSystem, cells: Alike) -> tuple[NDArray[np.bool_], Names, NDArray[np.bool_]]:
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


def _others(mesh: ElementSystem, cells: Alike) -> Names:
    """Numbers of the elements that belong to none of these cells."""
    other = np.ones(len(mesh.unknowns), dtype=bool)
    other[cells.elements] = False
    return np.flatnonzero(other)


def _one(mesh: ElementSystem, cells: Alike, kept: NDArray[np.bool_], loads: Floats) -> ElementSystem:
    """The elements of one cell, which stands for all."""
    model = cells.elements[0]
    return ElementSystem(
        unknowns=cells.places,
        coordinates=mesh.coordinates[model],
        matrices=lambda elements: mesh.matrices(model[elements]),
        kept=kept,
        loads=loads,
    )


def _joined(mesh: ElementSystem, cells: Alike, kept: NDArray[np.bool_], stays: NDArray[np.bool_]) -> ElementSystem:
    """The mesh in which each cell is one element, as yet without matrices and loads."""
    numbers, rest = np.append(np.cumsum(stays) - 1, -1), _others(mesh, cells)
    whole, single = numbers[cells.names[:, kept]], numbers[mesh.unknowns[rest]]
    most = max(whole.shape[1], single.shape[1])
    centres = mesh.coordinates[cells.elements].mean(axis=1)
    return ElementSystem(
        unknowns=np.concatenate(
            [np.pad(each, ((0, 0), (0, most - each.shape[1])), constant_values=-1) for each in (whole, single)]
        ),
        coordinates=np.concatenate([centres, mesh.coordinates[rest]]),
        matrices=lambda _: [],
        kept=mesh.kept[stays],
        loads=mesh.loads[:0],
    )


def _matrices(of_cell: Floats, cells: int, mesh: ElementSystem, rest: Names, elements: Names) -> list[Floats]:
    """Matrices of some elements of a mesh whose first ones are cells."""
    others = iter(mesh.matrices(rest[elements[elements >= cells] - cells]))
    return [of_cell if element < cells else next(others) for element in elements.tolist()]


# --- some parts, condensed onto the unknowns that they share with the others -----------------------------

SAME = 1e-6  # of the length: elements at places that differ by less are translations of each other


class Substructure:
    """The sensor without the object, or the object without the sensor.

    Attributes:
        parts: the parts.
        has: (unknowns,), whether an unknown of the stack is one of these parts'.
        keeps_volume: whether the compliance of a part is too small for its element matrices.
    """

    def __init__(self, diagonal: Diagonal, parts: Sequence[SolidPart]) -> None:
        self.parts, self._diagonal = parts, diagonal
        self.keeps_volume = any(part.step for part in parts)
        self.has = np.zeros(diagonal.stack.unknowns, dtype=bool)
        for part in parts:
            self.has[part.names[part.names >= 0]] = True
        own = np.full(diagonal.stack.unknowns + 1, -1)
        own[:-1][self.has] = np.arange(np.count_nonzero(self.has))
        pieces = [(piece, part) for part in parts for piece in diagonal.pieces(part)]
        self._pieces = [(piece, part.step) for piece, part in pieces]
        local = [own[piece.unknowns] for piece, _ in pieces]
        most = max(names.shape[1] for names in local)
        # Smaller elements get unknowns that are fixed, so that all have the same number.
        missing = [((0, 0), (0, most - names.shape[1])) for names in local]
        padded = [np.pad(names, pad, constant_values=-1) for names, pad in zip(local, missing, strict=True)]
        self._unknowns = np.concatenate(padded)
        self._coordinates = np.concatenate([piece.places for piece, _ in pieces])
        self._starts = np.cumsum([0, *map(len, local)])
        self._alike = None if diagonal.halves else self._cells()

    def _cells(self) -> Alike | None:
        """Cells of these parts that are alike."""
        stack, kinds = self._diagonal.stack, sorted({part.name for part in self.parts})
        x, y, _, z = self._coordinates.T
        places = np.stack([*stack.from_axis(x, y), z], axis=1)
        parts = np.concatenate([np.full(part.body.count, kinds.index(part.name)) for part in self.parts])
        cells = np.concatenate([stack.cells(part) for part in self.parts])
        return alike(
            self._unknowns, cells, np.column_stack([parts, np.round(places / (SAME * np.ptp(x))).astype(np.intp)])
        )

    def condensed(
        self, contact: NDArray[np.bool_], loads: Callable[[float], Floats], remembers: bool = False
    ) -> Condensed:
        """What is left on the contact.

        Args:
            contact: (unknowns,), the unknowns of the stack that are kept.
            loads: function that gives the loads (unknowns, loads) at an addition to 1/λ, in steps of each part.
            remembers: as in `elimination.condense`.

        Raises:
            EstimateError: as in `elimination.condense`.
        """
        if not self.keeps_volume:
            return self._at(0.0, contact, loads, remembers)
        if remembers:
            return self._at(1.0, contact, loads, remembers)
        return extrapolated(lambda added: self._at(added, contact, loads, remembers), 1.0)

    def cost(self, contact: NDArray[np.bool_], loads: int) -> Cost:
        """What `condensed` will cost, with a number of loads."""
        kept = contact[self.has]
        mesh = ElementSystem(
            self._unknowns, self._coordinates, lambda _: [], kept, np.broadcast_to(0.0, (len(kept), loads))
        )
        one = cost_of(mesh) if self._alike is None else costs(mesh, self._alike)
        return total([one] * (len(NODES) if self.keeps_volume else 1))

    def _at(
        self, added: float, contact: NDArray[np.bool_], loads: Callable[[float], Floats], remembers: bool
    ) -> Condensed:
        def matrices(elements: Names) -> list[Floats]:
            found: dict[int, Floats] = {}
            for (start, stop), (piece, step) in zip(pairwise(self._starts), self._pieces, strict=True):
                own = elements[(elements >= start) & (elements < stop)]
                if len(own):
                    found |= zip(own.tolist(), piece.stiffness(own - start, added * step), strict=True)
            return [found[element] for element in elements.tolist()]

        forces = self._diagonal.turned(loads(added))
        mesh = ElementSystem(self._unknowns, self._coordinates, matrices, contact[self.has], forces[self.has])
        return condense(mesh, remembers) if remembers or self._alike is None else condensed(mesh, self._alike)


# --- sensor and object -----------------------------------------------------------------------------------

# A rigid motion of the object that strains it by less than this share does not strain it at all.
RIGID = 1e-6


class System:
    """A sensor with an object, on one mesh.

    Attributes:
        parameters: the sensor; neither the object's modulus nor the force count.
        mirrored: whether half of the length, and half of the width, is solved for the whole.
        copies: how many of what is solved are the whole.
        stack: the sensor's parts, with an object of 1 Pa.
        contact: (unknowns,), whether an unknown is shared by the object and the rest.
        polarised: forces on the unknowns by each film under 1 V [N/V].

    Args:
        mirrored: which halves are solved for the whole; every load must allow it. None: as the parameters' own load
            allows.
    """

    @single()
    def __init__(
        self, parameters: SolidParameters, resolution: Resolution, mirrored: tuple[bool, bool] | None = None
    ) -> None:
        start = time.process_time()
        self.parameters = parameters
        self.mirrored = symmetry(parameters) if mirrored is None else mirrored
        self.stack = SolidStack(replace(parameters, sensed_modulus=1.0), resolution, self.mirrored)
        self.copies = 2.0 ** sum(self.mirrored)
        asked = self._goals = goals(parameters, self.stack, self.mirrored)
        self.polarised = [electrode.forces(self.stack) for electrode in asked.electrodes]
        volts = np.array([[e.charge(self.stack, work) for work in asked.works] for e in asked.electrodes])
        self._volts = volts.reshape(len(asked.electrodes), len(asked.works)) @ asked.shares.T
        rest = [part for part in self.stack.parts if part is not self.stack.object]
        self._diagonal = Diagonal(self.stack)
        self._sensor, self._sensed = (
            Substructure(self._diagonal, rest),
            Substructure(self._diagonal, [self.stack.object]),
        )
        self.contact = self._sensor.has & self._sensed.has
        self._built = time.process_time() - start

    def load(self, load_at: tuple[float, float] | None) -> Floats:
        """Forces of 1 N in all on the unknowns, by a point load, or by a uniform pressure or platen."""
        p, body = self.parameters, self.stack.object.body
        if load_at is None:
            weights = body.plan.integrals / p.load_area
        else:
            nodes, values = locate(self.stack.basis, load_at)
            weights = np.zeros(len(body.plan.nodes))
            weights[np.searchsorted(body.plan.nodes, nodes)] = values / 2 ** sum(self.mirrored)
        return self.forces(2, -1, -weights)

    def forces(self, axis: int, level: int, weights: Floats) -> Floats:
        """Forces on the unknowns by those on the object's nodes at one height, along one axis."""
        names = self.stack.object.names[axis, level]
        load = np.zeros(self.stack.unknowns + 1)
        np.add.at(load, names, weights)
        return load[:-1]

    def works(self, of: Sequence[SolidPart], added: float) -> Floats:
        """Goals as forces (unknowns, goals), as far as they are works of these parts; added: as in `Work.forces`."""
        found = [
            work.forces(self.stack.unknowns, added) if work.part in of else np.zeros(self.stack.unknowns)
            for work in self._goals.works
        ]
        columns: Floats = np.stack(found, axis=1) @ self._goals.shares.T / self.copies
        return columns

    def cost(self, loads: int = 1) -> Cost:
        """What `curve` will cost, with a number of loads."""
        goals, films = len(self._goals.shares) - 1, len(self.polarised)
        contact = int(np.count_nonzero(self.contact))
        both = self._sensor.cost(self.contact, films + goals + 1) + self._sensed.cost(self.contact, loads + goals + 1)
        return replace(both + Cost(operations(contact, loads, goals + films)), unknowns=self.stack.unknowns)

    def curve(self, loads: Sequence[Floats]) -> SolidCurve:
        """Answers to loads on the object's unknowns.

        Raises:
            EstimateError: a mesh does not fit into memory, or its stiffness is singular to working precision.
        """
        with single():
            return interruptible(lambda: self._curve(loads))

    def _curve(self, loads: Sequence[Floats]) -> SolidCurve:
        start = time.process_time()
        asked = self._goals
        sensor_side, sensed_side = (self._condensed(side, loads) for side in (self._sensor, self._sensed))
        sensor = self._open(sensor_side)
        rows = sensor.rows(slice(len(asked.electrodes), None), self._volts)
        own, teeth = slice(0, len(loads)), rows.shape[1] - 1
        offsets = np.zeros((rows.shape[1], len(loads)))
        least = 0.0
        if self.stack.over_teeth(self.stack.ring.body).any():  # a closed gap tears the ring from the tooth
            least = sensor.torn(rows[:, -1], teeth + len(asked.electrodes), self._volts[:, -1], self._energy_of_jump())
        if self.parameters.support == "rigid":
            through, offsets = self._through_teeth(sensed_side, loads)
            rows -= sensor.stiffness @ through
        sensed = Condensed(sensed_side.stiffness, sensed_side.loads[:, own], sensed_side.work[own, own])
        share = 1.0 if self.parameters.support == "rigid" else 0.0
        return SolidCurve(
            poles=curve(
                sensor,
                sensed,
                self._modes(),
                rows[:, :-1],
                offsets[:-1],
                rows[:, -1],
                share,
                least,
                self.parameters.compliant_modulus,
            ),
            films=asked.films / self.copies,
            teeth=asked.teeth,
            bases=asked.bases,
            unknowns=self.stack.unknowns,
            seconds=(self._built, time.process_time() - start),
        )

    def _condensed(self, side: Substructure, loads: Sequence[Floats], remembers: bool = False) -> Condensed:
        """What is left on the contact of one side of the whole sensor, of which a half or a quarter may be solved.

        Its loads are those of its own films under 1 V, or those on the object, and then those of the goals.
        """
        own = loads if side is self._sensed else self.polarised
        one = side.condensed(
            self.contact, lambda added: np.column_stack([*own, self.works(side.parts, added)]), remembers
        )
        copies = self.copies
        return Condensed(copies * one.stiffness, copies * one.loads, copies * one.work, one.inside)

    def _energy_of_jump(self) -> float:
        """Twice the energy of a jump by 1 m over all teeth with all unknowns held, as far as it is the sensor's [J]."""
        asked, of = self._goals, self._sensor

        def energy(added: float) -> float:
            pairs = zip(asked.shares[-1].tolist(), asked.works, strict=True)
            return sum((share * work.energy(added) for share, work in pairs if work.part in of.parts), 0.0)

        # As `condensed` does it: with the true compliance, a volume that is kept would make this infinite.
        return extrapolated_number(energy, 1.0) if of.keeps_volume else energy(0.0)

    def _through_teeth(self, sensed_side: Condensed, loads: Sequence[Floats]) -> tuple[Floats, Floats]:
        """Displacements w of the contact (contact, goals), and offsets (goals, loads), for forces on rigid teeth.

        These follow from those of the ring on the object: w S1 E u = w (f - S0 u). For all teeth together w is the
        object's own motion, so that no rounding counts.
        """
        asked, count = self._goals, len(loads)
        teeth = slice(count, count + asked.teeth)
        through = np.linalg.solve(sensed_side.stiffness, sensed_side.loads[:, teeth])
        offsets = through.T @ sensed_side.loads[:, :count] + sensed_side.work[teeth, :count]
        part = self.stack.object
        sinking = np.zeros(self.stack.unknowns + 1)
        sinking[part.names[2]] = -np.multiply.outer(part.body.height.one, self.stack.one[part.body.plan.nodes])
        whole = self._diagonal.turned(sinking[:-1])[self.contact]
        forces = self.copies * np.array([sinking[:-1] @ load for load in loads])
        through += (whole - through.sum(axis=1))[:, None] / asked.teeth
        offsets += (forces - offsets.sum(axis=0)) / asked.teeth
        each, together = np.eye(asked.teeth), np.ones((asked.teeth, 1))
        on_goals = np.concatenate([each, each if asked.bases > 1 else together, together], axis=1)
        return through @ on_goals, on_goals.T @ offsets

    def displacement(self, load: Floats) -> Floats:
        """Displacements (unknowns,) under a load on the object, with its modulus in the parameters.

        The compliance of a part that keeps its volume is the least that its elements bear.

        Raises:
            EstimateError: as in `curve`.
        """
        modulus = self.parameters.sensed_modulus
        with single():
            sensor_side, sensed_side = interruptible(
                lambda: [self._condensed(side, [load], remembers=True) for side in (self._sensor, self._sensed)]
            )
        sensor = self._open(sensor_side)
        stiffness = sensor.stiffness + modulus * sensed_side.stiffness
        moved = np.asarray(np.linalg.solve(stiffness, sensed_side.loads[:, 0]), dtype=np.float64)
        voltages = sensor.capacity @ (sensor.charges.T @ moved)
        found = np.zeros(self.stack.unknowns)
        for side, of, factors in (
            (self._sensor, sensor_side, -voltages),
            (self._sensed, sensed_side, np.array([1 / modulus])),
        ):
            assert of.inside is not None
            weights = np.zeros(of.loads.shape[1])
            weights[: len(factors)] = factors
            found[side.has] = of.inside(moved, weights)
        return self._diagonal.turned(found)

    def forces_below_object(self, moved: Floats) -> Floats:
        """Forces (elements of the plan, shapes) [N] along z on the shape functions of the object's lower side.

        Args:
            moved: displacements of all unknowns, as `displacement` gives them.
        """
        part = self.stack.object
        body, height = part.body, part.body.height
        lowest = np.arange(0, body.count, len(height.local))
        own = np.append(moved, 0.0)[body.local(part.names, lowest)]
        forces = self.parameters.sensed_modulus * (body.stiffness(lowest, part.step) @ own[..., None])
        side = np.flatnonzero(height.local[0] == 0)[0]
        found: Floats = forces.reshape(len(lowest), 3, height.local.shape[1], -1)[:, 2, side]
        return found

    def _open(self, side: Condensed) -> Sensor:
        p = self.parameters
        areas = [self.copies * electrode.area for electrode in self._goals.electrodes]
        films = slice(0, len(areas))
        return Sensor(side, films, np.array([capacitance(p.film, area, p.film_thickness) for area in areas]))

    def _modes(self) -> Floats:
        """Displacements of the contact (contact, modes) by which the object moves freely as a rigid body."""
        part, stack = self.stack.object, self.stack
        body = part.body
        plan = [coefficients[body.plan.nodes] for coefficients in (stack.one, *stack.places)]
        one, x, y = (np.multiply.outer(body.height.one, coefficients) for coefficients in plan)
        z = np.multiply.outer(body.height.places, plan[0])
        x, y, z = (place - place[one == 1].mean() * one for place in (x, y, z))
        none = np.zeros_like(one)
        moved = np.array(
            [[one, none, none], [none, one, none], [none, none, one], [-y, x, none], [z, none, -x], [none, z, -y]]
        ).reshape(6, -1)
        moved /= np.abs(moved).max(axis=1, keepdims=True)
        names = part.names.ravel()
        free = names >= 0
        counts = np.bincount(names[free], minlength=stack.unknowns)
        means = np.array([np.bincount(names[free], motion[free], stack.unknowns) for motion in moved])
        means /= np.maximum(counts, 1)
        # Held unknowns stay where they are, and all places of one unknown move alike.
        strained = np.where(free, moved - means[:, names], moved)
        _, sizes, kinds = np.linalg.svd(strained.T, full_matrices=False)
        modes = (kinds[sizes < RIGID] @ means).T
        return self._diagonal.turned(modes)[self.contact]


def symmetry(parameters: SolidParameters) -> tuple[bool, bool]:
    """Whether sensor and load are symmetric about the middle of the length, and of the width."""
    if parameters.load_at is None:
        return True, True
    x, y = parameters.load_at
    length, width = parameters.length, parameters.width
    return abs(x - length / 2) < 1e-9 * length, abs(y - width / 2) < 1e-9 * width


# --- displacements and contact pressure in the plane through the teeth's axes ----------------------------

POINTS = np.linspace(0.0, 1.0, 5)  # number of points along a side of an element
GAUSS = (np.polynomial.legendre.leggauss(5)[0] + 1) / 2


@dataclass(frozen=True, slots=True)
class SectionField:
    """Displacements of a piece of a body on a grid of points of the section.

    Attributes:
        x, z: (columns, rows), undeformed points from the object's corner and from the sensor's face [m].
        along, up: (columns, rows), displacements along x and z [m].
    """

    x: Floats
    z: Floats
    along: Floats
    up: Floats


@dataclass(frozen=True, slots=True)
class SolidSection:
    """Section in the plane y = constant through the axes of the middle row of teeth; of two rows, the upper one.

    Attributes:
        bodies: pieces of each body by its name, by rising x.
        x: points on the sensor's face that the object touches, from the object's corner [m].
        pressure: pressure of the object there, positive in compression [Pa]. It is singular where tooth and ring end.
    """

    bodies: Mapping[str, tuple[SectionField, ...]]
    x: Floats
    pressure: Floats


def section(p: SolidParameters, refinement: int) -> SolidSection:
    """Solve the solid model, and return displacements and pressure in the plane through the teeth's axes.

    Args:
        p: the sensor, the object and the load.
        refinement: refinement of the mesh; a greater one is finer.

    Raises:
        RangeError, EstimateError: as in `palpate.instrument.models.solid.model.solve`.
    """
    system = System(p, resolution(p, refinement))
    judge(system.cost(), "take a coarser mesh")
    stack, moved = system.stack, p.force * system.displacement(system.load(p.load_at))
    height = (p.rows // 2 + 0.5) * p.cell_width
    line, face = (_ElementLine(stack, height, points) for points in (POINTS, GAUSS))
    bodies: dict[str, list[SectionField]] = {}
    for part in stack.parts:
        bodies.setdefault(part.name, []).extend(_pieces(line, part, moved))
    x, pressure = _pressure(face, system, moved)
    if system.mirrored[0]:
        bodies = {name: _mirrored(pieces, p.length) for name, pieces in bodies.items()}
        x, pressure = np.concatenate([p.length - x[::-1], x]), np.concatenate([pressure[::-1], pressure])
    return SolidSection({name: tuple(pieces) for name, pieces in bodies.items()}, x, pressure)


class _ElementLine:
    """Sides of the plan's elements on a line along x, by rising x.

    Attributes:
        elements: element of the plan for each side.
        x: (sides, points), positions [m].
        values: (sides, points, shapes), values of the shape functions.
        names: (sides, shapes), names of the shape functions in the plan.
    """

    def __init__(self, stack: SolidStack, height: float, points: Floats) -> None:
        mesh = stack.plan.mesh
        x, y = mesh.p[:, mesh.facets]
        negligible = 1e-9 * mesh.p.max()
        # Beside a ring as wide as its cell there are sides of zero length.
        facets = np.flatnonzero((np.abs(y - height).max(axis=0) < negligible) & (np.ptp(x, axis=0) > negligible))
        facets = facets[np.argsort(mesh.p[0, mesh.facets[:, facets]].mean(axis=0))]
        quadrature = (points[None], np.full(len(points), 1 / len(points)))
        basis: Any = FacetBasis(mesh, stack.basis.elem, facets=facets, quadrature=quadrature)
        self.elements = np.asarray(basis.tind)
        self.x = np.asarray(basis.global_coordinates())[0]
        shapes = [np.broadcast_to(np.asarray(field[0]), self.x.shape) for field in basis.basis]
        order = np.argsort(self.x, axis=1)
        self.x = np.take_along_axis(self.x, order, axis=1)
        self.values = np.stack([np.take_along_axis(shape, order, axis=1) for shape in shapes], axis=-1)
        self.names = stack.basis.element_dofs[:, self.elements].T


def _pieces(line: _ElementLine, part: SolidPart, moved: Floats) -> list[SectionField]:
    body = part.body
    sides = np.flatnonzero(np.isin(line.elements, body.plan.elements))
    if not len(sides):
        return []
    basis = height_basis(body.height.breaks, body.height.degree, POINTS)
    z = np.asarray(basis.global_coordinates())[0]
    upright = np.stack([np.broadcast_to(np.asarray(field[0]), z.shape) for field in basis.basis], axis=-1)
    given = np.append(moved, 0.0)[part.names]
    nodes = np.searchsorted(body.plan.nodes, line.names[sides])
    local = given[:, body.height.local[:, :, None, None], nodes[None, None]]
    sampled = np.einsum("csmfn,fqn,srm->cfqsr", local, line.values[sides], upright, optimize=True)
    breaks = np.flatnonzero(line.x[sides[1:], 0] - line.x[sides[:-1], -1] > 1e-9 * np.ptp(line.x)) + 1
    pieces = []
    for piece in np.split(np.arange(len(sides)), breaks):
        x, heights = np.meshgrid(line.x[sides[piece]].ravel(), z.ravel(), indexing="ij")
        along, _, up = sampled[:, piece].reshape(3, *x.shape)
        pieces.append(SectionField(x, heights, along, up))
    return pieces


def _mirrored(pieces: list[SectionField], length: float) -> list[SectionField]:
    """All pieces of a body, from its half at greater x. A piece that lies on the middle is made whole."""
    whole = list(pieces)
    for piece in pieces:
        x, z, along, up = (array[::-1] for array in (length - piece.x, piece.z, -piece.along, piece.up))
        if abs(piece.x[0, 0] - length / 2) < 1e-9 * length:
            whole.remove(piece)
            joined = (
                np.concatenate(pair) for pair in ((x, piece.x), (z, piece.z), (along, piece.along), (up, piece.up))
            )
            whole.insert(0, SectionField(*joined))
        else:
            whole.insert(0, SectionField(x, z, along, up))
    return whole


def _pressure(line: _ElementLine, system: System, moved: Floats) -> tuple[Floats, Floats]:
    """The pressure whose work on every shape function of the face is that of the object's forces on it."""
    stack = system.stack
    body = stack.object.body
    faces = PlanElements(stack.basis, np.flatnonzero(stack.touching), 1)
    forces = np.zeros(stack.basis.N)
    np.add.at(forces, body.plan.nodes[body.plan.local], system.forces_below_object(moved))
    rows, columns = np.broadcast_arrays(faces.local[:, :, None], faces.local[:, None, :])
    mass = sparse.csc_array((faces.products[:, 2, 2].ravel(), (rows.ravel(), columns.ravel())))
    scale = 1 / np.sqrt(mass.diagonal())
    scaling = sparse.diags_array(scale)
    coefficients = scale * spsolve(sparse.csc_array(scaling @ mass @ scaling), scale * forces[faces.nodes])
    sides = np.flatnonzero(np.isin(line.elements, faces.elements))
    nodes = np.searchsorted(faces.nodes, line.names[sides])
    pressure = np.einsum("fqn,fn->fq", line.values[sides], coefficients[nodes])
    return line.x[sides].ravel(), pressure.ravel()
