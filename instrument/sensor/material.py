"""Materials of the sensors.

Marks in the sources: [T] the thesis, [S] published elsewhere, [A] an assumption.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Self

from palpate.instrument.errors import RangeError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


# --- materials -----------------------------------------------------------------------------------------


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


# --- films ---------------------------------------------------------------------------------------------

# Axes: 1 along the stretching direction of the film, 2 across it, 3 through the thickness.


@dataclass(frozen=True, slots=True)
class FilmMaterial:
    """A piezoelectric film.

    Attributes:
        compliance: s11, s22, s33, s23, s13, s12, s44, s55, s66 at constant field [1/Pa].
        strain: d31, d32, d33 [C/N].
        permittivity: ε33 at constant stress [F/m].
        source: where the numbers come from.

    Raises:
        RangeError: straining or charging such a film would set energy free.
    """

    name: str = field(repr=False)
    compliance: tuple[float, float, float, float, float, float, float, float, float]
    strain: tuple[float, float, float]
    permittivity: float
    source: str = field(repr=False)

    def __post_init__(self) -> None:
        numbers = (*self.compliance, *self.strain, self.permittivity)
        s11, s22, s33, s23, s13, s12 = self.compliance[:6]
        d31, d32, d33 = self.strain
        # the minors of the compliance, all of which are above 0 if the matrix is positive definite
        m11, m22, m33 = s22 * s33 - s23**2, s11 * s33 - s13**2, s11 * s22 - s12**2
        m23, m13, m12 = s12 * s13 - s11 * s23, s12 * s23 - s13 * s22, s13 * s23 - s12 * s33
        determinant = s11 * m11 + s12 * m12 + s13 * m13
        if not all(map(math.isfinite, numbers)) or min(s11, m33, determinant) <= 0:
            raise RangeError(f"film material {self.name!r}: its compliances are no stable material's; give others")
        energy = d31**2 * m11 + d32**2 * m22 + d33**2 * m33 + 2 * (d32 * d33 * m23 + d31 * d33 * m13 + d31 * d32 * m12)
        if min(self.compliance[6:]) <= 0 or not self.permittivity * determinant > energy:
            raise RangeError(
                f"film material {self.name!r}: shear compliances and the permittivity at constant strain must be"
                " above 0; give others"
            )

    @classmethod
    def isotropic(cls, modulus: float, poisson: float) -> Self:
        """An isotropic film with that Young modulus [Pa] and Poisson ratio, which gives no charge."""
        along, across, shear = 1 / modulus, -poisson / modulus, 2 * (1 + poisson) / modulus
        return cls(
            name="isotropic, without charge",
            compliance=(*3 * (along,), *3 * (across,), *3 * (shear,)),
            strain=(0.0, 0.0, 0.0),
            permittivity=1e-10,
            source="",
        )

    @property
    def modulus(self) -> float:
        """Young modulus through the thickness [Pa]."""
        return 1 / self.compliance[2]

    @property
    def poisson(self) -> float:
        """Poisson ratio by which a pull along axis 1 narrows the film along axis 2."""
        return -self.compliance[5] / self.compliance[0]

    @property
    def shear(self) -> tuple[float, float, float]:
        """Shear moduli c44, c55 and c66 [Pa]."""
        s44, s55, s66 = self.compliance[6:]
        return 1 / s44, 1 / s55, 1 / s66

    @property
    def law(self) -> Array:
        """Stress of axes a and d by the derivative along axis e of the displacement along axis b [Pa], (3, 3, 3, 3)."""
        import numpy as np

        law: Array = np.einsum("ab,ad,be->adbe", self.stiff()[0], np.eye(3), np.eye(3))
        for (a, d), shear in zip(((1, 2), (0, 2), (0, 1)), self.shear, strict=True):
            law[a, d, a, d] = law[a, d, d, a] = law[d, a, a, d] = law[d, a, d, a] = shear
        return law

    def stiff(self) -> tuple[Array, Array, float]:
        """Stiffness c [Pa] (3, 3), piezoelectric e = d c [C/m2] (3,), permittivity at constant strain [F/m]."""
        import numpy as np

        stiffness: Array = np.linalg.inv(self._compliance()).astype(np.float64)
        strain = np.array(self.strain)
        stress: Array = strain @ stiffness
        return stiffness, stress, self.permittivity - float(stress @ strain)

    def round(self) -> Self:
        """The material with axes 1 and 2 averaged, as a model of revolution needs it."""
        s11, s22, s33, s23, s13, s12, s44, s55, _ = self.compliance
        d31, d32, d33 = self.strain
        along, through, shear = (s11 + s22) / 2, (s13 + s23) / 2, (s44 + s55) / 2
        compliance = (along, along, s33, through, through, s12, shear, shear, 2 * (along - s12))
        return replace(self, compliance=compliance, strain=((d31 + d32) / 2, (d31 + d32) / 2, d33))

    def _compliance(self) -> Array:
        import numpy as np

        s11, s22, s33, s23, s13, s12 = self.compliance[:6]
        return np.array([[s11, s12, s13], [s12, s22, s23], [s13, s23, s33]])


_ISOTROPIC = FilmMaterial.isotropic(3e9, 0.34).compliance

FILM_MATERIALS: Mapping[str, FilmMaterial] = MappingProxyType(
    {
        "thesis": FilmMaterial(
            name="PVDF as the thesis has it",
            compliance=(
                *(0.0820e-8, 0.0820e-8, 0.0945e-8),
                *(-0.0350e-8, -0.0350e-8, -0.0265e-8),
                *(0.2150e-8, 0.2250e-8, 0.2250e-8),
            ),
            strain=(19e-12, 2e-12, -20e-12),
            permittivity=0.7434e-10,
            source="[T] Appendix I: [s] as printed, its power of ten read as 1e-8 m2/N and its s44, 0.0215, as 0.2150,"
            " and [ε], whose power of ten is lost and read as 1e-10 F/m (8.4 ε0); Table 3.2: d31 (18 to 20), d32, d33,"
            " the matrix [d] of the appendix being lost",
        ),
        "manufacturer": FilmMaterial(
            name="PVDF as its manufacturer has it",
            compliance=_ISOTROPIC,
            strain=(23e-12, 3e-12, -33e-12),
            permittivity=106e-12,
            source="[S] Measurement Specialties, Piezo Film Sensors Technical Manual, table 1: d31, d33, ε, Young"
            " modulus 2 to 4 GPa; d32 [A], in the proportion to d31 that uniaxial film has; Poisson ratio 0.34"
            " of Table 3.2 [T]",
        ),
    }
)
PVDF = FILM_MATERIALS["thesis"]
