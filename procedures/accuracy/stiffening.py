"""Rubber at large strain: the column model with neo-Hookean springs, in closed form except for one root.

A neo-Hookean column of Young modulus E at rest bears the nominal stress E/3 (λ - 1/λ²) at the stretch λ (Treloar, The
Physics of Rubber Elasticity, 1975, 5.2), and stiffens under compression where a linear one does not.
"""

from __future__ import annotations

from collections.abc import Callable

from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import Sample


def force_ratio(design: Design, sensed: Sample, force: float, times: float = 1.0) -> float:
    """Tooth force over total force by neo-Hookean columns that are loaded from rest.

    Args:
        design: the sensor.
        sensed: the object.
        force: force on one tooth and its ring [N].
        times: factor on all moduli.
    """
    from scipy.optimize import brentq

    ring, tooth = design.ring, design.tooth

    def ahead(on_tooth: float) -> float:
        """Difference of how far the face sinks above the tooth and above the ring [m]."""
        beside = (force - on_tooth) / ring.area
        above = sensed.thickness * (_stretch(beside / times, sensed.modulus, brentq) - 1)
        below = ring.height * (_stretch(beside / times, ring.material.modulus, brentq) - 1)
        over_tooth = sensed.thickness * (_stretch(on_tooth / tooth.area / times, sensed.modulus, brentq) - 1)
        return above + below - over_tooth

    return float(brentq(ahead, 1e-9 * force, (1 - 1e-9) * force, xtol=1e-12)) / force


def _stretch(stress: float, modulus: float, root: Callable[..., float]) -> float:
    """Length over length at rest under a nominal compression [Pa]."""
    return root(lambda stretch: modulus / 3 * (stretch**-2 - stretch) - stress, 1e-3, 1.0)
