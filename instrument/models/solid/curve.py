"""How fine a mesh of the solid model is, and what is known of it over the modulus of the object."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.models.finite_elements.poles import Curve

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Resolution:
    """Fineness of a mesh.

    Attributes:
        layers: steps that shrink towards each singular edge.
        ratio: size of one step over the next.
        sectors: number of quadrilaterals along an eighth of the circle.
        degree: degree of the shape functions in the plan.
        rubber: their degree along the height of object and rings; None: as in the plan.
        stiff: the same for plates, films and teeth.
    """

    layers: int
    ratio: float
    sectors: int
    degree: int
    rubber: int | None = None
    stiff: int | None = None


@dataclass(frozen=True, slots=True)
class SolidCurve:
    """Answers of one mesh of the solid model, over the modulus of the object.

    Attributes:
        poles: its goals are those of `Goals`.
        films: as in `Goals`, for charges of the whole sensor.
        teeth, bases: number of teeth and of bases.
        unknowns: number of displacements.
        seconds: processor time of the mesh, and of the elimination [s].
    """

    poles: Curve
    films: Vector
    teeth: int
    bases: int
    unknowns: int
    seconds: tuple[float, float]
