"""The linear system of the solid model: assembled, factorised, and solved for one load after another."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, cg

from palpate.instrument.errors import EstimateError
from palpate.instrument.models.finite_elements.coupling import Circuits, capacitance
from palpate.instrument.models.finite_elements.linear_solver import SymmetricSolver
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.body import Elastic
from palpate.instrument.models.solid.mesh import Resolution, locate
from palpate.instrument.models.solid.parts import Part, Stack

Vector = NDArray[np.float64]

# Resolution by refinement: a higher degree, more layers, then more layers and sectors. Layers alone would leave the
# error along the circle, up to 2e-4 of the force ratio, and that of the wide steps between the edges.
RESOLUTIONS = (
    Resolution(layers=2, ratio=0.2, sectors=1, degree=2),
    Resolution(layers=2, ratio=0.2, sectors=1, degree=3),
    Resolution(layers=3, ratio=0.2, sectors=1, degree=3),
    Resolution(layers=4, ratio=0.2, sectors=2, degree=3),
)
# Displacements of a part in addition to those of the unknowns, an array of the body's shape, by the part's number.
Jump = Mapping[int, Vector]

PRESSURE_STEPS = 200
PRESSURE_LIMIT = 1e-10


@dataclass(frozen=True, slots=True)
class Solved:
    """Solution under one load.

    Attributes:
        displacement: displacements of the unknowns [m].
        pressures: for each part the pressure (elements, steps, pressures) that the matrix does not carry; of size 0
            where it carries all.
        residual: residual of the linear system, relative to the size of its terms.
        voltages: voltages of open films, in the order of `System.electrodes` [V].
        charges: charges that leave the films when all are short-circuited [C].
    """

    displacement: Vector
    pressures: list[Vector]
    residual: float
    voltages: Vector = field(default_factory=lambda: np.zeros(0))
    charges: Vector = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True)
class Electrode:
    """Electrode of the film under one tooth or of one base, or the solved half or quarter of it.

    Attributes:
        part: the film.
        cell: number of the cell in the plan; None: the whole film.
        area: area [m2].
    """

    part: Part
    cell: int | None
    area: float


class System:
    """Factors of one sensor's stiffness, for any number of loads.

    Attributes:
        stack: the sensor's parts.
        electrodes: electrodes of the films; none on a rigid support.
        circuits: circuits of the films.

    Args:
        mirrored: whether half of the length, and half of the width, is solved for the whole; every load must allow it.
            None: as the parameters' own load allows.

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
        self._rest = _RestOfPressure(self.stack)
        self._solver = SymmetricSolver(self._stiffness(), solver)
        self.electrodes = self._electrodes()
        self._polarised = [self._polarised_by(electrode) for electrode in self.electrodes]
        self._charged = [self._shorted(forces, {}) for forces in self._polarised]
        capacitances = [capacitance(parameters.film, e.area, parameters.film_thickness) for e in self.electrodes]
        charges = [[forces @ by.displacement for by in self._charged] for forces in self._polarised]
        self.circuits = Circuits(np.array(capacitances), np.array(charges).reshape(2 * (len(charges),)))

    @property
    def unknowns(self) -> int:
        """Number of displacements."""
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

    def _held_by(self, part: int, moved: Vector) -> Vector:
        """Forces on the unknowns by a displaced part, without those of the pressure that the matrix does not carry."""
        body, names = self.stack.parts[part].body, self.stack.parts[part].names
        forces = (body.stiffness() @ body.local(moved)[..., None])[..., 0]
        total = np.zeros(self.unknowns + 1)
        np.add.at(total, body.local(names), forces)
        return total[:-1]

    def _electrodes(self) -> list[Electrode]:
        if self.parameters.support == "rigid":
            return []
        plan, tooth = self.stack.plan, self.stack.tooth
        own, areas = plan.cell[tooth.body.plan.elements], tooth.body.plan.areas
        teeth = [Electrode(tooth, int(cell), float(areas[own == cell].sum())) for cell in np.unique(own)]
        return teeth + [Electrode(film, None, float(film.body.plan.areas.sum())) for film in self.stack.base_films]

    def _polarised_by(self, electrode: Electrode) -> Vector:
        """Forces of a film under 1 V on the unknowns, against its voltage [N/V]."""
        part = electrode.part
        total = np.zeros(self.unknowns + 1)
        np.add.at(total, part.body.local(part.names), self._inside(electrode))
        return total[:-1]

    def _inside(self, electrode: Electrode) -> Vector:
        """The same forces for each element of the film: (elements, steps, unknowns)."""
        body, plan = electrode.part.body, self.stack.plan
        forces = body.polarised(self.parameters.film, self.stack.one[body.plan.nodes])
        if electrode.cell is not None:
            forces[plan.cell[body.plan.elements] != electrode.cell] = 0.0
        return forces

    def _torn(self, electrode: Electrode, jump: Jump) -> float:
        """Charge by the film's displacements in addition to those of the unknowns [C]."""
        moved = jump.get(self.stack.parts.index(electrode.part))
        if moved is None:
            return 0.0
        return float((self._inside(electrode) * electrode.part.body.local(moved)).sum())

    def solve(self, load: Vector, jump: Jump | None = None) -> Solved:
        """Displacements, pressures and voltages of open films under forces on the unknowns [N].

        Args:
            load: forces on the unknowns [N].
            jump: displacements of some parts in addition to those of the unknowns.

        Raises:
            EstimateError: as in `_shorted`.
        """
        shorted = self._shorted(load, jump or {})
        charges = np.array([forces @ shorted.displacement for forces in self._polarised])
        charges += [self._torn(electrode, jump or {}) for electrode in self.electrodes]
        voltages = self.circuits.voltages(charges)
        displacement, pressures = shorted.displacement, shorted.pressures
        for voltage, by in zip(voltages, self._charged, strict=True):
            displacement = displacement - voltage * by.displacement
            pressures = [own - voltage * its for own, its in zip(pressures, by.pressures, strict=True)]
        return replace(shorted, displacement=displacement, pressures=pressures, voltages=voltages, charges=charges)

    def _shorted(self, load: Vector, jump: Jump) -> Solved:
        """Displacements and pressures with films in short circuit, under forces on the unknowns [N].

        λ is limited in the matrix A. With the operator D of dilatation, the rest p of the pressure follows from (D A⁻¹
        Dᵀ + c) p = D A⁻¹ f by conjugate gradients. Scaled by the limited λ, most eigenvalues are close to 1, also for
        Poisson ratio 0.5.

        Raises:
            EstimateError: the residual of the system is too large, or the pressures do not settle.
        """
        rest = self._rest
        load = load - sum(self._held_by(k, moved) for k, moved in jump.items())
        torn = rest.torn(jump)
        pressure = np.zeros(rest.size)
        if rest.size:
            right = torn + rest.dilatations(self._solver(load)[0])
            matrix = LinearOperator(
                (rest.size, rest.size),
                dtype=np.float64,
                matvec=lambda p: rest.dilatations(self._solver(rest.forces(p))[0]) + rest.compliance * p,
            )
            scaling = sparse.diags_array(rest.lame)
            pressure, failed = cg(matrix, right, rtol=PRESSURE_LIMIT, maxiter=PRESSURE_STEPS, M=scaling)
            if failed:
                raise EstimateError(
                    f"the pressure of a nearly incompressible part did not settle to {PRESSURE_LIMIT:g} in"
                    f" {PRESSURE_STEPS} steps; lower its Poisson ratio"
                )
        displacement, residual = self._solver(load - rest.forces(pressure))
        return Solved(displacement, rest.split(pressure), residual)


