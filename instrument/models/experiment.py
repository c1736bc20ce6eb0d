"""The thesis' own measurement as a model: its mean force ratios, interpolated between the six samples.

The interpolant is piecewise cubic and monotone (PCHIP, Fritsch and Carlson 1980), in the logarithm of the modulus. Six
points on rubber of one thickness say nothing outside them, so moduli outside are refused.
"""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np

from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Sample

if TYPE_CHECKING:
    from scipy.interpolate import PchipInterpolator


def force_ratio(design: Design, sensed: Sample) -> float:
    """Tooth force over total force.

    Raises:
        RangeError: nothing was measured with the design, the modulus is outside those of the measured samples, or the
            thickness is another one.
    """
    measured = [SAMPLES[name] for name in design.thesis_force_ratio]
    if not measured:
        raise RangeError(f"nothing was measured with design {design.name!r}; take model 'column'")
    low, high = min(s.modulus for s in measured), max(s.modulus for s in measured)
    if not (low <= sensed.modulus <= high):
        raise RangeError(
            f"modulus {show(sensed.modulus, 'Pa')} of sample {sensed.name!r} is outside the measured"
            f" {show(low, 'Pa', 7)} to {show(high, 'Pa', 7)}; model 'column' has no such limit"
        )
    thickness = measured[0].thickness
    if not math.isclose(sensed.thickness, thickness, rel_tol=1e-6):
        raise RangeError(
            f"thickness {show(sensed.thickness, 'm')} of sample {sensed.name!r} is not the measured"
            f" {show(thickness, 'm')}; model 'column' has no such limit"
        )
    means = {SAMPLES[name].modulus: ratio for name, ratio in design.thesis_force_ratio.items()}
    if sensed.modulus in means:  # a sweep over the samples needs no interpolant, which takes a while to import
        return means[sensed.modulus]
    return float(_interpolant(design)(np.log(sensed.modulus)))


@functools.cache
def _interpolant(design: Design) -> PchipInterpolator:
    from scipy.interpolate import PchipInterpolator

    points = sorted((SAMPLES[name].modulus, ratio) for name, ratio in design.thesis_force_ratio.items())
    moduli, ratios = zip(*points, strict=True)
    return PchipInterpolator(np.log(moduli), np.array(ratios), extrapolate=False)
