"""Structured meshes of the round sensor: one grid of rectangles, graded geometrically towards the corners.

A corner where bodies of different stiffness meet, or where one ends, has a singular stress. Elements that
shrink geometrically towards it, with a degree that rises with their number of layers, converge
exponentially (hp version, Babuška and Guo 1988); uniform ones at first order, whatever the degree.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.arrays import Floats, Indices
from palpate.instrument.models.finite_elements import elements as el
from palpate.instrument.models.finite_elements.elements import LineIntegrals
from palpate.instrument.models.parameters import CLOSED, RoundParameters
from palpate.instrument.sensor.material import FilmMaterial

GRADING = 0.17  # size of an element over that of its outer neighbour; 0.15 to 0.2 is best for corners
NEAR = 1e-9  # share of its distance from the axis by which a corner is beside another; nearer ones are one
# Size of the elements at a corner [m], and number of layers within.
Corner = tuple[float, int]


@dataclass(frozen=True, slots=True)
class AxisymmetricBody:
    """A rectangle of one material: radii and heights [m], and the sheet to which its nodes belong.

    Bodies of one sheet share the nodes of their common edges. Sheets are joined only where the model says so, so that a
    closed gap stays a slit. `film` is the film's material; None: the body is no film.
    """

    name: str
    sheet: str
    radii: tuple[float, float]
    heights: tuple[float, float]
    modulus: float
    poisson: float
    film: FilmMaterial | None = None

    @property
    def shear(self) -> float:
        """Shear modulus [Pa]."""
        return self.modulus / (2 * (1 + self.poisson))

    @property
    def area(self) -> float:
        """Area of the section [m2]."""
        return math.pi * (self.radii[1] ** 2 - self.radii[0] ** 2)

    @property
    def volume(self) -> float:
        """Volume [m3]."""
        return self.area * (self.heights[1] - self.heights[0])


@dataclass(frozen=True, slots=True)
class Grid:
    """Bodies and the grid lines that cut them: radii and heights [m], ascending."""

    bodies: tuple[AxisymmetricBody, ...]
    radii: Floats
    heights: Floats
    face: float
    base: float


def grid(parameters: RoundParameters, layers: int) -> Grid:
    """The sensor's bodies with `layers` geometric layers at every corner that matters."""
    p = parameters
    elastic = p.support == "elastic"
    levels = np.cumsum([0.0, p.plate_thickness, p.film_thickness, p.plate_thickness])
    base = float(levels[-1]) if elastic else 0.0
    seat = base + p.film_thickness
    face = seat + p.sensor_height
    top = face + p.sensed_thickness
    bodies = [
        AxisymmetricBody("object", "object", (0.0, p.sensed_radius), (face, top), p.sensed_modulus, p.sensed_poisson),
        AxisymmetricBody(
            "ring",
            "ring",
            (p.ring_inner_radius, p.ring_outer_radius),
            (base, face),
            p.compliant_modulus,
            p.compliant_poisson,
        ),
    ]
    if elastic:
        tooth, plate = (0.0, p.tooth_radius), (0.0, p.plate_radius)
        pvdf = p.film.round()
        film, plexiglas = (pvdf.modulus, pvdf.poisson, pvdf), (p.plate_modulus, p.plate_poisson)
        heights = [(float(low), float(high)) for low, high in pairwise(levels)]
        bodies += [
            AxisymmetricBody("tooth", "tooth", tooth, (seat, face), p.tooth_modulus, p.tooth_poisson),
            AxisymmetricBody("tooth film", "tooth", tooth, (base, seat), *film),
            AxisymmetricBody("upper plate", "base", plate, heights[2], *plexiglas),
            AxisymmetricBody("base film", "base", plate, heights[1], *film),
            AxisymmetricBody("lower plate", "base", plate, heights[0], *plexiglas),
        ]
    return Grid(tuple(bodies), _radii(p, layers), _heights(p, layers, levels, base, seat, face), face, base)


