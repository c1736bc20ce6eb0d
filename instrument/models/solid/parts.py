"""Parts of the solid model: their meshes, how they are joined, and where they are held."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats
from palpate.instrument.models.parameters import SolidParameters
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.mesh import (
    GAP,
    OVERHANG,
    RING,
    SWAPPED,
    TOOTH,
    Elastic,
    HeightElements,
    Names,
    PlanElements,
    PlanMesh,
    SolidBody,
    UnitCell,
    graded,
    plan_basis,
    plan_mesh,
)
from palpate.instrument.sensor.material import FilmMaterial

HELD, UNNAMED = -1, -2
ALL, NORMAL = (0, 1, 2), (2,)
# Share of half a cell. A gap below it is closed: on the finest mesh, points across it would have one place.
LEAST_GAP = 1e-7


@dataclass(frozen=True, slots=True)
class SolidPart:
    """A body with the names of its unknowns, an array of the body's shape. Fixed unknowns are named HELD."""

    name: str
    body: SolidBody
    names: Names

    @property
    def step(self) -> float:
        """Addition to 1/λ by which the part's elements bear it [1/Pa]; 0 where they do already."""
        return self.body.material.step if isinstance(self.body.material, Elastic) else 0.0


# The part below this one, and the displacements that both share.
Join = tuple[SolidPart, tuple[int, ...]]


class SolidStack:
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
        self.parts: list[SolidPart] = []
        self.floor: list[SolidPart] = []
        self.base_films: list[SolidPart] = []
        self.unknowns = 0
        self._build()

    def over_teeth(self, body: SolidBody) -> NDArray[np.bool_]:
        """Nodes of the plan of a body that lie over a tooth."""
        over = np.unique(self.basis.element_dofs[:, self.plan.region == TOOTH])
        return np.isin(body.plan.nodes, over)

    def from_axis(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Distances of places along x and y from the axis of the cell's tooth [m]."""
        p = self._parameters
        return x % p.cell_length - p.cell_length / 2, y % p.cell_width - p.cell_width / 2

    def centres(self, part: SolidPart) -> Floats:
        """Centres of a part's elements (elements, 4) [m]: along both sides of the plan, from the axis, and height."""
        x, y = self.plan.mesh.p[:, self.plan.mesh.t[:4, part.body.plan.elements]].mean(axis=1)
        z = (part.body.height.breaks[1:] + part.body.height.breaks[:-1]) / 2
        flat = np.repeat([x, y, np.hypot(*self.from_axis(x, y))], len(z), axis=1)
        return np.column_stack([*flat, np.tile(z, len(x))])

    def cells(self, part: SolidPart) -> Names:
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

    def _rubber(self, breaks: Floats) -> HeightElements:
        return HeightElements(breaks, self._resolution.rubber or self._resolution.degree)

    def _stiff(self, breaks: Floats) -> HeightElements:
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
    ) -> SolidPart:
        """Add a part on the parts below, on the floor, or with some displacements held on rigid teeth.

        Its upper side stays flat and level below a platen, and in each cell where it is capped.
        """
        key = elements.tobytes()
        if key not in self._plans:
            self._plans[key] = PlanElements(self.basis, np.flatnonzero(elements), self._resolution.degree)
        body = SolidBody(self._plans[key], height, material)
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
        part = SolidPart(name, body, names)
        self.parts.append(part)
        return part

    def _rings(self, body: SolidBody) -> list[NDArray[np.bool_]]:
        """Nodes of each ring; rings that touch are one."""
        p, nodes = self._parameters, np.arange(len(body.plan.nodes))
        between = min(p.cell_length, p.cell_width) - 2 * p.ring_outer_radius
        if p.ring_outline == "square" or between < 1e-9 * p.cell_length:
            return [nodes >= 0]
        cells = self.plan.cell[body.plan.elements]
        return [np.isin(nodes, body.plan.local[cells == cell]) for cell in np.unique(cells)]

    def _level(self, names: Names, body: SolidBody, nodes: NDArray[np.bool_]) -> None:
        """Give one height to all of these nodes of the upper side, and hold the unknowns that would bend it."""
        flat = self.one[body.plan.nodes] == 1
        names[2, -1, nodes & ~flat] = HELD
        names[2, -1, nodes & flat] = self.unknowns
        self.unknowns += 1

    def _hold_symmetry(self, names: Names, body: SolidBody, base: bool) -> None:
        p = self._parameters
        lattice = ((p.length, p.columns), (p.width, p.rows))
        for axis, (size, cells) in enumerate(lattice):
            cut_between = base and p.separate_bases and cells % 2 == 0
            if self._mirrored[axis] and not cut_between:
                middle = np.flatnonzero(
                    (np.abs(self.plan.mesh.p[axis, self.plan.mesh.facets] - size / 2) < 1e-9 * size).all(axis=0)
                )
                names[axis][:, np.isin(body.plan.nodes, self.basis.get_dofs(middle).flatten())] = HELD

    def _hold_sliding(self, names: Names, body: SolidBody) -> None:
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


