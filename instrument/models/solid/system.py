"""Sensor and object of the solid model, each condensed onto their contact, and the curve of both."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.cost import Cost
from palpate.instrument.models.finite_elements.coupling import capacitance
from palpate.instrument.models.finite_elements.fronts import Condensed
from palpate.instrument.models.finite_elements.incompressible import extrapolated_number
from palpate.instrument.models.finite_elements.poles import Sensor, curve
from palpate.instrument.models.finite_elements.rational import operations
from palpate.instrument.models.finite_elements.threads import interruptible, single
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.curve import Resolution, SolidCurve
from palpate.instrument.models.solid.diagonal import Diagonal
from palpate.instrument.models.solid.goals import goals
from palpate.instrument.models.solid.mesh import locate
from palpate.instrument.models.solid.parts import Part, Stack
from palpate.instrument.models.solid.side import Side

Vector = NDArray[np.float64]

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
        self.stack = Stack(replace(parameters, sensed_modulus=1.0), resolution, self.mirrored)
        self.copies = 2.0 ** sum(self.mirrored)
        asked = self._goals = goals(parameters, self.stack, self.mirrored)
        self.polarised = [electrode.forces(self.stack) for electrode in asked.electrodes]
        volts = np.array([[e.charge(self.stack, work) for work in asked.works] for e in asked.electrodes])
        self._volts = volts.reshape(len(asked.electrodes), len(asked.works)) @ asked.shares.T
        rest = [part for part in self.stack.parts if part is not self.stack.object]
        self._diagonal = Diagonal(self.stack)
        self._sensor, self._sensed = Side(self._diagonal, rest), Side(self._diagonal, [self.stack.object])
        self.contact = self._sensor.has & self._sensed.has
        self._built = time.process_time() - start

    def load(self, load_at: tuple[float, float] | None) -> Vector:
        """Forces of 1 N in all on the unknowns, by a point load, or by a uniform pressure or platen."""
        p, body = self.parameters, self.stack.object.body
        if load_at is None:
            weights = body.plan.integrals / p.load_area
        else:
            nodes, values = locate(self.stack.basis, load_at)
            weights = np.zeros(len(body.plan.nodes))
            weights[np.searchsorted(body.plan.nodes, nodes)] = values / 2 ** sum(self.mirrored)
        return self.forces(2, -1, -weights)

    def forces(self, axis: int, level: int, weights: Vector) -> Vector:
        """Forces on the unknowns by those on the object's nodes at one height, along one axis."""
        names = self.stack.object.names[axis, level]
        load = np.zeros(self.stack.unknowns + 1)
        np.add.at(load, names, weights)
        return load[:-1]

    def works(self, of: Sequence[Part], added: float) -> Vector:
        """Goals as forces (unknowns, goals), as far as they are works of these parts; added: as in `Work.forces`."""
        found = [
            work.forces(self.stack.unknowns, added) if work.part in of else np.zeros(self.stack.unknowns)
            for work in self._goals.works
        ]
        columns: Vector = np.stack(found, axis=1) @ self._goals.shares.T / self.copies
        return columns

    def cost(self, loads: int = 1) -> Cost:
        """What `curve` will cost, with a number of loads."""
        goals, films = len(self._goals.shares) - 1, len(self.polarised)
        contact = int(np.count_nonzero(self.contact))
        both = self._sensor.cost(self.contact, films + goals + 1) + self._sensed.cost(self.contact, loads + goals + 1)
        return replace(both + Cost(operations(contact, loads, goals + films)), unknowns=self.stack.unknowns)

    def curve(self, loads: Sequence[Vector]) -> SolidCurve:
        """Answers to loads on the object's unknowns.

        Raises:
            EstimateError: a mesh does not fit into memory, or its stiffness is singular to working precision.
        """
        with single():
            return interruptible(lambda: self._curve(loads))

    def _curve(self, loads: Sequence[Vector]) -> SolidCurve:
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

    def _condensed(self, side: Side, loads: Sequence[Vector], remembers: bool = False) -> Condensed:
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

    def _through_teeth(self, sensed_side: Condensed, loads: Sequence[Vector]) -> tuple[Vector, Vector]:
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

    def displacement(self, load: Vector) -> Vector:
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

    def forces_below_object(self, moved: Vector) -> Vector:
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
        found: Vector = forces.reshape(len(lowest), 3, height.local.shape[1], -1)[:, 2, side]
        return found

    def _open(self, side: Condensed) -> Sensor:
        p = self.parameters
        areas = [self.copies * electrode.area for electrode in self._goals.electrodes]
        films = slice(0, len(areas))
        return Sensor(side, films, np.array([capacitance(p.film, area, p.film_thickness) for area in areas]))

    def _modes(self) -> Vector:
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
