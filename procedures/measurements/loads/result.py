"""The points and the result of a load sweep: mean force ratios, and the samples from hard to soft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

from palpate.instrument.allocation.stopping import Answer
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
        force_rigid_u, force_total_u: standard uncertainties of these forces.
        degrees_of_freedom: degrees of freedom of `noise_u`; None: infinitely many.
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

    @property
    def relative_u(self) -> float | None:
        """`force_ratio_u` over `force_ratio`; None: there is no mean."""
        return self.force_ratio_u / self.force_ratio if self.force_ratio and self.force_ratio_u is not None else None


@dataclass(frozen=True, slots=True)
class SweepResult:
    """The result of a load sweep.

    Attributes:
        points: the points.
        samples: mean force ratio of each sample.
        softness_order: names of the samples with a valid point, from hard to soft.
        budgets: uncertainty budget of each mean.
        tolerance: relative standard uncertainty that was asked for; None: none was.
        tolerance_of: "point", or "mean" of each sample; None: there is no tolerance.
    """

    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]
    tolerance: float | None = None
    tolerance_of: str | None = None

    @property
    def achieved_u(self) -> float | None:
        """Greatest relative standard uncertainty of what the tolerance is of, else of the means; None: one lacks."""
        of = {"point": [p.relative_u for p in self.points], "mean": [s.relative_u for s in self.samples]}
        found = of[self.tolerance_of or "mean"]
        known = [u for u in found if u is not None]
        return max(known) if known and len(known) == len(found) else None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            **({} if self.tolerance is None else {"tolerance_of": self.tolerance_of}),
            "budgets": [budget.summary() for budget in self.budgets],
        }


class Repeated(Protocol):
    """Load sets of samples that are repeated for a tolerance of their mean ratios."""

    def answer(self, sample: str, ratios: Sequence[float]) -> Answer: ...


def ratio_of(sample: str) -> str:
    """Name of the result for the mean force ratio of a sample."""
    return f"force ratio of sample {sample}"


def valid_ratios(points: Sequence[LoadPoint]) -> list[float]:
    """Ratios of the valid points."""
    return [point.force_ratio for point in points if point.valid and point.force_ratio > 0]


def evaluate(
    points: Sequence[LoadPoint], design: Design, repeated: Repeated | None = None, tolerance: float | None = None
) -> SweepResult:
    """The mean force ratio of each sample over its valid points, and the samples from hard to soft.

    Args:
        points: the points.
        design: the sensor.
        repeated: the load sets that were repeated, whose own scatter then tells the uncertainty of the mean; None: the
            scatter of the design tells it.
        tolerance: the tolerance that was asked for, of a point, or of the mean where sets were repeated.
    """
    means, budgets = [], []
    for name in dict.fromkeys(point.sample for point in points):
        valid = [point for point in points if point.sample == name and point.valid]
        n = len(valid)
        what = ratio_of(name)
        budget = mean_ratio(what, valid, design.film_freedom) if valid else None
        if repeated is not None and (ratios := valid_ratios(valid)):
            budget = _by_scatter(what, repeated.answer(name, ratios))
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
    order = [sample for _, sample in sorted(known, reverse=True)]
    of = None if tolerance is None else "point" if repeated is None else "mean"
    return SweepResult(list(points), means, order, tuple(budgets), tolerance, of)


def _by_scatter(quantity: str, found: Answer) -> Budget:
    """The budget of a mean ratio by what its sets scatter."""
    parts = tuple(replace(part, sensitivity=found.ratio) for part in found.budget.components)
    return Budget(quantity, found.ratio, "", parts, found.budget.correlations)
