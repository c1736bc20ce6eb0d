"""The column model: tooth and ring as springs in parallel, each in series with the object above it.

The tooth is rigid, the sensor's face stays flat, and object and ring carry no shear from one column to
the other. With a the tooth's share of the area and λ = E_s T_c / (E_c T_s) the force ratio is

    R = a (1 + λ) / (1 + a λ).

    It is a for a very soft object and 1 for a very hard one.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.limits import require_positive
from palpate.instrument.sensor.sample import Sample

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