def _cell(parameters: SolidParameters) -> UnitCell:
    tooth, inner, half = parameters.tooth_radius, parameters.ring_inner_radius, parameters.cell_length / 2
    return UnitCell(
        half_length=half,
        half_width=parameters.cell_width / 2,
        tooth_radius=tooth,
        inner_radius=inner if inner - tooth > LEAST_GAP * half else tooth,
        outer_radius=parameters.ring_outer_radius,
    )


# --- what is asked: forces on teeth and bases, and mean stresses of films --------------------------------

# Each is the work of inner forces of some elements on given displacements of these: a force that passes through a
# surface, on displacements of 1 m that end there; a mean stress, on a uniform strain.


@dataclass(frozen=True, slots=True)
class InternalWork:
    """Work of the inner forces of some elements of a part.

    Attributes:
        part: the part.
        elements: numbers of the elements.
        moved: displacements, an array of the body's shape.
    """

    part: SolidPart
    elements: Names
    moved: Floats

    def forces(self, unknowns: int, added: float) -> Floats:
        """Work by each unknown's displacement of 1 m, (unknowns,); added: as in `SolidBody.stiffness`, in steps."""
        body = self.part.body
        moved = body.local(self.moved, self.elements)
        forces = body.stiffness(self.elements, added * self.part.step) @ moved[..., None]
        total = np.zeros(unknowns + 1)
        np.add.at(total, body.local(self.part.names, self.elements), forces[..., 0])
        return total[:-1]

    def energy(self, added: float) -> float:
        """Work of the forces that the displacements alone cause [J]."""
        moved = self.part.body.local(self.moved, self.elements)
        stiffness = self.part.body.stiffness(self.elements, added * self.part.step)
        return float(np.einsum("ei,eij,ej->", moved, stiffness, moved))


@dataclass(frozen=True, slots=True)
class Electrode:
    """Electrodes of the film under one tooth or of one base, or the solved half or quarter of them.

    Attributes:
        part: the film.
        elements: numbers of the film's elements between the electrodes.
        cell: number of the cell in the plan.
        area: area [m2].
    """

    part: SolidPart
    elements: Names
    cell: int
    area: float

    def inside(self, stack: SolidStack) -> Floats:
        """Forces (elements, unknowns) of the film under 1 V, against its voltage [N/V]."""
        body = self.part.body
        assert isinstance(body.material, FilmMaterial)
        return body.polarised(body.material, stack.one[body.plan.nodes])[self.elements]

    def forces(self, stack: SolidStack) -> Floats:
        """The same on all unknowns."""
        total = np.zeros(stack.unknowns + 1)
        np.add.at(total, self.part.body.local(self.part.names, self.elements), self.inside(stack))
        return total[:-1]

    def charge(self, stack: SolidStack, goal: InternalWork) -> float:
        """Change of a goal with the voltage, which is also the charge by the goal's displacements [C]."""
        if goal.part is not self.part:
            return 0.0
        common = np.isin(self.elements, goal.elements)
        moved = self.part.body.local(goal.moved, self.elements[common])
        return float((self.inside(stack)[common] * moved).sum())


@dataclass(frozen=True, slots=True)
class Goals:
    """Goals of the whole sensor, each a sum over works in its solved half or quarter.

    Attributes:
        works: works in the solved share of the sensor.
        shares: (goals, works), factors of the sums. Goals are the forces on teeth, the forces on bases, and the mean
            stresses along x of each tooth's film and then of each base's, and along y (none on a rigid support). The
            last row is the force on all teeth.
        electrodes: electrodes of the films in the solved share; none on a rigid support.
        films: (films, electrodes), by which the charges of the electrodes are those of the films.
        teeth, bases: number of teeth and of bases.
    """

    works: Sequence[InternalWork]
    shares: Floats
    electrodes: Sequence[Electrode]
    films: Floats
    teeth: int
    bases: int


