"""The linear system of the solid model: assembled, factorised, and solved for one load after another."""

from __future__ import annotations

from dataclasses import dataclass

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
    Resolution(layers=3, ratio=0.2, sectors=1, degree=3),
    Resolution(layers=4, ratio=0.2, sectors=1, degree=3),
)
PRESSURE_STEPS = 60
PRESSURE_LIMIT = 1e-10


@dataclass(frozen=True, slots=True)
class Solved:
    """Answer to one load.

    Attributes:
        displacement: of the unknowns [m].
        pressures: by part, what the matrix does not carry: (elements, steps, pressures), of size 0 if it carries all.
        residual: of the linear system, relative to the size of its terms.
    """

    displacement: Vector
    pressures: list[Vector]
    residual: float


class System:
    """Factors of one sensor's stiffness; any number of loads.

    Attributes:
        stack: the sensor's parts.

    Args:
        mirrored: whether half of the length, and of the width, stands for the whole; every load must allow it.
            None finds out from the parameters' own load.

    Raises:
        EstimateError: the system is singular to working precision.
        UnknownName: the solver is not installed.
    """

    def __init__(
        self,
        parameters: SolidParameters,
        resolution: Resolution,
        solver: str = "",
        mirrored: tuple[bool, bool] | None = None,
    ) -> None:
        self.parameters = parameters
        self.mirrored = symmetry(parameters) if mirrored is None else mirrored
        self.stack = Stack(parameters, resolution, self.mirrored)
        self._solver = SymmetricSolver(self._stiffness(), solver)

    @property
    def unknowns(self) -> int:
        """Displacements solved for."""
        return self.stack.unknowns

    def _stiffness(self) -> sparse.csc_array:
        size = self.unknowns
        total = sparse.csc_array((size, size))
        for part in self.stack.parts:
            names = part.body.local(part.names).astype(np.int32)
            names = names.reshape(-1, names.shape[-1])
            rows, columns = np.broadcast_arrays(names[:, :, None], names[:, None, :])
            free = (rows >= 0) & (columns >= 0)
            entries = part.body.stiffness().reshape(rows.shape)[free]
            total = total + sparse.coo_array((entries, (rows[free], columns[free])), shape=(size, size)).tocsc()
        return total

    def load(self, load_at: tuple[float, float] | None) -> Vector:
        """Forces on the unknowns [N] by a point load, or by a uniform pressure or platen."""
        p, body = self.parameters, self.stack.object.body
        if load_at is None:
            weights = body.plan.integrals / p.load_area
        else:
            nodes, values = locate(self.stack.basis, load_at)
            weights = np.zeros(len(body.plan.nodes))
            weights[np.searchsorted(body.plan.nodes, nodes)] = values / 2 ** sum(self.mirrored)
        load = np.zeros(self.unknowns)
        np.subtract.at(load, self.stack.object.names[2, -1], p.force * weights)
        return load

    def solve(self, load: Vector) -> Solved:
        """Displacements and pressures under forces on the unknowns [N].

        λ is limited in the matrix; the rest of the pressure follows by iteration, which contracts by about the
        limit's inverse and serves Poisson ratio 0.5 as well.
        """
        parts = self.stack.parts
        operators = {k: part.body.dilatation() for k, part in enumerate(parts) if part.body.material.pressure_left > 0}
        pressures = [np.zeros(operators[k].shape[:3] if k in operators else 0) for k in range(len(parts))]
        for _ in range(PRESSURE_STEPS):
            rest = np.append(load, 0.0)
            for k, operator in operators.items():
                spread = (operator.transpose(0, 1, 3, 2) @ pressures[k][..., None])[..., 0]
                np.subtract.at(rest, parts[k].body.local(parts[k].names), spread)
            solution, residual = self._solver(rest[:-1])
            change = size = 0.0
            for k, operator in operators.items():
                material = parts[k].body.material
                carried = material.lame * (operator @ parts[k].strained(solution)[..., None])[..., 0]
                new = material.pressure_left * (carried + pressures[k])
                change = max(change, float(np.max(np.abs(new - pressures[k]))))
                size = max(size, float(np.max(np.abs(new))))
                pressures[k] = new
            if change <= PRESSURE_LIMIT * size:
                return Solved(solution, pressures, residual)
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
