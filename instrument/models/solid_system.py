"""The linear system of the solid model: its parts, how they are joined, held and loaded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from instrument.errors import EstimateError
from instrument.models.linear_solver import SymmetricSolver
from instrument.models.solid_body import Body, Elastic, HeightMatrices, PlanMatrices, plan_basis
from instrument.models.solid_mesh import OVERHANG, RING, TOOTH, Cell, Resolution, graded, locate, plan_mesh

if TYPE_CHECKING:
    from instrument.models.solid import SolidParameters

Vector = NDArray[np.float64]
Names = NDArray[np.intp]

HELD, UNNAMED = -1, -2
ALL, NORMAL = (0, 1, 2), (2,)
PRESSURE_STEPS = 60
PRESSURE_LIMIT = 1e-10


def resolution(refinement: int) -> Resolution:
    """The mesh of a refinement."""
    return Resolution(layers=refinement + 1, ratio=0.3, sectors=1 + (refinement + 1) // 2)


@dataclass(frozen=True, slots=True)
class Part:
    """A body with the names of its unknowns, shape (3, nodes of the plan, heights), HELD where fixed."""

    body: Body
    names: Names

    def displacement(self, solution: Vector) -> Vector:
        """Shape (3 n,), zero where held."""
        return np.append(solution, 0.0)[self.names.ravel()]


class System:
    """Assembled and factorised for one sensor; any number of loads on its planes of symmetry.

    Args:
        load_at: loads off a plane of symmetry need the whole of that direction.

    Raises:
        EstimateError: the system is singular to working precision.
        UnknownName: the solver is not installed.
    """

    def __init__(
        self, parameters: SolidParameters, refinement: int, solver: str = "", mirrored: tuple[bool, bool] | None = None
    ) -> None:
        self._parameters = parameters
        self._resolution = resolution(refinement)
        self._mirrored = symmetry(parameters) if mirrored is None else mirrored
        self._plan = plan_mesh(_cell(parameters), self._quarters(), self._resolution)
        self._basis = plan_basis(self._plan)
        self._matrices: dict[bytes, PlanMatrices] = {}
        self._points: list[Vector] = []
        self._parts: list[Part] = []
        self.unknowns = 0
        self._build()
        self._solver = self._factorise(solver)

    def forces(self, load_at: tuple[float, float] | None) -> tuple[Vector, float, float]:
        """Force on each tooth, shape (rows, columns), total force on the floor [N], residual of the system."""
        solution, pressures, residual = self._solve(self._load(load_at))
        p = self._parameters
        cell_of = np.empty(self._basis.N, dtype=np.intp)
        inside = self._plan.region == TOOTH
        cell_of[self._basis.element_dofs[:, inside]] = self._plan.cell[inside]
        share = 2 ** sum(self._mirrored)
        teeth = np.zeros(p.rows * p.columns)
        total = 0.0
        for part, pressure in zip(self._parts, pressures, strict=True):
            if part is not self._tooth_part and part not in self._floor_parts:
                continue
            body = part.body
            force = body.stiffness @ part.displacement(solution) + body.dilatation.T @ pressure
            below = force.reshape(body.shape)[2, :, 0]
            if part is self._tooth_part:
                stands = self._stands(body)
                np.add.at(teeth, cell_of[body.plan.nodes[stands]], below[stands])
            if part in self._floor_parts:
                total += share * below.sum()
        grid = teeth.reshape(p.rows, p.columns)
        if self._mirrored[0]:
            grid = grid + grid[:, ::-1]
        if self._mirrored[1]:
            grid = grid + grid[::-1]
        return grid, total + (grid.sum() if p.rigid else 0.0), residual

    def _quarters(self) -> dict[tuple[int, int], tuple[float, float, int]]:
        p = self._parameters
        return {
            (i, j): ((i // 2 + 0.5) * p.cell_length, (j // 2 + 0.5) * p.cell_width, j // 2 * p.columns + i // 2)
            for i in range(p.columns if self._mirrored[0] else 0, 2 * p.columns)
            for j in range(p.rows if self._mirrored[1] else 0, 2 * p.rows)
        }

    def _build(self) -> None:
        p, layers, ratio = self._parameters, self._resolution.layers, self._resolution.ratio
        plan = self._plan
        everywhere, tooth, ring = plan.region >= 0, plan.region == TOOTH, plan.region == RING
        if p.ring_shape == "square":
            ring = ring | (plan.region == OVERHANG)
        compliant = Elastic(p.compliant_modulus, p.compliant_poisson)
        both = HeightMatrices(graded(-p.ring_height, 0.0, layers, ratio, "both"))
        tooth_below: list[tuple[Part, tuple[int, ...]]] = []
        if p.rigid:
            rings = [self._add(ring, both, compliant, [], floor=True)]
            self._floor_parts = rings
        else:
            sheet = HeightMatrices(np.array([0.0, p.film_thickness]) - p.ring_height)
            plexiglas, film = Elastic(p.plate_modulus, p.plate_poisson), Elastic(p.film_modulus, p.film_poisson)
            steps = max(1, layers - 1)
            top = graded(-p.plate_thickness, 0.0, steps, ratio, "end") - p.ring_height
            bottom = np.array([-p.plate_thickness, 0.0]) + top[0] - p.film_thickness
            base_sheet = np.array([-p.film_thickness, 0.0]) + top[0]
            groups = [plan.cell == k for k in np.unique(plan.cell)] if p.separate_bases else [everywhere]
            upper, self._floor_parts = [], []
            for group in groups:
                lower = self._add(group, HeightMatrices(bottom), plexiglas, [], floor=True, base=True)
                between = self._add(group, HeightMatrices(base_sheet), film, [(lower, ALL)], base=True)
                upper.append((self._add(group, HeightMatrices(top), plexiglas, [(between, ALL)], base=True), ALL))
                self._floor_parts.append(lower)
            disc = self._add(tooth, sheet, film, upper)
            phenolic = Elastic(p.tooth_modulus, p.tooth_poisson)
            tall = HeightMatrices(graded(p.film_thickness - p.ring_height, 0.0, steps, ratio, "both"))
            tooth_below = [(self._add(tooth, tall, phenolic, [(disc, ALL)]), ALL)]
            rings = [self._add(ring, both, compliant, upper)]
            self._tooth_part = disc
        joined = ALL if p.interface == "bonded" else NORMAL
        below = [(part, joined) for part, _ in tooth_below] + [(part, joined) for part in rings]
        towards = "start" if p.load_at is None else "both"
        heights = HeightMatrices(graded(0.0, p.sensed_thickness, layers + (p.load_at is None), ratio, towards))
        self._object = self._add(
            everywhere, heights, Elastic(p.sensed_modulus, p.sensed_poisson), below, stands=joined if p.rigid else ()
        )
        if p.rigid:
            self._tooth_part = self._object

    def _add(
        self,
        elements: NDArray[np.bool_],
        height: HeightMatrices,
        material: Elastic,
        below: list[tuple[Part, tuple[int, ...]]],
        floor: bool = False,
        base: bool = False,
        stands: tuple[int, ...] = (),
    ) -> Part:
        """One more part, on the parts below, on the floor, or (`stands`) on rigid teeth."""
        key = elements.tobytes()
        if key not in self._matrices:
            self._matrices[key] = PlanMatrices(self._basis, np.flatnonzero(elements))
        body = Body(self._matrices[key], height, material)
        names = np.full(body.shape, UNNAMED, dtype=np.intp)
        self._hold_symmetry(names, body, base)
        if floor:
            names[:, :, 0] = HELD
        for axis in stands:
            names[axis, self._stands(body), 0] = HELD
        for part, axes in below:
            _, mine, its = np.intersect1d(body.plan.nodes, part.body.plan.nodes, return_indices=True)
            for axis in axes:
                free = names[axis, mine, 0] == UNNAMED
                names[axis, mine[free], 0] = part.names[axis, its[free], -1]
        if below or stands:
            self._hold_sliding(names, body)
        new = names == UNNAMED
        names[new] = self.unknowns + np.arange(new.sum())
        self.unknowns += int(new.sum())
        places = np.broadcast_to(
            np.stack(
                [
                    *np.broadcast_arrays(body.plan.places[0][:, None], body.plan.places[1][:, None], height.places),
                ]
            )[:, None],
            (3, *body.shape),
        )
        self._points.append(places[:, new])
        part = Part(body, names)
        self._parts.append(part)
        return part

    def _stands(self, body: Body) -> NDArray[np.bool_]:
        """Nodes of the plan of a body that lie over a tooth."""
        over = np.unique(self._basis.element_dofs[:, self._plan.region == TOOTH])
        return np.isin(body.plan.nodes, over)

    def _hold_symmetry(self, names: Names, body: Body, base: bool) -> None:
        p = self._parameters
        lattice = ((p.length, p.columns), (p.width, p.rows))
        for axis, (size, cells) in enumerate(lattice):
            cut_between = base and p.separate_bases and cells % 2 == 0
            if self._mirrored[axis] and not cut_between:
                names[axis, np.abs(body.plan.places[axis] - size / 2) < 1e-9 * size] = HELD

    def _hold_sliding(self, names: Names, body: Body) -> None:
        """Hold what nothing else holds of an object that slides: translation, and rotation about z."""
        if self._parameters.interface == "bonded" or body.material != Elastic(
            self._parameters.sensed_modulus, self._parameters.sensed_poisson
        ):
            return
        far = int(np.argmax(body.plan.places[0]))
        if not self._mirrored[0]:
            names[0, 0, -1] = HELD
        if not self._mirrored[1]:
            names[1, 0, -1] = HELD
        if not any(self._mirrored):
            names[1, far, -1] = HELD

    def _factorise(self, solver: str) -> SymmetricSolver:
        rows, columns, values = [], [], []
        for part in self._parts:
            matrix = part.body.stiffness.tocoo()
            names = part.names.ravel()
            row, column = names[matrix.row], names[matrix.col]
            free = (row >= 0) & (column >= 0)
            rows.append(row[free])
            columns.append(column[free])
            values.append(matrix.data[free])
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        matrix = sparse.csc_array(entries, shape=(self.unknowns, self.unknowns))
        return SymmetricSolver(matrix, np.concatenate(self._points, axis=1), solver)

    def _load(self, load_at: tuple[float, float] | None) -> Vector:
        p, body = self._parameters, self._object.body
        if load_at is None:
            weights = np.asarray(body.plan.mass.sum(axis=1)).ravel() / (p.length * p.width)
        else:
            nodes, values = locate(self._basis, load_at)
            weights = np.zeros(len(body.plan.nodes))
            weights[np.searchsorted(body.plan.nodes, nodes)] = values / 2 ** sum(self._mirrored)
        load = np.zeros(self.unknowns)
        np.subtract.at(load, self._object.names[2, :, -1], p.force * weights)
        return load

    def _solve(self, load: Vector) -> tuple[Vector, list[Vector], float]:
        """Displacements, the pressures that the matrix does not carry, and the residual.

        λ is limited in the matrix; the rest of the pressure follows by iteration, which contracts by about the
        limit's inverse and serves Poisson ratio 0.5 as well.
        """
        pressures = [np.zeros(part.body.dilatation.shape[0]) for part in self._parts]
        for _ in range(PRESSURE_STEPS):
            rest = np.append(load, 0.0)
            for part, pressure in zip(self._parts, pressures, strict=True):
                if part.body.material.pressure_left > 0:
                    np.subtract.at(rest, part.names.ravel(), part.body.dilatation.T @ pressure)
            solution, residual = self._solver(rest[:-1])
            change = size = 0.0
            for k, part in enumerate(self._parts):
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


def _cell(parameters: SolidParameters) -> Cell:
    return Cell(
        half_length=parameters.cell_length / 2,
        half_width=parameters.cell_width / 2,
        tooth_radius=parameters.tooth_radius,
        inner_radius=parameters.ring_inner_radius,
        outer_radius=parameters.ring_outer_radius,
    )
