"""What the sensors are made of.

Marks in the sources: [T] the thesis, [A] an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Material:
    """A linear elastic, isotropic material.

    Attributes:
        modulus: Young modulus [Pa] that the models use.
        modulus_range: lowest and highest Young modulus [Pa] that the source gives.
        poisson: Poisson ratio.
        source: where the numbers come from.
    """

    name: str
    modulus: float
    modulus_range: tuple[float, float]
    poisson: float
    source: str


PLEXIGLAS_THESIS = Material(
    name="plexiglas as the thesis has it",
    modulus=70e6,
    modulus_range=(50e6, 100e6),
    poisson=0.3,
    source="[T] Table 3.1 and 3.1.1; PMMA is about 3 GPa, forty times stiffer",
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
PVDF = Material(
    name="PVDF film",
    modulus=2.2e9,
    modulus_range=(1.8e9, 2.7e9),
    poisson=0.34,
    source="[T] Table 3.2; modulus [A], inside the range of the table",
)
