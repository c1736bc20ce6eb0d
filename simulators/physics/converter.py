"""Rounding and saturation of a converter."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from palpate.instrument.arrays import Floats

FINEST = 16  # bits of a sample on the bus


def convert(fraction: Floats, bits: int = FINEST) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Round samples, as fractions of the range, to 2**bits steps over plus and minus it, and flag saturation.

    A NaN is flagged and stays a NaN.
    """
    half = 2.0 ** (bits - 1)
    code = np.multiply(fraction, half)
    np.rint(code, out=code)
    if code.size and code.min() >= -half and code.max() <= half - 1:  # for NaN neither comparison is true
        saturated = np.zeros(code.shape, bool)
    else:
        saturated = ~((code >= -half) & (code <= half - 1))
        np.clip(code, -half, half - 1, out=code)
    code *= 1 / half
    return code, saturated