class _RestOfPressure:
    """The pressures of all parts that the matrix does not carry, as one vector.

    Attributes:
        size: size of the vector.
        lame: part of λ that the matrix carries, for each pressure [Pa].
        compliance: 1/(λ - part of λ in the matrix), for each pressure [1/Pa].
    """

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        bodies = [part.body for part in stack.parts]
        materials = {k: m for k, body in enumerate(bodies) if isinstance(m := body.material, Elastic)}
        self._operators = {k: bodies[k].dilatation() for k, m in materials.items() if m.pressure_left > 0}
        self._names = {k: stack.parts[k].body.local(stack.parts[k].names) for k in self._operators}
        sizes = [operator[..., 0].size for operator in self._operators.values()]
        self.size = sum(sizes)
        held = [materials[k] for k in self._operators]
        self.lame = np.repeat([m.lame for m in held], sizes)
        self.compliance = np.repeat([m.compliance / m.pressure_left for m in held], sizes)

    def dilatations(self, displacement: Vector) -> Vector:
        """Dilatations of every part, as coefficients of its orthonormal polynomials."""
        padded = np.append(displacement, 0.0)
        parts = [(o @ padded[self._names[k]][..., None]).ravel() for k, o in self._operators.items()]
        return np.concatenate(parts)

    def torn(self, jump: Jump) -> Vector:
        """Dilatations by displacements of parts in addition to those of the unknowns."""
        parts = [
            (o @ self._stack.parts[k].body.local(jump[k])[..., None]).ravel() if k in jump else np.zeros(o[..., 0].size)
            for k, o in self._operators.items()
        ]
        return np.concatenate(parts) if parts else np.zeros(0)

    def forces(self, pressure: Vector) -> Vector:
        """Forces of the pressures on the unknowns [N]."""
        total = np.zeros(self._stack.unknowns + 1)
        for k, own in enumerate(self.split(pressure)):
            if own.size:
                spread = (self._operators[k].transpose(0, 1, 3, 2) @ own[..., None])[..., 0]
                np.add.at(total, self._names[k], spread)
        return total[:-1]

    def split(self, pressure: Vector) -> list[Vector]:
        """Pressures (elements, steps, pressures) of each part; of size 0 where the matrix carries all."""
        pieces: list[Vector] = [np.empty(0) for _ in self._stack.parts]
        start = 0
        for k, operator in self._operators.items():
            shape = operator.shape[:3]
            pieces[k] = pressure[start : start + math.prod(shape)].reshape(shape)
            start += math.prod(shape)
        return pieces


def symmetry(parameters: SolidParameters) -> tuple[bool, bool]:
    """Whether sensor and load are symmetric about the middle of the length, and of the width."""
    if parameters.load_at is None:
        return True, True
    x, y = parameters.load_at
    length, width = parameters.length, parameters.width
    return abs(x - length / 2) < 1e-9 * length, abs(y - width / 2) < 1e-9 * width
