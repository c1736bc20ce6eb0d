"""Materials of the sensors.

Marks in the sources: [T] the thesis, [S] published elsewhere, [A] an assumption.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.instrument.errors import RangeError


@dataclass(frozen=True, slots=True)
class Material:
    """A linear elastic, isotropic material.

    Attributes:
        modulus: Young modulus [Pa] that the models use.
        modulus_range: lowest and highest Young modulus [Pa] that the source gives.
        poisson: Poisson ratio.
        source: where the numbers come from.

    Raises:
        RangeError: the modulus is not positive and finite, or the Poisson ratio is outside its limits.
    """

    name: str
    modulus: float
    modulus_range: tuple[float, float]
    poisson: float
    source: str

    def __post_init__(self) -> None:
        if not (0 < self.modulus < math.inf):
            raise RangeError(
                f"modulus {self.modulus:g} Pa of {self.name} is not above 0 and finite; give a positive one"
            )
        if not (-1 < self.poisson <= 0.5):
            raise RangeError(f"Poisson ratio {self.poisson:g} of {self.name} is outside (-1, 0.5]; give one inside")


PLEXIGLAS_THESIS = Material(
    name="plexiglas as the thesis has it",
    modulus=70e6,
    modulus_range=(50e6, 100e6),
    poisson=0.3,
    source="[T] Table 3.1 and 3.1.1; forty times softer than the physical one",
)
PLEXIGLAS_PHYSICAL = Material(
    name="plexiglas, PMMA",
    modulus=3e9,
    modulus_range=(2.4e9, 3.4e9),
    poisson=0.3,
    source="[S] cast PMMA sheet by ISO 527: 2.4 to 3.4 GPa, suppliers' data sheets; Poisson ratio [T] Table 3.1",
)
PHENOLIC = Material(
    name="phenolic",
    modulus=4.1e9,
    modulus_range=(4.1e9, 10e9),
    poisson=0.3,
    source="[T] 3.1.3; the low end of the range",
)
NEOPRENE_RING = Material(
    name="neoprene of the compliant ring",
    modulus=24e3,
    modulus_range=(24e3, 33e3),
    poisson=0.49,
    source="[T] 3.1.4, and 5.4: the material of rubber sample 2; Poisson ratio [A]",
)
