"""The single sensor with discs of radius 5 mm for its square plates: a reference case that a plane mesh can solve."""

from __future__ import annotations

from dataclasses import replace

from palpate.instrument.sensor.designs.single import SINGLE

SINGLE_ROUND = replace(
    SINGLE,
    name="single_round",
    outline="round",
    thesis_force_ratio={},  # None: the thesis measured the square sensor only
    thesis_softness_order=(),
    source="[A] the single sensor's dimensions and materials, its squares of 10 mm replaced by discs of radius 5 mm",
)
