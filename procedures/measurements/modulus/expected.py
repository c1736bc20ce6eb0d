"""What a compression test is expected to give: Young moduli, thickness, and compliance of the bench.

Each line of load over position has loads that are off by the display's steps and noise (`display_u`); the load cell's
curve, the area [A] and the positions' steps add theirs. The sample has its known modulus
and thickness. The pad's lines are straight [A], and the bare support yields by COMPLIANCE [M].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.instrument.calibration.load_cell import LoadCellCalibration
from palpate.instrument.findings.compression import POSITION_STEP
from palpate.instrument.findings.load_line import LEAST_POINTS, SURE
from palpate.instrument.sensor.sample import Sample
from palpate.procedures.engine.promise import Expected
from palpate.procedures.measurements.prospects import display_u

COMPLIANCE = 1e-3  # m/N, of the bench, which yields with the sample [M]


@dataclass(frozen=True, slots=True)
class _EvenLoads:
    """Loads that grow evenly from `first` to `last` [N] over positions, each off by `u` [N].

    Those of `least` [N] or less do not count, because they may be no contact.
    """

    first: float
    last: float
    steps: int
    u: float
    least: float

    @property
    def loads(self) -> np.ndarray:
        loads = np.linspace(self.first, self.last, self.steps)
        return loads[loads > self.least]

    @property
    def slope_u(self) -> float:
        """Relative standard uncertainty of the slope."""
        return self.u / float(np.linalg.norm(self.loads - self.loads.mean()))

    @property
    def mean_u(self) -> float:
        """Standard uncertainty of the mean load [N]."""
        return self.u / math.sqrt(len(self.loads))


def expected_moduli(
    sample: Sample,
    strain: float,
    steps: int,
    bare: tuple[float, float],
    displays: int,
    area_u: float,
    cell: LoadCellCalibration,
) -> list[Expected]:
    """Relative uncertainties of the tangent and the unloading modulus, of the thickness, and of the bench's compliance.

    Empty where too few loads are surely contact, so that the run gives no result.

    Args:
        sample: the sample.
        strain: the largest strain.
        steps: number of steps of each series.
        bare: least and greatest force on the bare support [N].
        displays: readings at each position.
        area_u: relative standard uncertainty of the sample's area.
        cell: calibration of the load cell.
    """
    load_u = display_u(cell, displays) / cell.sensitivity_mV_per_N
    force = sample.modulus * sample.area * strain
    sure = SURE * cell.resolution()
    support, pad = _EvenLoads(*bare, steps, load_u, sure), _EvenLoads(force / steps, force, steps, load_u, sure)
    if min(len(support.loads), len(pad.loads)) < LEAST_POINTS:
        return []
    yields = sample.thickness / (sample.modulus * sample.area)  # m/N, of the sample alone
    whole, thick = yields + COMPLIANCE, sample.thickness
    # Each error's relative effect on the thickness, which is the distance of two contacts, and on the tangent modulus,
    # which is thickness over yield and area. An error of a slope moves both, against each other.
    of_means = math.hypot(whole * pad.mean_u, COMPLIANCE * support.mean_u) / thick
    of_steps = POSITION_STEP / math.sqrt(6) / thick
    of_pad = whole * float(pad.loads.mean()) / thick, whole / yields
    of_support = COMPLIANCE * float(support.loads.mean()) / thick, COMPLIANCE / yields
    zero = cell.zero_u / cell.sensitivity_mV_per_N * yields / thick
    sensitivity = cell.sensitivity_u / cell.sensitivity_mV_per_N
    related = cell.covariance / cell.sensitivity_mV_per_N**2 * yields / thick
    curve = math.sqrt(max(zero**2 + sensitivity**2 + 2 * related, 0.0))

    def with_slopes(pad_slope: float, support_slope: float, *rest: float) -> float:
        return math.hypot(of_means, of_steps, pad_slope * pad.slope_u, support_slope * support.slope_u, *rest)

    thickness = with_slopes(of_pad[0], of_support[0], zero)
    both = of_support[1] - of_support[0]
    tangent = with_slopes(of_pad[1] - of_pad[0], both, curve, area_u)
    unloading = with_slopes(math.hypot(*of_pad), both, curve, area_u)
    return [
        Expected("tangent modulus", tangent),
        Expected("unloading modulus", unloading),
        Expected("thickness", thickness),
        Expected("compliance of the bench", math.hypot(support.slope_u, sensitivity)),
    ]
