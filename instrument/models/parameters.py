"""The round single sensor under a round sensed object: every number that the finite-element model needs.

From below: plate, base film, plate; on it, side by side, film and tooth in the middle and the compliant
ring around them; on both the sensed object, under a uniform pressure. The thesis' sensor is square
(10 x 10 mm); the radii say which disc stands for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import pairwise
from types import MappingProxyType

from instrument.errors import RangeError, UnknownName

INTERFACES = ("bonded", "frictionless")
SUPPORTS = ("elastic", "rigid")

_MODULI = ("sensed_modulus", "compliant_modulus", "tooth_modulus", "plate_modulus", "film_modulus")
_POISSON = ("sensed_poisson", "compliant_poisson", "tooth_poisson", "plate_poisson", "film_poisson")
_LENGTHS = (
    "sensed_thickness",
    "sensed_radius",
    "tooth_radius",
    "ring_inner_radius",
    "ring_outer_radius",
    "sensor_height",
    "plate_radius",
    "plate_thickness",
    "film_thickness",
)


@dataclass(frozen=True, slots=True)
class SensorParameters:
    """Dimensions [m], Young moduli [Pa], Poisson ratios, and how the parts touch. Defaults: case A at 0.1 MPa.

    Attributes:
        interface: "bonded": the object sticks to tooth and ring; "frictionless": it slides on both.
        support: "elastic": tooth, films and plates deform; "rigid": only object and ring do.
        sensor_height: of the tooth, and of the ring above the film below the tooth.
        film_thickness: of both films; the ring is higher than the tooth by one, so that the face is flat.

    Raises:
        RangeError: a modulus or length is not positive and finite, a Poisson ratio is outside (-1, 0.5],
            or parts overlap.
        UnknownName: no such interface or support.
    """

    sensed_modulus: float = 1e5
    sensed_poisson: float = 0.3
    sensed_thickness: float = 3e-3  # rubber samples, 5.4.2
    sensed_radius: float = 5e-3
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
    tooth_radius: float = 1.4e-3  # 3.1.3
    ring_inner_radius: float = 1.5e-3  # 3.1.4
    ring_outer_radius: float = 5e-3
    sensor_height: float = 3.88e-3
    plate_radius: float = 5e-3
    plate_thickness: float = 0.55e-3  # Table 3.1
    film_thickness: float = 25e-6  # 3.1.2

    def __post_init__(self) -> None:
        for name, unit in (*((name, "Pa") for name in _MODULI), *((name, "m") for name in _LENGTHS)):
            value = getattr(self, name)
            if not (0 < value < math.inf):
                raise RangeError(f"{name} {value:g} {unit} is not above 0 and finite; give a positive one")
        for name in _POISSON:
            value = getattr(self, name)
            if not (-1 < value <= 0.5):
                raise RangeError(f"{name} {value:g} is outside (-1, 0.5]; give a Poisson ratio")
        for kind, value, valid in (
            ("interface", self.interface, INTERFACES),
            ("support", self.support, SUPPORTS),
        ):
            if value not in valid:
                raise UnknownName(kind, value, valid)
        order = ("tooth_radius", "ring_inner_radius", "ring_outer_radius", "plate_radius")
        for inner, outer in pairwise(order):
            low, high = getattr(self, inner), getattr(self, outer)
            if low > high or (low == high and inner == "ring_inner_radius"):
                raise RangeError(f"parts overlap: {inner} {low:g} m is not below {outer} {high:g} m; make it smaller")
        if self.sensed_radius <= self.ring_inner_radius:
            raise RangeError(
                f"sensed_radius {self.sensed_radius:g} m does not reach the ring at ring_inner_radius"
                f" {self.ring_inner_radius:g} m; give a larger object"
            )

    @property
    def modulus_ratio(self) -> float:
        """Young modulus of the object over that of the ring."""
        return self.sensed_modulus / self.compliant_modulus

    def canonical(self) -> str:
        """Every field and value, exactly and in one order: what a content hash is taken of."""
        return ";".join(f"{field.name}={getattr(self, field.name)!r}" for field in fields(self))


PARAMETER_SETS: Mapping[str, SensorParameters] = MappingProxyType(
    {
        # Reference case A: the experiments' 3 mm rubber on the sensor of chapter 3, square plates as a disc.
        "physical": SensorParameters(),
        # The program of Appendix A2.1 gives the object the plate's thickness.
        "thesis": SensorParameters(sensed_thickness=0.55e-3),
        # Fitted to Table A2.1. Effective values, not physical ones: many other sets fit as well.
        "identified": SensorParameters(
            sensed_thickness=2.01e-3,
            sensed_poisson=0.499,
            sensed_radius=5.64e-3,  # disc of the area of the 10 x 10 mm plate
            compliant_poisson=0.095,
            interface="frictionless",
            support="rigid",
        ),
    }
)


def get_parameters(name: str) -> SensorParameters:
    """The parameter set of that name.

    Raises:
        UnknownName: no such set.
    """
    try:
        return PARAMETER_SETS[name]
    except KeyError:
        raise UnknownName("parameter set", name, PARAMETER_SETS) from None
