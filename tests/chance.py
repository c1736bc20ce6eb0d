"""What chance allows, for tests of stated uncertainties."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.special import chdtri, ndtri, stdtr  # scipy.stats takes a second to import


def plausible(deviates: Sequence[float], freedom: float = math.inf) -> bool:
    """Whether the sum of squares of standard deviates is within what 998 of 1000 such sums keep to.

    Args:
        deviates: deviations from the truth, each over its stated standard uncertainty.
        freedom: degrees of freedom of these uncertainties, if finite: the deviates are Student's, and count as the
            normal ones of the same probability.
    """
    normal = deviates if math.isinf(freedom) else ndtri(stdtr(freedom, deviates)).tolist()
    count = len(normal)
    return bool(chdtri(count, 0.999) < math.fsum(z * z for z in normal) < chdtri(count, 0.001))
