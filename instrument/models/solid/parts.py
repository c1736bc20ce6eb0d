"""Parts of the solid model: their meshes, how they are joined, and where they are held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.body import Body, Elastic, HeightElements, Names, PlanElements, plan_basis
from palpate.instrument.models.solid.curve import Resolution
from palpate.instrument.models.solid.mesh import GAP, OVERHANG, RING, TOOTH, Cell, graded, plan_mesh
from palpate.instrument.sensor.film_material import FilmMaterial

Vector = NDArray[np.float64]

HELD, UNNAMED = -1, -2
ALL, NORMAL = (0, 1, 2), (2,)
# Share of half a cell. A gap below it is closed: on the finest mesh, points across it would have one place.
LEAST_GAP = 1e-7


@dataclass(frozen=True, slots=True)
class Part:
    """A body with the names of its unknowns, an array of the body's shape. Fixed unknowns are named HELD."""

    name: str
    body: Body
    names: Names

    @property
    def step(self) -> float:
        """Addition to 1/λ by which the part's elements bear it [1/Pa]; 0 where they do already."""
        return self.body.material.step if isinstance(self.body.material, Elastic) else 0.0


# The part below this one, and the displacements that both share.
Join = tuple[Part, tuple[int, ...]]


class Stack:
    """All parts of one sensor, with one set of names for their unknowns.

    Attributes:
        parts: parts from below to above.
        object, ring: the sensed object, the rings.
        tooth: the part whose lower side carries the teeth's forces: their films, or the object on rigid teeth.
        floor: parts that stand on the floor.
        base_films: films of the bases; none on a rigid support.
        touching: elements of the plan where the object touches teeth and rings.
        basis: shape functions of the plan.
        one: coefficients of the function 1 in the plan.
        places: (2, nodes), coefficients of the functions x and y in the plan [m].
        unknowns: number of unknowns.
    """

    def __init__(self, parameters: SolidParameters, resolution: Resolution, mirrored: tuple[bool, bool]) -> None:
        self._parameters = parameters
        self._resolution = resolution
        self._mirrored = mirrored
        self.plan = plan_mesh(_cell(parameters), self._quarters(), resolution)
        self.basis = plan_basis(self.plan, resolution.degree)
        # Hierarchical shape functions add nothing at the corners.
        corner = np.arange(self.basis.N) < self.plan.mesh.nvertices
        self.one = np.where(corner | (resolution.degree == 2), 1.0, 0.0)
        self.places = np.stack([self.basis.project(lambda at, axis=axis: at[axis]) for axis in (0, 1)])
        self._plans: dict[bytes, PlanElements] = {}
        self.parts: list[Part] = []
        self.floor: list[Part] = []
        self.base_films: list[Part] = []
        self.unknowns = 0
        self._build()

    def over_teeth(self, body: Body) -> NDArray[np.bool_]:
        """Nodes of the plan of a body that lie over a tooth."""
        over = np.unique(self.basis.element_dofs[:, self.plan.region == TOOTH])
        return np.isin(body.plan.nodes, over)

    def from_axis(self, x: Vector, y: Vector) -> tuple[Vector, Vector]:
        """Distances of places along x and y from the axis of the cell's tooth [m]."""
        p = self._parameters
        return x % p.cell_length - p.cell_length / 2, y % p.cell_width - p.cell_width / 2

    def centres(self, part: Part) -> Vector:
        """Centres of a part's elements (elements, 4) [m]: along both sides of the plan, from the axis, and height."""
        x, y = self.plan.mesh.p[:, self.plan.mesh.t[:4, part.body.plan.elements]].mean(axis=1)
        z = (part.body.height.breaks[1:] + part.body.height.breaks[:-1]) / 2
        flat = np.repeat([x, y, np.hypot(*self.from_axis(x, y))], len(z), axis=1)
        return np.column_stack([*flat, np.tile(z, len(x))])

    def cells(self, part: Part) -> Names:
        """Cell of each of a part's elements."""
        return self.plan.cell[part.body.plan.elements].repeat(len(part.body.height.local))

    def _quarters(self) -> dict[tuple[int, int], tuple[float, float, int]]:
        p = self._parameters
        return {
            (i, j): ((i // 2 + 0.5) * p.cell_length, (j // 2 + 0.5) * p.cell_width, j // 2 * p.columns + i // 2)
            for i in range(p.columns if self._mirrored[0] else 0, 2 * p.columns)
            for j in range(p.rows if self._mirrored[1] else 0, 2 * p.rows)
        }

    def _build(self) -> None:
        """Add all parts from below: plates and films, tooth, ring, object. The sensor's face is at height 0."""
        p, layers, ratio = self._parameters, self._resolution.layers, self._resolution.ratio
        region = self.plan.region
        everywhere = region != OVERHANG if p.outline == "round" else region >= 0
        ring = everywhere & (region != TOOTH) & (region != GAP) if p.ring_outline == "square" else region == RING
        foot = -p.sensor_height - p.film_thickness
        joint = ALL if p.interface == "bonded" else NORMAL
        capped = p.interface == "capped"
        compliant = Elastic(p.compliant_modulus, p.compliant_poisson)
        ring_heights = self._rubber(graded(foot, 0.0, layers, ratio, "both"))
        if p.support == "rigid":
            self.ring = self._add("ring", ring, ring_heights, compliant, floor=True, beside_teeth=joint, capped=capped)
            self.floor = [self.ring]
            below = [(self.ring, joint)]
        else:
            plates = self._plates(everywhere, foot)
            steps = max(1, layers - 1)
            sheet = self._stiff(np.array([foot, -p.sensor_height]))
            tall = self._stiff(graded(-p.sensor_height, 0.0, steps, ratio, "both"))
            phenolic = Elastic(p.tooth_modulus, p.tooth_poisson)
            self.tooth = self._add("tooth film", region == TOOTH, sheet, p.film, plates)
            tooth = self._add("tooth", region == TOOTH, tall, phenolic, [(self.tooth, ALL)])
            self.ring = self._add("ring", ring, ring_heights, compliant, plates, [(tooth, joint)], capped=capped)
            below = [(tooth, joint), (self.ring, joint)]
        if p.load_at is None:
            heights = graded(0.0, p.sensed_thickness, layers + 1, ratio, "start")
        else:
            heights = graded(0.0, p.sensed_thickness, layers, ratio, "both")
        self.touching = ring | (region == TOOTH)
        self.object = self._add(
            "object",
            everywhere,
            self._rubber(heights),
            Elastic(p.sensed_modulus, p.sensed_poisson),
            below,
            on_teeth=joint if p.support == "rigid" else (),
            slides=p.interface != "bonded",
            platen=p.load == "platen" and p.load_at is None,
        )
        if p.support == "rigid":
            self.tooth = self.object

    def _rubber(self, breaks: Vector) -> HeightElements:
        return HeightElements(breaks, self._resolution.rubber or self._resolution.degree)

    def _stiff(self, breaks: Vector) -> HeightElements:
        return HeightElements(breaks, self._resolution.stiff or self._resolution.degree)

    def _plates(self, everywhere: NDArray[np.bool_], top: float) -> list[Join]:
        """Add plate, film and plate below `top`, in one stack or one for each cell; returns the uppermost of each."""
        p, plan = self._parameters, self.plan
        plexiglas = Elastic(p.plate_modulus, p.plate_poisson)
        steps = max(1, self._resolution.layers - 1)
        upper = self._stiff(top + graded(-p.plate_thickness, 0.0, steps, self._resolution.ratio, "end"))
        film_top = top - p.plate_thickness
        sheet = self._stiff(np.array([film_top - p.film_thickness, film_top]))
        lower = self._stiff(film_top - p.film_thickness + np.array([-p.plate_thickness, 0.0]))
        stacks = [plan.cell == k for k in np.unique(plan.cell)] if p.separate_bases else [everywhere]
        uppermost: list[Join] = []
        for stack in stacks:
            floor = self._add("lower plate", stack, lower, plexiglas, floor=True, base=True)
            between = self._add("base film", stack, sheet, p.film, [(floor, ALL)], base=True)
            top_plate = self._add("upper plate", stack, upper, plexiglas, [(between, ALL)], base=True)
            uppermost.append((top_plate, ALL))
            self.floor.append(floor)
            self.base_films.append(between)
        return uppermost

    def _add(
        self,
        name: str,
        elements: NDArray[np.bool_],
        height: HeightElements,
        material: Elastic | FilmMaterial,
        below: Sequence[Join] = (),
        beside: Sequence[Join] = (),
        *,
        floor: bool = False,
        base: bool = False,
        on_teeth: tuple[int, ...] = (),
        beside_teeth: tuple[int, ...] = (),
        slides: bool = False,
        platen: bool = False,
        capped: bool = False,
    ) -> Part:
        """Add a part on the parts below, on the floor, or with some displacements held on rigid teeth.

        Its upper side stays flat and level below a platen, and in each cell where it is capped.
        """
        key = elements.tobytes()
        if key not in self._plans:
            self._plans[key] = PlanElements(self.basis, np.flatnonzero(elements), self._resolution.degree)
        body = Body(self._plans[key], height, material)
        names = np.full(body.shape, UNNAMED, dtype=np.intp)
        self._hold_symmetry(names, body, base)
        if floor:
            names[:, 0] = HELD
        for axis in on_teeth:
            names[axis, 0, self.over_teeth(body)] = HELD
        for axis in beside_teeth:
            names[axis, -1, self.over_teeth(body)] = HELD
        for level, joins in ((0, below), (-1, beside)):
            for part, axes in joins:
                _, mine, its = np.intersect1d(body.plan.nodes, part.body.plan.nodes, return_indices=True)
                for axis in axes:
                    free = names[axis, level, mine] == UNNAMED
                    names[axis, level, mine[free]] = part.names[axis, -1, its[free]]
        if slides:
            self._hold_sliding(names, body)
        if platen:
            self._level(names, body, np.ones(len(body.plan.nodes), dtype=bool))
        if capped:
            for ring in self._rings(body):
                self._level(names, body, ring)
        new = names == UNNAMED
        names[new] = self.unknowns + np.arange(new.sum())
        self.unknowns += int(new.sum())
        part = Part(name, body, names)
        self.parts.append(part)
        return part

    def _rings(self, body: Body) -> list[NDArray[np.bool_]]:
        """Nodes of each ring; rings that touch are one."""
        p, nodes = self._parameters, np.arange(len(body.plan.nodes))
        between = min(p.cell_length, p.cell_width) - 2 * p.ring_outer_radius
        if p.ring_outline == "square" or between < 1e-9 * p.cell_length:
            return [nodes >= 0]
        cells = self.plan.cell[body.plan.elements]
        return [np.isin(nodes, body.plan.local[cells == cell]) for cell in np.unique(cells)]

    def _level(self, names: Names, body: Body, nodes: NDArray[np.bool_]) -> None:
        """Give one height to all of these nodes of the upper side, and hold the unknowns that would bend it."""
        flat = self.one[body.plan.nodes] == 1
        names[2, -1, nodes & ~flat] = HELD
        names[2, -1, nodes & flat] = self.unknowns
        self.unknowns += 1

    def _hold_symmetry(self, names: Names, body: Body, base: bool) -> None:
        p = self._parameters
        lattice = ((p.length, p.columns), (p.width, p.rows))
        for axis, (size, cells) in enumerate(lattice):
            cut_between = base and p.separate_bases and cells % 2 == 0
            if self._mirrored[axis] and not cut_between:
                middle = np.flatnonzero(
                    (np.abs(self.plan.mesh.p[axis, self.plan.mesh.facets] - size / 2) < 1e-9 * size).all(axis=0)
                )
                names[axis][:, np.isin(body.plan.nodes, self.basis.get_dofs(middle).flatten())] = HELD

    def _hold_sliding(self, names: Names, body: Body) -> None:
        """Hold translation and rotation about z of an object that slides, since nothing else holds them."""
        # The mesh's corners are the first nodes.
        corners = self.plan.mesh.p[0, body.plan.nodes[body.plan.nodes < self.plan.mesh.nvertices]]
        far = int(np.argmax(corners))
        if not self._mirrored[0]:
            names[0, -1, 0] = HELD
        if not self._mirrored[1]:
            names[1, -1, 0] = HELD
        if not any(self._mirrored):
            names[1, -1, far] = HELD


def _cell(parameters: SolidParameters) -> Cell:
    tooth, inner, half = parameters.tooth_radius, parameters.ring_inner_radius, parameters.cell_length / 2
    return Cell(
        half_length=half,
        half_width=parameters.cell_width / 2,
        tooth_radius=tooth,
        inner_radius=inner if inner - tooth > LEAST_GAP * half else tooth,
        outer_radius=parameters.ring_outer_radius,
    )
