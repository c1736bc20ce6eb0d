"""The linear system of the solid model: assembled, factorised, and solved for one load after another."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from instrument.errors import EstimateError
from instrument.models.linear_solver import SymmetricSolver
from instrument.models.parameters import SolidParameters
from instrument.models.solid_mesh import Resolution, locate
from instrument.models.solid_parts import Stack

Vector = NDArray[np.float64]

# By refinement. Layers and degree rise together: more layers alone leave the error of the wide steps between
# the edges, a higher degree alone that of the edges.
RESOLUTIONS = (
    Resolution(layers=2, ratio=0.2, sectors=1, degree=2),
    Resolution(layers=2, ratio=0.2, sectors=1, degree=3),
    Resolution(layers=3, ratio=0.2, sectors=2, degree=3),
    Resolution(layers=4, ratio=0.2, sectors=2, degree=3),
)
PRESSURE_STEPS = 60
PRESSURE_LIMIT = 1e-10


class System:
    """Factors of one sensor's stiffness; any number of loads.

    Args:
        mirrored: whether half of the length, and of the width, stands for the whole; every load must allow it.
            None finds out from the parameters' own load.

    Raises:
        EstimateError: the system is singular to working precision.
        UnknownName: the solver is not installed.
    """

    def __init__(
        self, parameters: SolidParameters, refinement: int, solver: str = "", mirrored: tuple[bool, bool] | None = None
    ) -> None:
        self._parameters = parameters
        self._mirrored = symmetry(parameters) if mirrored is None else mirrored
        self._stack = Stack(parameters, RESOLUTIONS[refinement], self._mirrored)
        self._solver = SymmetricSolver(self._stiffness(), solver)

    @property
    def unknowns(self) -> int:
        """Displacements solved for."""
        return self._stack.unknowns

    def forces(self, load_at: tuple[float, float] | None) -> tuple[Vector, float, float]:
        """Force on each tooth, shape (rows, columns), total force on the floor [N], residual of the system."""
        p, stack = self._parameters, self._stack
        solution, pressures, residual = self.solve(self.load(load_at))
        teeth = np.zeros(p.rows * p.columns)
        total = 0.0
        for part, pressure in zip(stack.parts, pressures, strict=True):
            at_floor = any(part is floor for floor in stack.floor)
            if part is not stack.tooth and not at_floor:
                continue
            body = part.body
            force = body.stiffness @ part.displacement(solution) + body.dilatation.T @ pressure
            below = force.reshape(body.shape)[2, :, 0] * stack.one[body.plan.nodes]
            if part is stack.tooth:
                over = stack.over_teeth(body)
                np.add.at(teeth, stack.cell_of_node()[body.plan.nodes[over]], below[over])
            if at_floor:
                total += 2 ** sum(self._mirrored) * float(below.sum())
        grid = teeth.reshape(p.rows, p.columns)
        if self._mirrored[0]:
            grid = grid + grid[:, ::-1]
        if self._mirrored[1]:
            grid = grid + grid[::-1]
        return grid, total + (float(grid.sum()) if p.support == "rigid" else 0.0), residual

    def _stiffness(self) -> sparse.csc_array:
        rows, columns, values = [], [], []
        for part in self._stack.parts:
            matrix = part.body.stiffness.tocoo()
            names = part.names.ravel()
            row, column = names[matrix.row], names[matrix.col]
            free = (row >= 0) & (column >= 0)
            rows.append(row[free])
            columns.append(column[free])
            values.append(matrix.data[free])
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        return sparse.csc_array(entries, shape=(self.unknowns, self.unknowns))

    def load(self, load_at: tuple[float, float] | None) -> Vector:
        """Forces on the unknowns [N] by a point load, or by a uniform pressure or platen."""
        p, body = self._parameters, self._stack.object.body
        if load_at is None:
            weights = body.plan.integrals / p.load_area
        else:
            nodes, values = locate(self._stack.basis, load_at)
            weights = np.zeros(len(body.plan.nodes))
            weights[np.searchsorted(body.plan.nodes, nodes)] = values / 2 ** sum(self._mirrored)
        load = np.zeros(self.unknowns)
        np.subtract.at(load, self._stack.object.names[2, :, -1], p.force * weights)
        return load

    def solve(self, load: Vector) -> tuple[Vector, list[Vector], float]:
        """Displacements, the pressures that the matrix does not carry, and the residual.

        λ is limited in the matrix; the rest of the pressure follows by iteration, which contracts by about the
        limit's inverse and serves Poisson ratio 0.5 as well.
        """
        pressures = [np.zeros(part.body.dilatation.shape[0]) for part in self._stack.parts]
        for _ in range(PRESSURE_STEPS):
            rest = np.append(load, 0.0)
            for part, pressure in zip(self._stack.parts, pressures, strict=True):
                if part.body.material.pressure_left > 0:
                    np.subtract.at(rest, part.names.ravel(), part.body.dilatation.T @ pressure)
            solution, residual = self._solver(rest[:-1])
            change = size = 0.0
            for k, part in enumerate(self._stack.parts):
                material = part.body.material
                if material.pressure_left > 0:
                    carried = material.lame * (part.body.dilatation @ part.displacement(solution))
                    new = material.pressure_left * (carried + pressures[k])
                    change = max(change, float(np.max(np.abs(new - pressures[k]))))
                    size = max(size, float(np.max(np.abs(new))))
                    pressures[k] = new
            if change <= PRESSURE_LIMIT * size:
                return solution, pressures, residual
        raise EstimateError(
            f"the pressure of a nearly incompressible part did not settle: change {change / size:.1e} after "
            f"{PRESSURE_STEPS} steps, limit {PRESSURE_LIMIT:g}; lower its Poisson ratio"
        )


def symmetry(parameters: SolidParameters) -> tuple[bool, bool]:
    """Whether sensor and load are symmetric about the middle of the length, and of the width."""
    if parameters.load_at is None:
        return True, True
    x, y = parameters.load_at
    length, width = parameters.length, parameters.width
    return abs(x - length / 2) < 1e-9 * length, abs(y - width / 2) < 1e-9 * width
