"""The linear system of the solid model: its parts, how they are joined, held and loaded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from instrument.errors import EstimateError
from instrument.models.linear_solver import SymmetricSolver
from instrument.models.solid_body import Body, Elastic, HeightMatrices, PlanMatrices, plan_basis
from instrument.models.solid_mesh import GAP, OVERHANG, RING, TOOTH, Cell, Resolution, graded, locate, plan_mesh

if TYPE_CHECKING:
    from instrument.models.solid import SolidParameters

Vector = NDArray[np.float64]
Names = NDArray[np.intp]

HELD, UNNAMED = -1, -2
ALL, NORMAL = (0, 1, 2), (2,)
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


@dataclass(frozen=True, slots=True)
class Part:
    """A body with the names of its unknowns, shape (3, nodes of the plan, heights), HELD where fixed."""

    body: Body
    names: Names

    def displacement(self, solution: Vector) -> Vector:
        """Shape (3 n,), zero where held."""
        return np.append(solution, 0.0)[self.names.ravel()]


# A part below, and the displacements that it shares.
Join = tuple[Part, tuple[int, ...]]


class System:
    """Assembled and factorised for one sensor; any number of loads on its planes of symmetry.

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
        self._resolution = RESOLUTIONS[refinement]
        self._mirrored = symmetry(parameters) if mirrored is None else mirrored
        self._plan = plan_mesh(_cell(parameters), self._quarters(), self._resolution)
        self._basis = plan_basis(self._plan, self._resolution.degree)
        # Coefficients of the function 1: hierarchical shape functions add nothing to the corners'.
        corner = np.arange(self._basis.N) < self._plan.mesh.nvertices
        self._one = np.where(corner | (self._resolution.degree == 2), 1.0, 0.0)
        self._matrices: dict[bytes, PlanMatrices] = {}
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
            at_floor = any(part is floor for floor in self._floor_parts)
            if part is not self._tooth_part and not at_floor:
                continue
            body = part.body
            force = body.stiffness @ part.displacement(solution) + body.dilatation.T @ pressure
            below = force.reshape(body.shape)[2, :, 0] * self._one[body.plan.nodes]
            if part is self._tooth_part:
                stands = self._over_teeth(body)
                np.add.at(teeth, cell_of[body.plan.nodes[stands]], below[stands])
            if at_floor:
                total += share * below.sum()
        grid = teeth.reshape(p.rows, p.columns)
        if self._mirrored[0]:
            grid = grid + grid[:, ::-1]
        if self._mirrored[1]:
            grid = grid + grid[::-1]
        return grid, total + (grid.sum() if p.support == "rigid" else 0.0), residual

    def _quarters(self) -> dict[tuple[int, int], tuple[float, float, int]]:
        p = self._parameters
        return {
            (i, j): ((i // 2 + 0.5) * p.cell_length, (j // 2 + 0.5) * p.cell_width, j // 2 * p.columns + i // 2)
            for i in range(p.columns if self._mirrored[0] else 0, 2 * p.columns)
            for j in range(p.rows if self._mirrored[1] else 0, 2 * p.rows)
        }

    def _build(self) -> None:
        """Parts from below: plates and films, tooth, ring, object. The sensor's face is at height 0."""
        p, layers, ratio = self._parameters, self._resolution.layers, self._resolution.ratio
        region = self._plan.region
        everywhere = region != OVERHANG if p.outline == "round" else region >= 0
        ring = everywhere & (region != TOOTH) & (region != GAP) if p.ring_outline == "square" else region == RING
        foot = -p.sensor_height - p.film_thickness
        joint = ALL if p.interface == "bonded" else NORMAL
        compliant = Elastic(p.compliant_modulus, p.compliant_poisson)
        ring_heights = self._heights(graded(foot, 0.0, layers, ratio, "both"))
        if p.support == "rigid":
            self._floor_parts = [self._add(ring, ring_heights, compliant, floor=True)]
            below = [(self._floor_parts[0], joint)]
        else:
            plates = self._plates(everywhere, foot)
            steps = max(1, layers - 1)
            sheet = self._heights(np.array([foot, -p.sensor_height]))
            tall = self._heights(graded(-p.sensor_height, 0.0, steps, ratio, "both"))
            self._tooth_part = self._add(region == TOOTH, sheet, Elastic(p.film_modulus, p.film_poisson), plates)
            phenolic = Elastic(p.tooth_modulus, p.tooth_poisson)
            tooth = self._add(region == TOOTH, tall, phenolic, [(self._tooth_part, ALL)])
            below = [(tooth, joint), (self._add(ring, ring_heights, compliant, plates), joint)]
        if p.load_at is None:
            heights = graded(0.0, p.sensed_thickness, layers + 1, ratio, "start")
        else:
            heights = graded(0.0, p.sensed_thickness, layers, ratio, "both")
        self._object = self._add(
            everywhere,
            self._heights(heights),
            Elastic(p.sensed_modulus, p.sensed_poisson),
            below,
            on_teeth=joint if p.support == "rigid" else (),
            slides=p.interface == "frictionless",
            platen=p.load == "platen" and p.load_at is None,
        )
        if p.support == "rigid":
            self._tooth_part = self._object

    def _heights(self, breaks: Vector) -> HeightMatrices:
        return HeightMatrices(breaks, self._resolution.degree)

    def _plates(self, everywhere: NDArray[np.bool_], top: float) -> list[Join]:
        """Plate, film and plate below `top`, in one stack or one for each cell; the uppermost of each stack."""
        p, plan = self._parameters, self._plan
        plexiglas, film = Elastic(p.plate_modulus, p.plate_poisson), Elastic(p.film_modulus, p.film_poisson)
        steps = max(1, self._resolution.layers - 1)
        upper = self._heights(top + graded(-p.plate_thickness, 0.0, steps, self._resolution.ratio, "end"))
        film_top = top - p.plate_thickness
        sheet = self._heights(np.array([film_top - p.film_thickness, film_top]))
        lower = self._heights(film_top - p.film_thickness + np.array([-p.plate_thickness, 0.0]))
        stacks = [plan.cell == k for k in np.unique(plan.cell)] if p.separate_bases else [everywhere]
        self._floor_parts = []
        uppermost: list[Join] = []
        for stack in stacks:
            floor = self._add(stack, lower, plexiglas, floor=True, base=True)
            between = self._add(stack, sheet, film, [(floor, ALL)], base=True)
            uppermost.append((self._add(stack, upper, plexiglas, [(between, ALL)], base=True), ALL))
            self._floor_parts.append(floor)
        return uppermost

    def _add(
        self,
        elements: NDArray[np.bool_],
        height: HeightMatrices,
        material: Elastic,
        below: Sequence[Join] = (),
        *,
        floor: bool = False,
        base: bool = False,
        on_teeth: tuple[int, ...] = (),
        slides: bool = False,
        platen: bool = False,
    ) -> Part:
        """One more part, on the parts below, on the floor, or with some displacements held on rigid teeth."""
        key = elements.tobytes()
        if key not in self._matrices:
            self._matrices[key] = PlanMatrices(self._basis, np.flatnonzero(elements), self._resolution.degree)
        body = Body(self._matrices[key], height, material)
        names = np.full(body.shape, UNNAMED, dtype=np.intp)
        self._hold_symmetry(names, body, base)
        if floor:
            names[:, :, 0] = HELD
        for axis in on_teeth:
            names[axis, self._over_teeth(body), 0] = HELD
        for part, axes in below:
            _, mine, its = np.intersect1d(body.plan.nodes, part.body.plan.nodes, return_indices=True)
            for axis in axes:
                free = names[axis, mine, 0] == UNNAMED
                names[axis, mine[free], 0] = part.names[axis, its[free], -1]
        if slides:
            self._hold_sliding(names, body)
        if platen:
            names[2, :, -1] = self.unknowns
            self.unknowns += 1
        new = names == UNNAMED
        names[new] = self.unknowns + np.arange(new.sum())
        self.unknowns += int(new.sum())
        part = Part(body, names)
        self._parts.append(part)
        return part

    def _over_teeth(self, body: Body) -> NDArray[np.bool_]:
        """Nodes of the plan of a body that lie over a tooth."""
        over = np.unique(self._basis.element_dofs[:, self._plan.region == TOOTH])
        return np.isin(body.plan.nodes, over)

    def _hold_symmetry(self, names: Names, body: Body, base: bool) -> None:
        p = self._parameters
        lattice = ((p.length, p.columns), (p.width, p.rows))
        for axis, (size, cells) in enumerate(lattice):
            cut_between = base and p.separate_bases and cells % 2 == 0
            if self._mirrored[axis] and not cut_between:
                middle = np.flatnonzero(
                    (np.abs(self._plan.mesh.p[axis, self._plan.mesh.facets] - size / 2) < 1e-9 * size).all(axis=0)
                )
                names[axis, np.isin(body.plan.nodes, self._basis.get_dofs(middle).flatten())] = HELD

    def _hold_sliding(self, names: Names, body: Body) -> None:
        """Hold what nothing else holds of an object that slides: translation, and rotation about z."""
        # The first nodes are the corners of the mesh.
        corners = self._plan.mesh.p[0, body.plan.nodes[body.plan.nodes < self._plan.mesh.nvertices]]
        far = int(np.argmax(corners))
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
        stiffness = sparse.csc_array(entries, shape=(self.unknowns, self.unknowns))
        return SymmetricSolver(stiffness, solver)

    def _load(self, load_at: tuple[float, float] | None) -> Vector:
        p, body = self._parameters, self._object.body
        if load_at is None:
            weights = body.plan.integrals / p.load_area
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