def goals(p: SolidParameters, stack: SolidStack, mirrored: tuple[bool, bool]) -> Goals:
    """The goals of a sensor of which half or a quarter is solved."""
    on_teeth = _whole(p, mirrored)
    on_bases = on_teeth if p.separate_bases else np.array([[2.0 ** sum(mirrored)]])
    sides = [(stack.tooth, 0)] + ([(stack.ring, -1)] if p.support == "rigid" else [])
    kinds = {
        "teeth": [pair for part, level in sides for pair in _lifted(stack, part, level)],
        "floor": [pair for part in stack.floor for pair in _floored(stack, part, p.separate_bases)],
    }
    if p.support != "rigid":
        for axis in (0, 1):
            kinds |= {
                f"tooth films {axis}": _stretched(stack, stack.tooth, axis, by_cell=True),
                f"base films {axis}": [
                    pair
                    for film in stack.base_films
                    for pair in _stretched(stack, film, axis, by_cell=p.separate_bases)
                ],
            }
    works = [work for pairs in kinds.values() for _, work in pairs]

    def rows(kind: str, whole: Floats) -> Floats:
        found = np.zeros((len(whole), len(works)))
        for cell, work in kinds[kind]:
            found[cell, next(place for place, other in enumerate(works) if other is work)] = 1.0
        return whole @ found

    teeth, bases = rows("teeth", on_teeth), rows("floor", on_bases)
    together = teeth.sum(axis=0, keepdims=True)
    shares = [teeth, bases]
    if p.support == "rigid":
        shares = [teeth, bases + (teeth if p.separate_bases else together), together]
        return Goals(works, np.concatenate(shares), [], np.zeros((0, 0)), len(teeth), len(bases))
    for axis in (0, 1):
        for where, whole in (("tooth", on_teeth), ("base", on_bases)):
            own = rows(f"{where} films {axis}", whole)
            shares.append(own / (own @ [_volume(work) for work in works])[:, None])
    electrodes = [
        Electrode(work.part, work.elements, cell, _area(work))
        for where in ("tooth", "base")
        for cell, work in kinds[f"{where} films 0"]
    ]
    films = np.zeros((len(teeth) + len(bases), len(electrodes)))
    for place, electrode in enumerate(electrodes):
        if place < len(kinds["tooth films 0"]):
            films[: len(teeth), place] = on_teeth[:, electrode.cell]
        else:
            films[len(teeth) :, place] = on_bases[:, electrode.cell]
    return Goals(works, np.concatenate([*shares, together]), electrodes, films, len(teeth), len(bases))


def _whole(p: SolidParameters, mirrored: tuple[bool, bool]) -> Floats:
    """What each cell of the whole sensor (cells, cells) has of the values of those that were solved."""
    count = p.rows * p.columns
    grid = np.eye(count).reshape(p.rows, p.columns, count)
    if mirrored[0]:
        grid = grid + grid[:, ::-1]
    if mirrored[1]:
        grid = grid + grid[::-1]
    return grid.reshape(count, count)


def _lifted(stack: SolidStack, part: SolidPart, level: int) -> list[tuple[int, InternalWork]]:
    """Forces of a part on each tooth below it, by the tooth's cell."""
    body, over = part.body, stack.over_teeth(part.body)
    moved = np.zeros(body.shape)
    moved[2, level, over] = stack.one[body.plan.nodes[over]]
    steps = len(body.height.local)
    found = []
    for cell, plan in _cells(stack, part, by_cell=True):
        touching = plan[over[body.plan.local[plan]].any(axis=1)]
        if len(touching):
            found.append((cell, InternalWork(part, touching * steps + level % steps, moved)))
    return found


def _floored(stack: SolidStack, part: SolidPart, by_cell: bool) -> list[tuple[int, InternalWork]]:
    """Forces of a part on the floor, by cell or all together."""
    body = part.body
    moved = np.zeros(body.shape)
    moved[2, 0] = stack.one[body.plan.nodes]
    return [
        (cell, InternalWork(part, plan * len(body.height.local), moved))
        for cell, plan in _cells(stack, part, by_cell=by_cell)
    ]