def _gap(p: RoundParameters) -> float:
    """Width of the gap [m], at least that of a closed gap: a smaller one changes nothing and costs digits."""
    return max(p.ring_inner_radius - p.tooth_radius, CLOSED * p.tooth_radius)


def _radii(p: RoundParameters, layers: int) -> Floats:
    ring = p.ring_outer_radius - p.ring_inner_radius
    inner = min(_gap(p), p.tooth_radius, ring, p.sensed_thickness, p.sensor_height), layers
    outer = min(ring, p.sensed_thickness, p.sensor_height), layers
    corners: dict[float, Corner | None] = {0.0: None, p.tooth_radius: inner, p.ring_inner_radius: inner}
    corners |= dict.fromkeys({p.ring_outer_radius, p.sensed_radius}, outer)
    if p.support == "elastic":
        corners.setdefault(p.plate_radius, None)
    return _line(corners, max(p.tooth_radius, p.ring_outer_radius / 2))


def _heights(p: RoundParameters, layers: int, levels: Floats, base: float, seat: float, face: float) -> Floats:
    corners: dict[float, Corner | None] = {
        face: (min(_gap(p), p.tooth_radius, p.sensed_thickness, p.sensor_height), layers),
        face + p.sensed_thickness: None,
    }
    foot = min(p.sensor_height, p.ring_outer_radius - p.ring_inner_radius), layers
    if p.support == "elastic":
        corners |= {float(level): None for level in levels[:-1]}
        corners |= {base: foot, seat: (p.film_thickness, 0)}
    else:
        corners |= {base: foot}
    return _line(corners, p.ring_outer_radius)


def _line(corners: Mapping[float, Corner | None], longest: float) -> Floats:
    """Grid lines through all corners, with layers at each and no element above `longest`."""
    ends: list[float] = []
    for corner in sorted(corners):
        if not ends or corner - ends[-1] > NEAR * corner:
            ends.append(corner)
    pieces = [_interval(low, high, corners[low], corners[high], longest) for low, high in pairwise(ends)]
    return np.concatenate([[ends[0]], *pieces])


def _interval(low: float, high: float, at_low: Corner | None, at_high: Corner | None, longest: float) -> Floats:
    """Grid lines inside ]low, high], the last exactly `high`."""
    length = high - low
    reach = length / 2 if at_low and at_high else length
    parts = np.array([0.0, length])
    if at_low:
        parts = np.append(parts, _distances(*at_low, reach))
    if at_high:
        parts = np.append(parts, length - _distances(*at_high, reach))
    # Distances from both corners can meet, except for rounding.
    parts = np.unique(parts)
    least = 8 * float(np.spacing(high))
    parts = parts[np.append(True, np.diff(parts) > least)]
    parts[-1] = length
    lines = low + np.concatenate([_cut(a, b, longest) for a, b in pairwise(parts)])
    lines[-1] = high
    return lines


def _cut(start: float, end: float, longest: float) -> Floats:
    """Grid lines inside ]start, end]. The first step is at most `longest`, each next one at most twice the one before.

    Stresses even out within the sensor's radius, so a long object needs few elements.
    """
    count = max(1, math.ceil(math.log2((end - start) / longest + 1)))
    shares = 2.0 ** np.arange(1, count + 1) - 1
    lines: Floats = start + (end - start) * shares / shares[-1]
    return lines


def _distances(size: float, layers: int, reach: float) -> Floats:
    """Distances of grid lines from a corner, ascending. They keep their places as layers are added."""
    count = math.ceil(math.log(reach / size) / -math.log(GRADING) - 1e-9) + layers
    distances: Floats = reach * GRADING ** np.arange(count, -1, -1, dtype=np.float64)
    return distances


def inside(lines: Floats, extent: Sequence[float]) -> NDArray[np.intp]:
    """Indices of the intervals between grid lines that lie inside `extent`."""
    middle = (lines[1:] + lines[:-1]) / 2
    return np.flatnonzero((middle > extent[0]) & (middle < extent[1]))


# --- numbering of the unknowns: which ones neighbours share, and which are fixed -------------------------


