"""Three-dimensional linear elasticity: square plates, one tooth or many, uniform pressure or a point load.

    solve(SolidParameters(sensed_modulus=100e3), refinement=2).force_ratio
    force_ratio(SolidParameters(sensed_modulus=100e3), tolerance=1e-3)

The sensor is a lattice of equal cells, one tooth in its ring in the middle of each; the sensed object covers all
of them. Contact holds in both directions (no lift-off). Symmetry planes of sensor and load are used.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from instrument.design import Design
from instrument.errors import RangeError, UnknownName
from instrument.models.solid_system import RESOLUTIONS, System, symmetry

_MODULI = ("sensed_modulus", "compliant_modulus", "tooth_modulus", "plate_modulus", "film_modulus")
_POISSON = ("sensed_poisson", "compliant_poisson", "tooth_poisson", "plate_poisson", "film_poisson")
_LENGTHS = (
    "sensed_thickness",
    "tooth_radius",
    "ring_inner_radius",
    "ring_outer_radius",
    "sensor_height",
    "plate_thickness",
    "film_thickness",
    "cell_length",
    "cell_width",
)
CHOICES = {
    "interface": ("bonded", "frictionless"),
    "support": ("elastic", "rigid"),
    "ring_outline": ("round", "square"),
    "outline": ("square", "round"),
    "load": ("pressure", "platen"),
}
REFINEMENTS = tuple(range(len(RESOLUTIONS)))
# Summation over some 1e5 unknowns.
ROUND_OFF = 1e-10


@dataclass(frozen=True, slots=True)
class SolidParameters:
    """One sensor, or a lattice of them, under one object. Lengths [m], Young moduli [Pa], Poisson ratios.

    Attributes:
        interface: "bonded": the object sticks to tooth and ring; "frictionless": it slides on both.
        support: "elastic": tooth, films and plates deform; "rigid": only object and ring do.
        ring_outline: "round", or "square": the compliant part fills its cell outside the gap.
        outline: of object and plates: "square", or "round": no wider than the ring; one tooth only.
        sensor_height: of the tooth, and of the ring above the film below the tooth.
        film_thickness: of both films; the ring is higher than the tooth by one, so that the face is flat.
        cell_length, cell_width: of the plan, for each tooth.
        columns, rows: teeth along length and width.
        separate_bases: each tooth has its own plates and base film.
        load: uniform "pressure" on the object, or a flat rigid "platen" glued to it.
        load_at: point load instead, at (x, y) from the corner of the object [m].
        force: in all [N].

    Raises:
        RangeError: a modulus, length or force is not positive and finite, a Poisson ratio is outside (-1, 0.5],
            parts overlap, or the load is off the object.
        UnknownName: no such interface, support, outline or load.
    """

    sensed_modulus: float = 1e5
    sensed_poisson: float = 0.3
    sensed_thickness: float = 3e-3  # rubber samples, 5.4.2
    compliant_modulus: float = 24e3  # 3.1.4
    compliant_poisson: float = 0.49
    tooth_modulus: float = 4.1e9  # 3.1.3
    tooth_poisson: float = 0.3
    plate_modulus: float = 70e6  # Table 3.1
    plate_poisson: float = 0.3
    film_modulus: float = 2.2e9  # inside the 1.8 to 2.7 GPa of Table 3.2
    film_poisson: float = 0.34
    interface: str = "bonded"
    support: str = "elastic"
    ring_outline: str = "round"
    outline: str = "square"
    tooth_radius: float = 1.4e-3  # 3.1.3
    ring_inner_radius: float = 1.5e-3  # 3.1.4
    ring_outer_radius: float = 5e-3
    sensor_height: float = 3.88e-3
    plate_thickness: float = 0.55e-3  # Table 3.1
    film_thickness: float = 25e-6  # 3.1.2
    cell_length: float = 10e-3
    cell_width: float = 10e-3
    columns: int = 1
    rows: int = 1
    separate_bases: bool = False
    load: str = "pressure"
    load_at: tuple[float, float] | None = None
    force: float = 1.0

    def __post_init__(self) -> None:
        named = [*((n, "Pa") for n in _MODULI), *((n, "m") for n in _LENGTHS), ("force", "N")]
        for name, unit in named:
            value = getattr(self, name)
            if not (0 < value < math.inf):
                raise RangeError(f"{name} {value:g} {unit} is not above 0 and finite; give a positive one")
        for name in _POISSON:
            value = getattr(self, name)
            if not (-1 < value <= 0.5):
                raise RangeError(f"{name} {value:g} is outside (-1, 0.5]; give a Poisson ratio")
        for kind, valid in CHOICES.items():
            if getattr(self, kind) not in valid:
                raise UnknownName(kind, getattr(self, kind), valid)
        limit = min(self.cell_length, self.cell_width) / 2 * (1 + 1e-12)
        if not (self.tooth_radius <= self.ring_inner_radius < self.ring_outer_radius <= limit):
            raise RangeError(
                f"parts overlap: tooth_radius {self.tooth_radius:g}, ring_inner_radius {self.ring_inner_radius:g}, "
                f"ring_outer_radius {self.ring_outer_radius:g} and half the cell {limit:g} m must follow in this order"
            )
        if self.columns < 1 or self.rows < 1:
            raise RangeError(f"{self.columns} x {self.rows} teeth: give at least one column and one row")
        if self.outline == "round" and (self.columns, self.rows) != (1, 1):
            raise RangeError(f"outline 'round' holds one tooth, not {self.columns} x {self.rows}; make it 'square'")
        if self.load_at is not None:
            self._require_inside(*self.load_at)

    def _require_inside(self, x: float, y: float) -> None:
        inside = 0 <= x <= self.length and 0 <= y <= self.width
        if self.outline == "round":
            inside = math.hypot(x - self.length / 2, y - self.width / 2) <= self.ring_outer_radius
        if not inside:
            raise RangeError(
                f"load at ({x:g}, {y:g}) m is off the object of {self.length:g} x {self.width:g} m; move it inside"
            )

    @property
    def length(self) -> float:
        """Of the object along x [m]."""
        return self.columns * self.cell_length

    @property
    def width(self) -> float:
        """Of the object along y [m]."""
        return self.rows * self.cell_width

    @property
    def load_area(self) -> float:
        """That the object is pressed on [m2]."""
        return math.pi * self.ring_outer_radius**2 if self.outline == "round" else self.length * self.width


@dataclass(frozen=True, slots=True)
class SolidSolution:
    """What the teeth take.

    Attributes:
        tooth_forces: by row, then column [N].
        total_force: that reaches the floor [N].
        force_ratio: sum of the tooth forces over the total force.
        unknowns: displacements solved for.
        residual: of the linear system, relative to the size of its terms.
        seconds: to assemble and factorise, and to solve.
    """

    tooth_forces: tuple[float, ...]
    total_force: float
    force_ratio: float
    unknowns: int
    residual: float
    seconds: tuple[float, float]


def of_design(design: Design) -> SolidParameters:
    """Dimensions and materials of a design, under the default object over the whole of it."""
    length, width = design.cell
    return SolidParameters(
        compliant_modulus=design.ring.material.modulus,
        compliant_poisson=design.ring.material.poisson,
        tooth_modulus=design.tooth.material.modulus,
        tooth_poisson=design.tooth.material.poisson,
        plate_modulus=design.plate.material.modulus,
        plate_poisson=design.plate.material.poisson,
        film_modulus=design.film_sheet.material.modulus,
        film_poisson=design.film_sheet.material.poisson,
        tooth_radius=design.tooth.radius,
        ring_inner_radius=design.ring.inner_radius,
        ring_outer_radius=design.ring.outer_radius,
        sensor_height=design.tooth.height,
        plate_thickness=design.plate.thickness,
        film_thickness=design.film_sheet.thickness,
        cell_length=length,
        cell_width=width,
        columns=design.columns,
        rows=design.rows,
        separate_bases=design.separate_bases,
    )


def identified(design: Design) -> SolidParameters:
    """The one set that was fitted to Tables A2.1 and A2.3 together: effective values, not physical ones.

    The rings fill their cells: round rings fit A2.1 alone, and miss A2.3 by up to 0.22.
    """
    return replace(
        of_design(design),
        sensed_thickness=3.6e-3,
        sensed_poisson=0.05,
        compliant_poisson=0.455,
        interface="frictionless",
        support="rigid",
        ring_outline="square",
    )


def solve(parameters: SolidParameters, refinement: int, solver: str = "") -> SolidSolution:
    """Forces on the teeth, on the mesh of one refinement.

    Args:
        solver: "pardiso", "superlu", or "" for the faster that is installed.

    Raises:
        RangeError: no such refinement.
        EstimateError: the linear system cannot be solved accurately.
        UnknownName: the solver is not installed.
    """
    start = time.perf_counter()
    system = _system(parameters, refinement, solver)
    built = time.perf_counter()
    teeth, total, residual = system.forces(parameters.load_at)
    return SolidSolution(
        tooth_forces=tuple(float(force) for force in teeth.ravel()),
        total_force=total,
        force_ratio=float(teeth.sum()) / total,
        unknowns=system.unknowns,
        residual=residual,
        seconds=(built - start, time.perf_counter() - built),
    )


def point_loads(
    parameters: SolidParameters, places: Sequence[tuple[float, float]], refinement: int, solver: str = ""
) -> NDArray[np.float64]:
    """Forces on the teeth under one point load after another, all in one factorisation.

    Args:
        places: of the load, (x, y) from the corner of the object [m].

    Returns:
        Shape (places, teeth) [N].

    Raises:
        RangeError: a place is off the object, or there is no such refinement.
        EstimateError: the linear system cannot be solved accurately.
        UnknownName: the solver is not installed.
    """
    symmetries = [symmetry(replace(parameters, load_at=place)) for place in places]
    mirrored = (all(along for along, _ in symmetries), all(across for _, across in symmetries))
    system = _system(replace(parameters, load_at=places[0]), refinement, solver, mirrored)
    return np.array([system.forces(place)[0].ravel() for place in places])


def force_ratio(parameters: SolidParameters, tolerance: float, solver: str = "") -> tuple[float, float]:
    """Sum of the tooth forces over total force, and a bound on its error, by refining until that meets `tolerance`.

    A refinement divides the error by about three. The bound is the last change, or what is left of a series that
    falls as slowly as the last two changes, where that is more.

    Raises:
        RangeError: the tolerance is not positive and finite, or the finest mesh does not meet it.
    """
    if not (0 < tolerance < math.inf):
        raise RangeError(f"tolerance {tolerance:g} is not above 0 and finite; give a positive one")
    ratios = [solve(parameters, refinement, solver).force_ratio for refinement in REFINEMENTS[:2]]
    for refinement in REFINEMENTS[2:]:
        ratios.append(solve(parameters, refinement, solver).force_ratio)
        before, change = abs(ratios[-2] - ratios[-3]), abs(ratios[-1] - ratios[-2])
        slowness = min(change / before, 0.9) if before > 0 else 0.5
        estimate = max(change, 0.2 * before, change * slowness / (1 - slowness)) + ROUND_OFF
        if estimate <= tolerance:
            return ratios[-1], estimate
    raise RangeError(
        f"model 'solid' cannot answer to {tolerance:g}: its best here is {estimate:.1e}; give a larger tolerance"
    )


def _system(
    parameters: SolidParameters, refinement: int, solver: str, mirrored: tuple[bool, bool] | None = None
) -> System:
    if refinement not in REFINEMENTS:
        raise RangeError(f"refinement {refinement} is outside {REFINEMENTS[0]} to {REFINEMENTS[-1]}; give one of these")
    return System(parameters, refinement, solver, mirrored)
