"""What a load sweep measures and finds: points, mean ratios, and the samples from hard to soft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from palpate.instrument.findings.film_forces import ToothPoint
from palpate.instrument.findings.mean_ratio import mean_ratio
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One load set. Forces and voltages are peak to peak; `_u` are standard uncertainties.

    Of a sensor of several teeth voltages and forces are sums, the ratio is the sensor's (`film_forces`), and `teeth`
    has each tooth's own. `noise_u`, `calibration_u` and `pickup_u` are what noise, the films' calibration and their
    cables have in `force_ratio_u`; `degrees_of_freedom` are those of `noise_u`. `relative_u` is that to `force_ratio`,
    beside what was predicted of it where the dwell was chosen at the point. `extrapolated`: the load lies outside the
    calibrated range. Not `valid`: after the last of its `attempts` it is flagged still; `flags` say why. `incidents`
    counts what went wrong since the point before and was made good; the events say what. The forces' own
    uncertainties are None in records of before they were known.
    """

    sample: str
    load_N: float
    indicator_mV: float
    load_measured_N: float
    load_measured_u: float
    voltage_rigid_V: float
    voltage_total_V: float
    force_rigid_N: float
    force_total_N: float
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    condition: float
    valid: bool
    dwell_s: float | None = None
    relative_u: float | None = None
    relative_u_predicted: float | None = None
    settling_s: float | None = None
    attempts: int = 1
    flags: tuple[str, ...] = ()
    incidents: int = 0
    teeth: tuple[ToothPoint, ...] = ()
    extrapolated: bool = False
    calibration_u: float = 0.0
    force_rigid_u: float | None = None
    force_total_u: float | None = None
    pickup_u: float = 0.0
    degrees_of_freedom: float | None = None


@dataclass(frozen=True, slots=True)
class SampleMean:
    """Mean over the valid load sets of a sample, beside the thesis' own mean (None where it has none).

    `teeth`: of each tooth to its base, where there are several.
    """

    sample: str
    force_ratio: float | None
    force_ratio_u: float | None
    valid_points: int
    thesis_force_ratio: float | None
    teeth: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class SweepResult:
    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]

    def summary(self) -> dict[str, Any]:
        """The result without its points, for the record."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            "budgets": [budget.summary() for budget in self.budgets],
        }


def evaluate(points: Sequence[LoadPoint], design: Design) -> SweepResult:
    """Mean ratio of each sample over its valid load sets, and the samples from hard to soft."""
    means, budgets = [], []
    for name in dict.fromkeys(point.sample for point in points):
        valid = [point for point in points if point.sample == name and point.valid]
        n = len(valid)
        budget = mean_ratio(f"force ratio of sample {name}", valid, design.film_freedom) if valid else None
        budgets += [budget] if budget else []
        means.append(
            SampleMean(
                sample=name,
                force_ratio=budget.value if budget else None,
                force_ratio_u=budget.u if budget else None,
                valid_points=n,
                thesis_force_ratio=design.thesis_force_ratio.get(name),
                teeth=tuple(
                    math.fsum(t.force_ratio for t in same) / n for same in zip(*(p.teeth for p in valid), strict=True)
                ),
            )
        )
    known = [(mean.force_ratio, mean.sample) for mean in means if mean.force_ratio is not None]
    return SweepResult(list(points), means, [sample for _, sample in sorted(known, reverse=True)], tuple(budgets))