SHEETS = ("object", "base", "tooth", "ring")
RADIAL, AXIAL = 0, 1


@dataclass(frozen=True, slots=True)
class BodyElements:
    """Elements of one body: their slice of all elements, and their columns and rows of the grid."""

    body: AxisymmetricBody
    elements: slice
    columns: Indices
    rows: Indices

    def __len__(self) -> int:
        return int(self.elements.stop - self.elements.start)


def parts(mesh: Grid) -> list[BodyElements]:
    """Elements of each body, ordered by radius and then by height."""
    found, start = [], 0
    for body in mesh.bodies:
        columns, rows = inside(mesh.radii, body.radii), inside(mesh.heights, body.heights)
        count = len(columns) * len(rows)
        found.append(BodyElements(body, slice(start, start + count), columns, rows))
        start += count
    return found


def number(
    parameters: RoundParameters, mesh: Grid, r: LineIntegrals, z: LineIntegrals, bodies: list[BodyElements]
) -> tuple[Indices, int]:
    """Numbers (elements, n) of the unknowns, and how many there are; fixed unknowns have that number.

    Shared ones come first, in the order of a nested dissection, then those inside elements.
    """
    local = r.dofs.shape[1]
    names = np.concatenate([_names(parameters, mesh, r, z, part) for part in bodies])
    bubble = np.arange(local) >= 2
    inner = np.tile(np.outer(bubble, bubble).ravel(), 2)
    outer = names[:, ~inner]
    named = np.zeros(outer.max() + 2, dtype=bool)
    named[outer] = True
    named[-1] = False  # fixed unknowns are named -1
    shared, count = int(np.count_nonzero(named)), int(inner.sum())
    size = shared + len(names) * count
    places = np.where(outer >= 0, (np.cumsum(named) - 1)[outer], shared)
    rank = np.full(shared + 1, size)
    rank[_dissection(mesh, bodies, places, shared)] = np.arange(shared)
    unknowns = np.empty(names.shape, dtype=np.intp)
    unknowns[:, ~inner] = rank[places]
    unknowns[:, inner] = np.arange(shared, size).reshape(len(names), count)
    return unknowns, size


