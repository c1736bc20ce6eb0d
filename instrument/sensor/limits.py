"""Checks of numbers that designs and models share, with their messages."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from palpate.instrument.errors import RangeError


def require_positive(value: ArrayLike, label: str, unit: str, of: str = "") -> None:
    """Check that a number, or each number of an array, is above 0 and finite. Raises RangeError."""
    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    bad = ~((values > 0) & np.isfinite(values))
    if bad.any():
        whose = f" of the {of}" if of else ""
        raise RangeError(f"{label} {values[bad][0]:g} {unit}{whose} is not above 0 and finite; give a positive one")


def require_nested(radii: Mapping[str, float], where: str = "") -> None:
    """Check that each radius [m] fits into the next: tooth, ring's inside and outside, cell. Raises RangeError.

    A gap between tooth and ring is not needed, but a ring needs some width. A cell may be just as wide as its ring.
    """
    for place, ((inner, low), (outer, high)) in enumerate(pairwise(radii.items())):
        if not (low <= high * (1 + 1e-12)) or (place == 1 and low == high):
            raise RangeError(
                f"{where}parts overlap: {inner} {low:g} m is not below {outer} {high:g} m; make it smaller"
            )
