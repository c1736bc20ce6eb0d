"""What chance allows, for tests of stated uncertainties."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.special import chdtri, ndtri, stdtr

from palpate.instrument.signals.estimate import SineFit, quotient_bias


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


# --- the ratio of two amplitudes ---------------------------------------------------------------------


def amplitude_ratio(fit: SineFit, numerator: int, denominator: int) -> tuple[float, float]:
    """Ratio of the amplitudes of two channels, and its standard uncertainty from noise.

    (u_R/R)² = u₁²/A₁² + u₂²/A₂² − 2 r u₁u₂/(A₁A₂), where r is the correlation of both amplitudes. In phase over whole
    cycles this is the Cramér–Rao bound. The biases of both amplitudes and of their quotient are subtracted.
    """
    top, bottom = float(fit.unbiased[numerator]), float(fit.unbiased[denominator])
    top_u, bottom_u = float(fit.amplitude_u[numerator]), float(fit.amplitude_u[denominator])
    ratio = top / bottom
    common = float(fit.amplitude_correlation[numerator, denominator]) * top_u * bottom_u
    variance = top_u**2 + (ratio * bottom_u) ** 2 - 2 * ratio * common
    return ratio - quotient_bias(ratio, bottom, bottom_u**2, common), math.sqrt(max(variance, 0.0)) / bottom
