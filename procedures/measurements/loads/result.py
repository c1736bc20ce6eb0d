"""The points and the result of a load sweep: mean force ratios, and the samples from hard to soft."""

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
    """One load on one sample. Forces and voltages are peak to peak; names with `_u` are standard uncertainties.

    Attributes:
        sample: name of the sample.
        load_N: the load that was asked for.
        indicator_mV: reading of the load indicator.
        load_measured_N, load_measured_u: the measured load.
        voltage_rigid_V, voltage_total_V: sums of the voltages of the rigid films and of the base films.
        force_rigid_N, force_total_N: sums of the forces on the teeth and on the bases.
        force_ratio, force_ratio_u: force ratio of the sensor, as `film_forces` finds it.
        noise_u: part of `force_ratio_u` that comes from noise.
        condition: condition number of the fit.
        valid: whether the point is used.
        dwell_s: the dwell.
        relative_u: `force_ratio_u` over `force_ratio`.
        relative_u_predicted: the value of `relative_u` for which the dwell was chosen; None: the dwell was given.
        settling_s: how long the films took to settle.
        attempts: number of attempts.
        flags: why the point is not used, or what to know about it.
        incidents: number of failures of the bench that were made good since the point before; events describe them.
        teeth: forces and ratio of each tooth, if there are several.
        extrapolated: whether the load lies outside the calibrated range.
        calibration_u, pickup_u: parts of `force_ratio_u` that come from the films' calibration and the cables' pick-up.
        force_rigid_u, force_total_u: standard uncertainties of these forces; None in records of older versions.
        degrees_of_freedom: degrees of freedom of `noise_u`; None in records of older versions.
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
    """The mean force ratio of one sample over its valid points.

    Attributes:
        sample: name of the sample.
        force_ratio, force_ratio_u: the mean and its standard uncertainty; None: no point is valid.
        valid_points: number of valid points.
        thesis_force_ratio: the thesis' mean; None: it has none.
        teeth: mean ratio of each tooth to its base, if there are several teeth.
    """

    sample: str
    force_ratio: float | None
    force_ratio_u: float | None
    valid_points: int
    thesis_force_ratio: float | None
    teeth: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class SweepResult:
    """The result of a load sweep.

    Attributes:
        points: the points.
        samples: mean force ratio of each sample.
        softness_order: names of the samples with a valid point, from hard to soft.
        budgets: uncertainty budget of each mean.
    """

    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            "budgets": [budget.summary() for budget in self.budgets],
        }


def evaluate(points: Sequence[LoadPoint], design: Design) -> SweepResult:
    """The mean force ratio of each sample over its valid points, and the samples from hard to soft."""
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
