"""The solid model solved for one modulus at a time, from an assembled matrix, by scipy's sparse factors.

Beside which the curves by fronts and poles are tested. Pressures stay unknowns, so that nothing is extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import capacitance
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.mesh import Elastic
from palpate.instrument.models.solid.parts import SolidPart, SolidStack, goals
from palpate.instrument.models.solid.system import System

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Direct:
    """Force ratio, and voltages under 1 N of the films in the solved half or quarter [V]."""

    force_ratio: float
    voltages: Vector


def direct(
    parameters: SolidParameters,
    resolution: Resolution,
    solve: Callable[[scipy.sparse.csc_array, Vector], Vector] | None = None,
) -> Direct:
    """Solve on any mesh under the parameters' own load.

    solve: gives the solutions of a system; None: by sparse factors.
    """
    system = System(parameters, resolution)
    stack = SolidStack(parameters, resolution, system.mirrored)
    electrodes = goals(parameters, stack, system.mirrored).electrodes
    rows = [_Rows(part, stack) for part in stack.parts]
    size = stack.unknowns + sum(own.count for own in rows)
    start, entries = stack.unknowns, []
    for own in rows:
        entries += own.entries(start)
        start += own.count
    matrix = sum(scipy.sparse.coo_array(entry, shape=(size, size)).tocsc() for entry in entries)
    load = np.concatenate([system.load(parameters.load_at), np.zeros(size - stack.unknowns)])
    polarised = [np.concatenate([e.forces(stack), np.zeros(size - stack.unknowns)]) for e in electrodes]
    found = (solve or _solved)(scipy.sparse.csc_array(matrix), np.column_stack([load, *polarised]))
    forces = np.array(polarised).reshape(len(polarised), size)
    areas = np.array([electrode.area for electrode in electrodes])
    own_capacity = np.diag(capacitance(parameters.film, 1.0, parameters.film_thickness) * areas)
    voltages = np.linalg.solve(own_capacity + forces @ found[:, 1:], forces @ found[:, 0]) if len(areas) else areas
    moved = found[:, 0] - found[:, 1:] @ voltages
    start, teeth, floor = stack.unknowns, 0.0, 0.0
    sides = [(stack.tooth, 0)] + ([(stack.ring, -1)] if parameters.support == "rigid" else [])
    for own in rows:
        inner = own.forces(moved, start)
        start += own.count
        for part, level in sides:
            if part is own.part:
                teeth += own.summed(inner, level, stack.over_teeth(part.body))
        if own.part in stack.floor:
            floor += own.summed(inner, 0, np.ones(len(own.part.body.plan.nodes), dtype=bool))
    for electrode, voltage in zip(electrodes, voltages, strict=True):
        if electrode.part is stack.tooth:
            teeth -= voltage * parameters.film.stiff()[1][2] * electrode.area / parameters.film_thickness
    if parameters.support == "rigid":
        floor += teeth
    copies = 2 ** sum(system.mirrored)
    # Of a hard object's weight the rounding of this way loses a share, which the films feel as well.
    return Direct(teeth / floor, voltages / (copies * floor))


class _Rows:
    """Equations of a part: of its displacements, and of its pressures where it keeps its volume."""

    def __init__(self, part: SolidPart, stack: SolidStack) -> None:
        self.part, self._one = part, stack.one
        self.names = part.body.local(part.names)
        material = part.body.material
        self._mixed = isinstance(material, Elastic) and material.poisson > 0.49
        self._dilatation = part.body.dilatation() if self._mixed else np.empty((len(self.names), 0, 0))
        self.count = self._dilatation[..., 0].size if self._mixed else 0
        body = part.body
        if self._mixed:
            assert isinstance(material, Elastic)
            # Without the dilatation: a material of the same shear modulus and Poisson ratio 0.
            body = type(body)(body.plan, body.height, replace(material, modulus=2 * material.shear, poisson=0.0))
            self._compliance = material.compliance
        self._stiffness = body.stiffness()

    def entries(self, start: int) -> list[tuple[Vector, tuple[NDArray[np.intp], NDArray[np.intp]]]]:
        """Entries of the matrix with their rows and columns; pressures are numbered from `start` on."""
        rows, columns = np.broadcast_arrays(self.names[:, :, None], self.names[:, None, :])
        free = (rows >= 0) & (columns >= 0)
        found = [(self._stiffness[free], (rows[free], columns[free]))]
        if self._mixed:
            numbers = start + np.arange(self.count)
            spread = numbers.reshape(len(self.names), -1)
            rows, columns = np.broadcast_arrays(spread[:, :, None], self.names[:, None, :])
            free = columns >= 0
            own = self._dilatation[free]
            found += [(own, (rows[free], columns[free])), (own, (columns[free], rows[free]))]
            found.append((np.full(self.count, -self._compliance), (numbers, numbers)))
        return found

    def forces(self, moved: Vector, start: int) -> Vector:
        """Inner forces (elements, unknowns)."""
        own = np.append(moved, 0.0)[np.where(self.names >= 0, self.names, len(moved))]
        forces: Vector = (self._stiffness @ own[..., None])[..., 0]
        if self._mixed:
            pressure = moved[start : start + self.count].reshape(len(self.names), -1, 1)
            forces += (self._dilatation.transpose(0, 2, 1) @ pressure)[..., 0]
        return forces

    def summed(self, forces: Vector, level: int, nodes: NDArray[np.bool_]) -> float:
        """Force along z on some nodes of one height."""
        body = self.part.body
        weights = np.zeros(body.shape)
        weights[2, level, nodes] = self._one[body.plan.nodes[nodes]]
        return float((forces * body.local(weights)).sum())


def _solved(matrix: scipy.sparse.csc_array, loads: Vector) -> Vector:
    """Solutions of a scaled system, refined three times."""
    scale = 1 / np.sqrt(np.abs(matrix.diagonal()) + (matrix.diagonal() == 0))
    scaling = scipy.sparse.diags_array(scale)
    factors = scipy.sparse.linalg.splu(
        scipy.sparse.csc_array(scaling @ matrix @ scaling), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01
    )

    def solve(columns: Vector) -> Vector:
        found: Vector = scale[:, None] * factors.solve(scale[:, None] * columns)
        return found

    found = solve(loads)
    for _ in range(3):
        found += solve(loads - matrix @ found)
    return found