def _stretched(stack: SolidStack, film: SolidPart, axis: int, by_cell: bool) -> list[tuple[int, InternalWork]]:
    """Mean stresses of a film times its volume, by cell or all together."""
    body = film.body
    moved = np.zeros(body.shape)
    moved[axis] = body.height.one[:, None] * stack.places[axis][body.plan.nodes]
    # A film has one step along the height, so that its elements have the numbers of those of its plan.
    return [(cell, InternalWork(film, plan, moved)) for cell, plan in _cells(stack, film, by_cell=by_cell)]


def _cells(stack: SolidStack, part: SolidPart, by_cell: bool) -> list[tuple[int, Names]]:
    """Cells of a part, and the elements of its plan there; all as those of cell 0 where cells do not count."""
    plan = part.body.plan
    if not by_cell:
        return [(0, np.arange(len(plan.elements)))]
    cells = stack.plan.cell[plan.elements]
    return [(int(cell), np.flatnonzero(cells == cell)) for cell in np.unique(cells)]


def _area(work: InternalWork) -> float:
    return float(work.part.body.plan.areas[work.elements].sum())


def _volume(work: InternalWork) -> float:
    return _area(work) * float(np.ptp(work.part.body.height.breaks))


# --- a sensor that is its own mirror image about the diagonal of its square ------------------------------

# Of two unknowns that the mirror turns into each other, the first is (s + d) / √2 and the second (s - d) / √2. An
# element and its mirror image then make two elements, one of all s and one of all d, which know nothing of each other.
# So all but the films, which differ along their two axes, falls into two halves of half as many unknowns each, whose
# fronts take a quarter of the time. Loads and goals need no symmetry. s takes the name of the first unknown, d that of
# the second.

PLACED_ALIKE = 1e-9  # of the plan's size
HALF = math.sqrt(0.5)


@dataclass(frozen=True, slots=True)
class Piece:
    """Elements of a part as they are eliminated: its own, or sums or differences of mirrored ones, or both together.

    Attributes:
        unknowns: (elements, n), names of each element's unknowns; negative for those that are fixed.
        places: (elements, coordinates), coordinates along which elements may be parted.
        stiffness: function of numbers of these elements, and of an addition to the material's 1/λ [1/Pa], that gives
            the stiffness (elements, n, n).
    """

    unknowns: Names
    places: Floats
    stiffness: Callable[[Names, float], Floats]


class Diagonal:
    """The mirror images of a sensor's unknowns, if it is its own.

    Attributes:
        stack: the sensor.
        halves: whether it is its own mirror image.
    """

    def __init__(self, stack: SolidStack) -> None:
        self.stack = stack
        own = np.arange(stack.unknowns)
        self._images, partner = _elements(stack.plan), own
        if self._images is not None:
            found = _unknowns(stack, *self._images)
            partner = own if found is None else found
        # Fixed unknowns, of number -1, have the last place.
        self._partner = np.append(partner, -1)
        before = np.zeros(stack.unknowns + 1, dtype=bool)
        for part in stack.parts if (partner != own).any() else ():
            before[part.body.local(part.names, self._halved(part)[0])] = True
        # Of two that the diagonal itself has, x and y, x is the first.
        before[:-1] &= ~before[partner] | (own <= partner)
        self._is_first = before
        self._first = own[before[:-1] & (partner != own)]
        self._second = partner[self._first]
        self.halves = bool(len(self._first))

    def turned(self, columns: Floats) -> Floats:
        """Forces or displacements of sums and differences from those of the unknowns, or the other way round.

        Args:
            columns: (unknowns, ...).
        """
        found = columns.copy()
        one, other = columns[self._first], columns[self._second]
        found[self._first], found[self._second] = HALF * (one + other), HALF * (one - other)
        return found

    def pieces(self, part: SolidPart) -> list[Piece]:
        """The elements of a part."""
        body, places = part.body, self.stack.centres(part)
        if not self.halves:
            return [Piece(body.local(part.names), places, body.stiffness)]
        kept, paired = self._halved(part)
        names = body.local(part.names, kept)
        partner, is_first = self._partner[names], self._is_first[names]
        alone = names == partner
        sums, differences = np.where(is_first, names, partner), np.where(is_first, partner, names)
        differences[alone] = -1
        # Two mirrored elements are as stiff as twice the first of them, which just makes up for the halves.
        of_sum = np.where(alone, np.where(paired, math.sqrt(2.0), 1.0), np.where(paired, 1.0, HALF))
        of_difference = np.where(paired, 1.0, HALF) * np.where(is_first, 1.0, -1.0)
        # Sums are parted from differences first, where nothing joins them.
        beside = [np.column_stack([places[kept], np.full(len(kept), at)]) for at in (0.0, 0.5, 1.0)]

        if isinstance(body.material, FilmMaterial):
            law = body.material.law
            turned = law[np.ix_(*4 * ([1, 0, 2],))]

            def of_film(numbers: Names, _: float) -> Floats:
                even, odd = (body.by_law(each / 2, kept[numbers]) for each in (law + turned, law - turned))
                weights = np.concatenate([of_sum[numbers], of_difference[numbers]], axis=1)
                return _scaled(np.block([[even, odd], [odd, even]]), weights)

            return [Piece(np.concatenate([sums, differences], axis=1), beside[1], of_film)]

        def of(weights: Floats) -> Callable[[Names, float], Floats]:
            return lambda numbers, added: _scaled(body.stiffness(kept[numbers], added), weights[numbers])

        return [Piece(sums, beside[0], of(of_sum)), Piece(differences, beside[2], of(of_difference))]

    def _halved(self, part: SolidPart) -> tuple[Names, NDArray[np.bool_]]:
        """A part's elements without the mirror images of others, and whether each has one beside itself.

        Returns:
            (elements,) and (elements, 1).
        """
        assert self._images is not None
        body = part.body
        image = np.searchsorted(body.plan.elements, self._images[0][body.plan.elements])
        own = np.flatnonzero(np.arange(len(image)) <= image)
        steps = len(body.height.local)
        return (own[:, None] * steps + np.arange(steps)).ravel(), (own != image[own]).repeat(steps)[:, None]


