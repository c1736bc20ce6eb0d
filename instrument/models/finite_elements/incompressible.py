"""Condensation of bodies that keep their volume.

    extrapolated(lambda added: condense(mesh_at(compliance + added)), step)

Pressures are eliminated inside each element, which takes a compliance 1/λ above 0. What is condensed is a smooth
function of that compliance. So it is found at several somewhat greater ones, and extrapolated to the true one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from palpate.instrument.models.finite_elements.fronts import Array, Condensed

# Multiples of the step, and Lagrange's weights at 0.
NODES = ((1.0, 4.0), (2.0, -6.0), (3.0, 4.0), (4.0, -1.0))


def extrapolated(condensed: Callable[[float], Condensed], step: float) -> Condensed:
    """What is left of a mesh at the true compliance 1/λ.

    Args:
        condensed: what is left when this much is added to the compliance, in any unit.
        step: least addition that the elements bear, in that unit.
    """
    found = [(weight, condensed(node * step)) for node, weight in NODES]
    weights = np.array([weight for weight, _ in found])

    def at_true(part: str) -> Array:
        values: Array = np.tensordot(weights, [getattr(each, part) for _, each in found], axes=1)
        return values

    return Condensed(
        stiffness=at_true("stiffness"),
        loads=at_true("loads"),
        work=at_true("work"),
    )


def extrapolated_number(value: Callable[[float], float], step: float) -> float:
    """A number at the true compliance that makes sense beside `extrapolated` matrices alone, as their differences do.

    Args:
        value: the number when this much is added to the compliance, in any unit.
        step: as in `extrapolated`.
    """
    return sum(weight * value(node * step) for node, weight in NODES)
