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

from palpate.instrument.models.parameters import CLOSED, RoundParameters
from palpate.instrument.sensor.film_material import FilmMaterial

Array = NDArray[np.float64]

GRADING = 0.17  # size of an element over that of its outer neighbour; 0.15 to 0.2 is best for corners
NEAR = 1e-9  # share of its distance from the axis by which a corner is beside another; nearer ones are one
# Size of the elements at a corner [m], and number of layers within.
Corner = tuple[float, int]


@dataclass(frozen=True, slots=True)
class Body:
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

    bodies: tuple[Body, ...]
    radii: Array
    heights: Array
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
        Body("object", "object", (0.0, p.sensed_radius), (face, top), p.sensed_modulus, p.sensed_poisson),
        Body(
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
            Body("tooth", "tooth", tooth, (seat, face), p.tooth_modulus, p.tooth_poisson),
            Body("tooth film", "tooth", tooth, (base, seat), *film),
            Body("upper plate", "base", plate, heights[2], *plexiglas),
            Body("base film", "base", plate, heights[1], *film),
            Body("lower plate", "base", plate, heights[0], *plexiglas),
        ]
    return Grid(tuple(bodies), _radii(p, layers), _heights(p, layers, levels, base, seat, face), face, base)


def _gap(p: RoundParameters) -> float:
    """Width of the gap [m], at least that of a closed gap: a smaller one changes nothing and costs digits."""
    return max(p.ring_inner_radius - p.tooth_radius, CLOSED * p.tooth_radius)


def _radii(p: RoundParameters, layers: int) -> Array:
    ring = p.ring_outer_radius - p.ring_inner_radius
    inner = min(_gap(p), p.tooth_radius, ring, p.sensed_thickness, p.sensor_height), layers
    outer = min(ring, p.sensed_thickness, p.sensor_height), layers
    corners: dict[float, Corner | None] = {0.0: None, p.tooth_radius: inner, p.ring_inner_radius: inner}
    corners |= dict.fromkeys({p.ring_outer_radius, p.sensed_radius}, outer)
    if p.support == "elastic":
        corners.setdefault(p.plate_radius, None)
    return _line(corners, max(p.tooth_radius, p.ring_outer_radius / 2))


def _heights(p: RoundParameters, layers: int, levels: Array, base: float, seat: float, face: float) -> Array:
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


def _line(corners: Mapping[float, Corner | None], longest: float) -> Array:
    """Grid lines through all corners, with layers at each and no element above `longest`."""
    ends: list[float] = []
    for corner in sorted(corners):
        if not ends or corner - ends[-1] > NEAR * corner:
            ends.append(corner)
    pieces = [_interval(low, high, corners[low], corners[high], longest) for low, high in pairwise(ends)]
    return np.concatenate([[ends[0]], *pieces])


def _interval(low: float, high: float, at_low: Corner | None, at_high: Corner | None, longest: float) -> Array:
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


def _cut(start: float, end: float, longest: float) -> Array:
    """Grid lines inside ]start, end]. The first step is at most `longest`, each next one at most twice the one before.

    Stresses even out within the sensor's radius, so a long object needs few elements.
    """
    count = max(1, math.ceil(math.log2((end - start) / longest + 1)))
    shares = 2.0 ** np.arange(1, count + 1) - 1
    lines: Array = start + (end - start) * shares / shares[-1]
    return lines


def _distances(size: float, layers: int, reach: float) -> Array:
    """Distances of grid lines from a corner, ascending. They keep their places as layers are added."""
    count = math.ceil(math.log(reach / size) / -math.log(GRADING) - 1e-9) + layers
    distances: Array = reach * GRADING ** np.arange(count, -1, -1, dtype=np.float64)
    return distances


def inside(lines: Array, extent: Sequence[float]) -> NDArray[np.intp]:
    """Indices of the intervals between grid lines that lie inside `extent`."""
    middle = (lines[1:] + lines[:-1]) / 2
    return np.flatnonzero((middle > extent[0]) & (middle < extent[1]))