def _scaled(matrices: Floats, weights: Floats) -> Floats:
    """Matrices (elements, n, n) with rows and columns times weights (elements, n), in place; most weights are 1."""
    changed = np.flatnonzero((weights != 1).any(axis=0))
    matrices[:, changed] *= weights[:, changed, None]
    matrices[:, :, changed] *= weights[:, None, changed]
    return matrices


def _elements(plan: PlanMesh) -> tuple[Names, NDArray[np.bool_]] | None:
    """Mirror image of each element of a plan, and whether its two directions are exchanged there.

    None: the plan is not its own mirror image.
    """
    places = plan.mesh.doflocs[:, plan.mesh.dofs.element_dofs]
    turned, near = places[::-1], PLACED_ALIKE * np.ptp(places)
    order, of_turned = (np.lexsort(np.round(each.mean(axis=1) / near)) for each in (places, turned))
    images = np.empty(len(order), dtype=np.intp)
    images[of_turned] = order
    kept, swapped = (
        np.abs(turned - each[:, :, images]).max(axis=(0, 1)) < near for each in (places, places[:, SWAPPED])
    )
    return (images, swapped) if (kept | swapped).all() else None


def _nodes(stack: SolidStack, images: Names, swapped: NDArray[np.bool_]) -> Names:
    """Mirror image of each shape function of the plan."""
    functions, dofs = stack.basis.elem, stack.basis.element_dofs
    places = np.random.default_rng(0).random((2, 2 * len(dofs)))
    values, exchanged = (
        np.array([functions.lbasis(at, number)[0] for number in range(len(dofs))]) for at in (places, places[::-1])
    )
    order = np.abs(values - exchanged[:, None]).sum(axis=2).argmin(axis=1)
    found = np.empty(stack.basis.N, dtype=np.intp)
    found[dofs] = np.where(swapped, dofs[order][:, images], dofs[:, images])
    return found


def _unknowns(stack: SolidStack, images: Names, swapped: NDArray[np.bool_]) -> Names | None:
    """Mirror image of each unknown; None: the sensor is not its own."""
    nodes = _nodes(stack, images, swapped)
    found = np.arange(stack.unknowns)
    pairs = []
    for part in stack.parts:
        of = part.body.plan.nodes
        places = np.minimum(np.searchsorted(of, nodes[of]), len(of) - 1)
        if not np.array_equal(of[places], nodes[of]):
            return None
        pairs.append((part.names, part.names[[1, 0, 2]][:, :, places]))
        free = part.names >= 0
        found[part.names[free]] = pairs[-1][1][free]
    found = np.append(found, -1)
    return found[:-1] if all(np.array_equal(found[names], turned) for names, turned in pairs) else None
