"""What designs and models refuse, said in one way."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from palpate.instrument.errors import RangeError


def require_positive(value: ArrayLike, label: str, unit: str, of: str = "") -> None:
    """Raises RangeError: a number, or one of an array, is not above 0 and finite."""
    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    bad = ~((values > 0) & np.isfinite(values))
    if bad.any():
        whose = f" of the {of}" if of else ""
        raise RangeError(f"{label} {values[bad][0]:g} {unit}{whose} is not above 0 and finite; give a positive one")


def require_nested(radii: Mapping[str, float], where: str = "") -> None:
    """Raises RangeError: of tooth, ring's inside, ring's outside and what holds them [m], one does not fit the next.

    Between tooth and ring there may be no gap; a ring has some width. A cell may be as wide as its ring, but for
    rounding.
    """
    for place, ((inner, low), (outer, high)) in enumerate(pairwise(radii.items())):
        if not (low <= high * (1 + 1e-12)) or (place == 1 and low == high):
            raise RangeError(
                f"{where}parts overlap: {inner} {low:g} m is not below {outer} {high:g} m; make it smaller"
            )
