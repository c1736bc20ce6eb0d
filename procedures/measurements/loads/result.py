"""The points and the result of a load sweep: mean force ratios, and the samples from hard to soft."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any, Protocol

from palpate.instrument.allocation.stopping import RunRatio
from palpate.instrument.findings.film_forces import ToothPoint, mean_ratio
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.measurements import columns
from palpate.procedures.records.columns import LAST, Column
from palpate.procedures.showing.text import OUTSIDE


def marked_load(point: LoadPoint) -> str:
    """The load that was asked for, with a mark where it lies outside the calibrated range."""
    return f"{point.load_N:g}{OUTSIDE * point.extrapolated}"


@dataclass(frozen=True, slots=True)
class LoadPoint:
    """One load on one sample. Forces and voltages are peak to peak."""

    sample: columns.SampleOf
    load_N: Annotated[float, replace(columns.ASKED, cell=marked_load)]
    indicator_mV: columns.Indicator
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    voltage_rigid_V: Annotated[float, Column("sum of the rigid films' voltages", "V", "rigid\nmV", "z.3f", 1e3)]
    voltage_total_V: Annotated[float, Column("sum of the base films' voltages", "V", "total\nmV", "z.2f", 1e3)]
    force_rigid_N: Annotated[float, Column("sum of forces on the teeth", "N", "rigid\nN", "z.3f", u="force_rigid_u")]
    force_total_N: Annotated[float, Column("sum of forces on the bases", "N", "total\nN", "z.3f", u="force_total_u")]
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    noise_u: columns.NoiseU
    condition: Annotated[float, Column("condition number of the fit")]
    valid: columns.Valid
    dwell_s: Annotated[float | None, Column("the dwell", "s", "dwell\ns", "z.4g")] = None
    relative_u: Annotated[
        float | None,
        Column("`force_ratio_u` over `force_ratio`", "", "u\n%", "z.2f", 100, after="relative_u_predicted"),
    ] = None
    relative_u_predicted: Annotated[
        float | None,
        Column(
            "the `relative_u` for which the dwell was chosen; null: the dwell was given", "", "u to be\n%", "z.2f", 100
        ),
    ] = None
    settling_s: Annotated[float | None, columns.SETTLING] = None
    attempts: columns.Attempts = 1
    flags: columns.Flags = ()
    incidents: columns.Incidents = 0
    teeth: Annotated[tuple[ToothPoint, ...], Column("forces and ratio of each tooth, if there are several")] = ()
    extrapolated: columns.Extrapolated = False
    calibration_u: columns.CalibrationU = 0.0
    force_rigid_u: float | None = None
    force_total_u: float | None = None
    pickup_u: columns.PickupU = 0.0
    degrees_of_freedom: Annotated[float | None, columns.FREEDOM] = None


@dataclass(frozen=True, slots=True)
class SampleMean:
    """The mean force ratio of one sample over its valid points."""

    sample: columns.SampleOf
    force_ratio: Annotated[
        float | None, Column("the mean; null: no point is valid", head="ours", cell="z.4f", u="force_ratio_u")
    ]
    force_ratio_u: Annotated[float | None, Column(head="u", cell="z.4f")]
    valid_points: Annotated[int, Column("number of valid points", head="valid points", after=LAST)]
    thesis_force_ratio: Annotated[
        float | None, Column("the thesis' mean; null: it has none", head="thesis", cell="z.4g")
    ]
    teeth: Annotated[tuple[float, ...], Column("mean ratio of each tooth to its base, if there are several")] = ()

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
        halves: half-width of the 95 % interval of each valid point, relative.
        tolerance: half-width that was asked for; None: none was.
        tolerance_for: "point", or "mean" of each sample; None: there is no tolerance.
    """

    points: list[LoadPoint]
    samples: list[SampleMean]
    softness_order: list[str]
    budgets: tuple[Budget, ...]
    halves: tuple[float, ...] = ()
    tolerance: float | None = None
    tolerance_for: str | None = None

    @property
    def achieved_u(self) -> float | None:
        """Greatest relative standard uncertainty of what the tolerance is of, else of the means; None: one lacks."""
        of = {"point": [p.relative_u for p in self.points], "mean": [s.relative_u for s in self.samples]}
        found = of[self.tolerance_for or "mean"]
        known = [u for u in found if u is not None]
        return max(known) if known and len(known) == len(found) else None

    @property
    def reached(self) -> float | None:
        """Greatest half-width of a 95 % interval, relative, of what the tolerance is of; None: one is not known."""
        means = [budget.expanded() / budget.value for budget in self.budgets]
        found, of = (self.halves, self.points) if self.tolerance_for == "point" else (means, self.samples)
        return max(found) if found and len(found) == len(of) else None

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        return {
            "samples": [asdict(s) for s in self.samples],
            "softness_order": self.softness_order,
            **({} if self.tolerance is None else {"tolerance_for": self.tolerance_for}),
        }


class Repeated(Protocol):
    """Load sets of samples that are repeated for a tolerance of their mean ratios."""

    def answer(self, sample: str, ratios: Sequence[float]) -> RunRatio: ...


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
    halves = tuple(_half(point, design) for point in points if point.valid and point.force_ratio > 0)
    wanted = None if tolerance is None else "point" if repeated is None else "mean"
    return SweepResult(list(points), means, order, tuple(budgets), halves, tolerance, wanted)


def _half(point: LoadPoint, design: Design) -> float:
    """Half-width of the 95 % interval of a point's ratio, relative."""
    return mean_ratio("", [point], design.film_freedom).expanded() / point.force_ratio


def _by_scatter(quantity: str, found: RunRatio) -> Budget:
    """The budget of a mean ratio by what its sets scatter."""
    parts = tuple(replace(part, sensitivity=found.ratio) for part in found.budget.components)
    return Budget(quantity, found.ratio, "", parts, found.budget.correlations)
