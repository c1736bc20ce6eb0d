"""What chance allows, for tests of stated uncertainties."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.special import chdtri  # scipy.stats takes a second to import


def plausible(deviates: Sequence[float]) -> bool:
    """Whether the sum of squares of standard deviates is within what 998 of 1000 such sums keep to."""
    count = len(deviates)
    return bool(chdtri(count, 0.999) < math.fsum(z * z for z in deviates) < chdtri(count, 0.001))
