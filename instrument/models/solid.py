"""Three-dimensional linear elasticity: square plates, one tooth or many, uniform pressure or a point load.

    solve(SolidParameters(sensed_modulus=100e3), refinement=2).force_ratio
    force_ratio(SolidParameters(sensed_modulus=100e3), tolerance=1e-3)

The sensor is a lattice of equal cells, one tooth in its ring in the middle of each; the sensed object covers all
of them. Contact holds in both directions (no lift-off). Symmetry planes of sensor and load are used.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from instrument.errors import EstimateError, RangeError
from instrument.models.solid_system import System

Interface = Literal["bonded", "frictionless"]
RingShape = Literal["round", "square"]


@dataclass(frozen=True, slots=True)
class SolidParameters:
    """One sensor under one object. Lengths in metres, moduli in Pa, force in N.

    Attributes:
        sensed_modulus, sensed_poisson, sensed_thickness: the object.
        compliant_modulus, compliant_poisson: the rings.
        plate_modulus: of the two base plates.
        interface: of the object with tooth and ring.
        ring_shape: "round", or "square": the compliant part fills its cell around the gap.
        rigid: tooth, plates and films do not deform; the rings stand on a rigid floor.
        cell_length, cell_width: of the plan, for each tooth.
        columns, rows: teeth along length and width.
        separate_bases: each tooth has its own plates.
        load_at: point load at (x, y) from the corner of the object [m]; None is uniform pressure.

    Raises:
        RangeError: a value lies outside its limits.
    """

    sensed_modulus: float
    sensed_poisson: float = 0.3
    sensed_thickness: float = 3e-3
    compliant_modulus: float = 24e3
    compliant_poisson: float = 0.49
    plate_modulus: float = 70e6
    plate_poisson: float = 0.3
    interface: Interface = "bonded"
    ring_shape: RingShape = "round"
    rigid: bool = False
    tooth_modulus: float = 4.1e9
    tooth_poisson: float = 0.3
    film_modulus: float = 2.2e9
    film_poisson: float = 0.34
    tooth_radius: float = 1.4e-3
    ring_inner_radius: float = 1.5e-3
    ring_outer_radius: float = 5e-3
    ring_height: float = 3.88e-3
    plate_thickness: float = 0.55e-3
    film_thickness: float = 25e-6
    cell_length: float = 10e-3
    cell_width: float = 10e-3
    columns: int = 1
    rows: int = 1
    separate_bases: bool = False
    force: float = 1.0
    load_at: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        positive = [name for name in self.__slots__ if name.endswith(("_modulus", "_thickness", "_height", "_radius"))]
        for name in (*positive, "cell_length", "cell_width", "force"):
            value = getattr(self, name)
            if not (0 < value < math.inf):
                raise RangeError(f"{name} {value:g} is not above 0 and finite; give a positive one")
        for name in ("sensed_poisson", "compliant_poisson", "plate_poisson", "tooth_poisson", "film_poisson"):
            value = getattr(self, name)
            if not (-1 < value <= 0.5):
                raise RangeError(f"{name} {value:g} is outside (-1, 0.5]; give a Poisson ratio inside")
        limit = min(self.cell_length, self.cell_width) / 2
        if not (self.tooth_radius <= self.ring_inner_radius < self.ring_outer_radius <= limit * (1 + 1e-12)):
            raise RangeError(
                f"radii of tooth {self.tooth_radius:g}, ring {self.ring_inner_radius:g} to {self.ring_outer_radius:g} "
                f"and half the cell {limit:g} m do not follow one another; parts overlap"
            )
        if self.film_thickness >= self.ring_height:
            raise RangeError(
                f"film_thickness {self.film_thickness:g} m leaves no tooth in ring_height {self.ring_height:g} m"
            )
        if self.columns < 1 or self.rows < 1:
            raise RangeError(f"{self.columns} x {self.rows} teeth: give at least one column and one row")
        if self.interface not in ("bonded", "frictionless"):
            raise RangeError(f"interface {self.interface!r} is neither 'bonded' nor 'frictionless'")
        if self.ring_shape not in ("round", "square"):
            raise RangeError(f"ring_shape {self.ring_shape!r} is neither 'round' nor 'square'")
        if self.load_at is not None:
            x, y = self.load_at
            if not (0 <= x <= self.length and 0 <= y <= self.width):
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


@dataclass(frozen=True, slots=True)
class SolidSolution:
    """What the teeth take.

    Attributes:
        tooth_forces: by row, then column [N].
        total_force: that reaches the floor [N].
        force_ratio: sum of the tooth forces over the total force.
        unknowns: displacements solved for.
        residual: relative, of the linear system.
        seconds: to build, and to factorise and solve.
    """

    tooth_forces: tuple[float, ...]
    total_force: float
    force_ratio: float
    unknowns: int
    residual: float
    seconds: tuple[float, float]


def solve(parameters: SolidParameters, refinement: int, solver: str = "") -> SolidSolution:
    """Forces on the teeth on the mesh of one refinement (0, 1, 2, …).

    Args:
        solver: "pardiso", "superlu", or "" for the faster that is installed.

    Raises:
        EstimateError: the system is singular to working precision.
        UnknownName: the solver is not installed.
    """
    start = time.perf_counter()
    system = System(parameters, refinement, solver)
    built = time.perf_counter()
    teeth, total, residual = system.forces(parameters.load_at)
    return SolidSolution(
        tooth_forces=tuple(float(force) for force in teeth.ravel()),
        total_force=total,
        force_ratio=float(np.sum(teeth)) / total,
        unknowns=system.unknowns,
        residual=residual,
        seconds=(built - start, time.perf_counter() - built),
    )
