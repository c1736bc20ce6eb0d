"""The column model: tooth and ring as springs in parallel, each in series with the object above it.

The tooth is rigid, the sensor's face stays flat, and object and ring carry no shear from one column to
the other. With a the tooth's share of the area and λ = E_s T_c / (E_c T_s) the force ratio is

    R = a (1 + λ) / (1 + a λ).

    It is a for a very soft object and 1 for a very hard one.

The fitted column model keeps the law and fits its two numbers to the thesis' three-dimensional tables.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS
from palpate.instrument.sensor.sample import SAMPLES, Sample, require_positive

Moduli = TypeVar("Moduli", float, NDArray[np.float64])


def force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force."""
    return ratio_of_modulus(design, sensed.modulus, sensed.thickness)


def ratio_of_modulus(design: Design, modulus: Moduli, thickness: float) -> Moduli:
    """Tooth force over total force.

    Args:
        design: the sensor.
        modulus: Young modulus of the object [Pa], a number or an array of any shape.
        thickness: thickness of the object [m].

    Returns:
        Force ratio, of the shape of `modulus`.

    Raises:
        RangeError: a modulus or the thickness is not positive and finite.
    """
    require_positive(modulus, "modulus", "Pa", "object")
    require_positive(thickness, "thickness", "m", "object")
    share = design.tooth.area / (design.tooth.area + design.ring.area)
    hardness = modulus * (design.ring.height / (design.ring.material.modulus * thickness))
    # Divided by 1 + λ, nothing overflows or cancels at either end of the range of moduli.
    return share / (share + (1 - share) / (1 + hardness))


def stiffness(design: Design, sensed: Sample) -> float:
    """Stiffness of the stack of object and sensor: force over compression [N/m]."""
    return stretch_stiffness(design, sensed.modulus, sensed.thickness)[2]


def stretch_stiffness(design: Design, modulus: float, thickness: float) -> tuple[float, float, float]:
    """Stiffness of tooth column, ring column and both together [N/m].

    Args:
        design: the sensor.
        modulus: Young modulus of the object [Pa].
        thickness: thickness of the object [m].

    Raises:
        RangeError: the modulus or the thickness is not positive and finite.
    """
    require_positive(modulus, "modulus", "Pa", "object")
    require_positive(thickness, "thickness", "m", "object")
    tooth = design.tooth.area * modulus / thickness
    ring = design.ring.area / (thickness / modulus + design.ring.height / design.ring.material.modulus)
    return tooth, ring, tooth + ring


# --- fitted to the thesis' three-dimensional tables ------------------------------------------------------

# Tooth force over ring force, the odds R / (1 - R), is a straight line in the ratio of moduli of object and ring,
#
#     R / (1 - R) = a + b E1/E2.
#
# The column model follows this law with a = A_tooth / A_ring and b = a T_ring / T_object. So does any
# sensor on a rigid support whose ring's top stays level (interface "capped"), because object and ring are then two
# springs. All tables of the thesis' finite elements keep the law to their last digits.
#
# The two numbers were fitted to Tables A2.1 and A2.3 for the ring of 24 kPa, by least squares over the cells that
# needed no repair. They predict Tables A2.2 and A2.4 for 33 kPa. Table A2.5 is a copy of A2.3, so different bases have
# the numbers of the common base. The model says what the thesis' finite elements say, and is no nearer to an experiment
# than they are.

# Ratios of moduli in the tables: 14.9 kPa on 33 kPa to 140 GPa on 24 kPa.
LOWEST, HIGHEST = 14.9e3 / 33e3, 140e9 / 24e3


@dataclass(frozen=True, slots=True)
class OddsLine:
    """Odds of tooth to ring over the ratio of moduli.

    Attributes:
        start: odds under an infinitely soft object.
        slope: rise of the odds over the ratio of moduli, object over ring.
        residual: greatest difference of the force ratio from a cell of the tables of both rings.
    """

    start: float
    slope: float
    residual: float

    def force_ratio(self, modulus_ratio: float) -> float:
        """Tooth force over total force."""
        odds = self.start + self.slope * modulus_ratio
        return 1 / (1 + 1 / odds)

    def modulus_ratio(self, force_ratio: float) -> float:
        """Modulus of the object over that of the ring, from the force ratio.

        Raises:
            RangeError: no object has that force ratio.
        """
        least = self.force_ratio(0.0)
        if not (least <= force_ratio < 1):
            raise RangeError(f"force ratio {force_ratio:g} is outside {least:.4g} to 1; no object has it")
        return (force_ratio / (1 - force_ratio) - self.start) / self.slope


_SINGLE = OddsLine(start=0.10778, slope=0.092395, residual=1.0e-4)
_PAIR = OddsLine(start=0.06315, slope=0.049347, residual=2.1e-4)
LINES: Mapping[str, OddsLine] = MappingProxyType(
    {"single": _SINGLE, "common_base": _PAIR, "different_base": _PAIR},
)


def fitted_force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force.

    Raises:
        RangeError: the tables have no such design, ratio of moduli, or thickness of the object.
    """
    line = line_of(design)
    thickness = SAMPLES["1"].thickness
    if not math.isclose(sensed.thickness, thickness, rel_tol=1e-6):
        raise RangeError(
            f"thickness {sensed.thickness:g} m of sample {sensed.name!r}: the tables behind model 'column_fitted' have"
            f" one thickness, which is taken to be the samples' {thickness:g} m; model 'column' knows others"
        )
    ratio = sensed.modulus / design.ring.material.modulus
    if not (LOWEST * (1 - 1e-9) <= ratio <= HIGHEST * (1 + 1e-9)):
        raise RangeError(
            f"modulus {sensed.modulus:g} Pa of sample {sensed.name!r} is {ratio:.3g} times the ring's: the tables"
            f" behind model 'column_fitted' have {LOWEST:.3g} to {HIGHEST:.3g}; model 'column' has no such limit"
        )
    return line.force_ratio(ratio)


def residual(design: Design) -> float:
    """Greatest difference of the force ratio from the tables. Raises RangeError."""
    return line_of(design).residual


def line_of(design: Design) -> OddsLine:
    """The line of a design of the thesis, on a ring of any modulus.

    Raises:
        RangeError: the tables have no such design.
    """
    if design.name not in LINES or not _same_bodies(design, DESIGNS[design.name]):
        raise RangeError(
            f"design {design.name!r}, with its dimensions, has no table in the thesis that model 'column_fitted' could"
            f" have been fitted to; take model 'column', or one of {', '.join(LINES)} as it is"
        )
    return LINES[design.name]


def _same_bodies(design: Design, other: Design) -> bool:
    """Whether two designs have the same bodies.

    The ring's modulus may differ, because the law contains it. Poisson ratio and outline may differ, because springs
    have neither.
    """
    return (
        design.teeth == other.teeth
        and (design.tooth.radius, design.tooth.height) == (other.tooth.radius, other.tooth.height)
        and replace(design.ring, material=other.ring.material, outline=other.ring.outline) == other.ring
    )