def _dissection(mesh: Grid, bodies: list[BodyElements], unknowns: Indices, count: int) -> Indices:
    """Order of the elements' unknowns (elements, m) below `count` by nested dissection (George 1973).

    The grid is halved by its rows and by its columns in turn. Unknowns in both halves come after those in one half.
    """
    intervals = len(mesh.radii) - 1, len(mesh.heights) - 1
    halvings = max(intervals).bit_length()
    at = [(np.arange(n) << halvings) // n for n in intervals]
    column, row = (np.sum([(place >> k & 1) << 2 * k for k in range(halvings)], axis=0) for place in at)
    path = np.concatenate([(column[part.columns][:, None] + 2 * row[part.rows]).ravel() for part in bodies])
    first, last = np.full(count + 1, path.max()), np.zeros(count + 1, dtype=np.intp)
    flat, paths = unknowns.ravel(), path.repeat(unknowns.shape[1])
    np.minimum.at(first, flat, paths)
    np.maximum.at(last, flat, paths)
    # Number of the last halvings that separate the elements of an unknown.
    _, apart = np.frexp((first ^ last)[:count].astype(np.float64))
    return np.lexsort((apart, last[:count] | (1 << apart) - 1))


def within(radius: float, mesh: Grid, r: LineIntegrals) -> NDArray[np.bool_]:
    """Whether each shape function of the radial line, by its number, belongs to an interval within `radius` [m]."""
    return _shapes(mesh, r, (0.0, radius))


def _shapes(mesh: Grid, r: LineIntegrals, radii: tuple[float, float]) -> NDArray[np.bool_]:
    found = np.zeros(r.dofs.max() + 1, dtype=bool)
    found[r.dofs[inside(mesh.radii, radii)]] = True
    return found


def _names(parameters: RoundParameters, mesh: Grid, r: LineIntegrals, z: LineIntegrals, part: BodyElements) -> Indices:
    """A name, an integer, for each unknown (elements, 2 (p + 1)^2): joined unknowns share it, fixed ones have -1."""
    # Axes: column, row, axis, radial shape, axial shape. Vertices have the numbers of their grid lines.
    radial, axial = r.dofs[part.columns][:, None, None, :, None], z.dofs[part.rows][None, :, None, None, :]
    axis = np.array([RADIAL, AXIAL])[:, None, None]
    face, foot = np.searchsorted(mesh.heights, [mesh.face, mesh.base])
    fixed = (radial == 0) & (axis == RADIAL)

    covering = within(parameters.sensed_radius, mesh, r)[radial]
    if part.body.name == "ring" and parameters.ring_inner_radius == parameters.tooth_radius:
        # The object's node over a closed gap belongs to the tooth: a force on a node presses on no ring.
        covering = covering & (radial != r.dofs[part.columns[0], 0])
    touching = (axial == face) & covering
    if parameters.interface != "bonded":
        touching = touching & (axis == AXIAL)
    sheet = np.where(touching, SHEETS.index("object"), SHEETS.index(part.body.sheet))
    place = radial
    if parameters.interface == "capped":
        # A level top: its vertices move as the first one does, and nothing bends it between them.
        first, last = np.searchsorted(mesh.radii, [parameters.ring_inner_radius, parameters.ring_outer_radius])
        level = (axial == face) & (axis == AXIAL) & _shapes(mesh, r, (mesh.radii[first], mesh.radii[last]))[radial]
        sheet = np.where(level, SHEETS.index("object"), sheet)
        fixed = fixed | (level & (radial >= len(mesh.radii)))
        place = np.where(level, first, radial)
    if parameters.support == "rigid":
        held = touching & within(parameters.tooth_radius, mesh, r)[radial]
        fixed = fixed | held | (axial == foot)
    else:
        sheet = np.where(axial == foot, SHEETS.index("base"), sheet)
        fixed = fixed | (axial == 0)
    name = ((sheet * 2 + axis) * (r.dofs.max() + 1) + place) * (z.dofs.max() + 1) + axial
    return np.where(fixed, -1, name).reshape(len(part.columns) * len(part.rows), -1)


# --- element matrices: each body's material, and which bodies keep their pressure ------------------------

# Poisson ratios from which on a body keeps its pressure as an unknown: any body, and those that are of rubber.
MIXED_POISSON, RUBBER_MIXED_POISSON = 0.4, 0.2
RUBBER = ("object", "ring")
# Least compliance of the dilatation, over that of shear, with which pressures are eliminated.
LEAST_COMPLIANCE = 1e-4


def constants(body: AxisymmetricBody, mixed: bool) -> el.Constants:
    """Stiffness of the body's material; without the dilatation where the pressure is an unknown."""
    if body.film is not None:
        c, _, _ = body.film.stiff()
        return el.Constants(float(c[0, 0]), float(c[0, 1]), float(c[0, 2]), float(c[2, 2]), body.film.shear[0])
    nu, shear = body.poisson, body.shear
    return el.Constants.isotropic(shear, 0.0 if mixed else 2 * shear * nu / (1 - 2 * nu))


def keeps_pressure(body: AxisymmetricBody) -> bool:
    """Whether a body keeps its pressure as an unknown, whatever its modulus.

    A nearly incompressible body would lock without it. Rubber that hard bodies press errs several times less with it.
    """
    return body.film is None and body.poisson >= (RUBBER_MIXED_POISSON if body.name in RUBBER else MIXED_POISSON)


def compliance_of(body: AxisymmetricBody) -> float:
    """Compliance 1/λ of a body's dilatation over that of its shear, 1/G."""
    return (1 - 2 * body.poisson) / (2 * body.poisson)


def keeps_volume(body: AxisymmetricBody) -> bool:
    """Whether a body's compliance is too small to eliminate its pressures with."""
    return keeps_pressure(body) and compliance_of(body) < LEAST_COMPLIANCE
