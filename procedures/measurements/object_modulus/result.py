"""The points and the result of the measurement of one object's modulus."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

from palpate.instrument.findings.mean_ratio import CALIBRATION
from palpate.instrument.findings.object_modulus import COVERAGE, estimate
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.instrument.uncertainty.groups import Between, between_groups
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.object_modulus.lines import CURVE, EDGE, VALIDATION, ExpectedRatio, Wanted
from palpate.procedures.measurements.object_modulus.prospect import Prospect
from palpate.procedures.records.columns import Column

LEAST_MOUNTINGS = 3  # whose scatter is told


@dataclass(frozen=True, slots=True)
class ModulusPoint:
    """One load set. The load is peak to peak."""

    mounting: Annotated[int, Column("number of the mounting, from 1")]
    load_N: columns.AskedLoad
    load_measured_N: columns.MeasuredLoad
    load_measured_u: float
    force_ratio: columns.ForceRatio
    force_ratio_u: columns.ForceRatioU
    noise_u: columns.NoiseU
    calibration_u: columns.CalibrationU
    pickup_u: columns.PickupU
    degrees_of_freedom: Annotated[float, columns.FREEDOM]
    dwell_s: columns.Dwell
    seconds: Annotated[float, Column("bench time since the set before, with all that came before this one", "s")]
    valid: columns.Valid
    flags: columns.Flags
    attempts: columns.Attempts
    incidents: columns.Incidents
    free_m: Annotated[float, Column("lowest position of the probe in this mounting that did not touch yet", "m")]


def ratios_of(points: Sequence[ModulusPoint]) -> list[list[float]]:
    """Ratios of the valid points of each mounting that has some, in order."""
    groups: dict[int, list[float]] = {}
    for point in points:
        if point.valid and point.force_ratio > 0:
            groups.setdefault(point.mounting, []).append(point.force_ratio)
    return list(groups.values())


def mounting_scatter(ratios: Sequence[Sequence[float]]) -> Between | None:
    """How much mountings scatter beyond their sets. None: there are fewer than three with two sets or more."""
    groups = [group for group in ratios if len(group) > 1]
    return None if len(groups) < LEAST_MOUNTINGS else between_groups(groups)


@dataclass(frozen=True, slots=True)
class ObjectModulusAnswer:
    """The modulus of the object.

    Attributes:
        ratio: budget of the mean force ratio.
        row: what the model says of the ratio, under the names of `estimate`.
        validation: the model's validation error.
        films_cancel: whether the error of the films' calibration cancels in the absolute modulus.
    """

    ratio: Budget
    row: Mapping[str, Any]
    validation: ValidationLine
    films_cancel: bool

    def budget(self, *, absolute: bool) -> Budget | None:
        """The budget of the modulus, on the model's scale or absolute; None: there is none."""
        modulus, slope = self.row["modulus_Pa"], self.row["sensitivity"]
        if modulus is None or slope is None or (absolute and self.validation.u is None):
            return None
        change = slope * modulus  # over a relative change of the ratio
        parts = [replace(part, sensitivity=change) for part in self.ratio.components]
        curve = self.row["curve_error"] / math.sqrt(3) / self.ratio.value  # a bound: a rectangle
        parts.append(Component(CURVE, curve, change))
        if absolute:
            parts = [part for part in parts if not (self.films_cancel and part.name == CALIBRATION)]
            error, freedom = self.validation.u or 0.0, self.validation.degrees_of_freedom
            parts.append(Component(VALIDATION, error, change, freedom))
        quantity = f"modulus, {'absolute' if absolute else 'scale'}"
        return Budget(quantity, modulus, "Pa", tuple(parts), self.ratio.correlations)


def answered(mean: float, relative: Budget, question: RatioQuestion, found: ExpectedRatio) -> ObjectModulusAnswer:
    """The modulus of a mean ratio, by the question's model. Raises as `estimate` does.

    Args:
        mean: the mean force ratio; one of 1 or more counts as nearly 1.
        relative: its relative uncertainty.
        question: the model that turns a ratio into a modulus, and the thickness of the object.
        found: what was expected, with the model's calibration by references.
    """
    ratio, references = min(mean, 1 - EDGE), found.references
    parts = tuple(replace(part, sensitivity=ratio) for part in relative.components)
    budget = Budget("force ratio", ratio, "", parts, relative.correlations)
    if references is not None and references.same_films:
        shared = math.fsum(part.u * ratio for part in parts if part.name == CALIBRATION)
        references = replace(references, shared_u=shared)
    (row,) = estimate(question, [ratio], budget.u, budget.degrees_of_freedom, references)
    return ObjectModulusAnswer(budget, row, found.validation, found.films_cancel)


@dataclass(frozen=True, slots=True)
class ObjectModulusResult:
    """The result of the measurement.

    Attributes:
        points: the points.
        wanted: what was asked for.
        prospect: what was planned.
        answer: the modulus; None: no point is valid.
        stopped: why the measurement ended.
        notes: what else to know, for people.
        noise_density: amplitude density of the films' noise [V/√Hz]; None: no point is valid.
    """

    points: list[ModulusPoint]
    wanted: Wanted
    prospect: Prospect
    answer: ObjectModulusAnswer | None
    stopped: str
    notes: tuple[str, ...]
    noise_density: float | None

    @property
    def achieved_u(self) -> float | None:
        """Relative standard uncertainty that the tolerance is about; None: only a bound is known."""
        if self.answer is None:
            return None
        found: float | None = self.answer.row["scale_u" if self.wanted.relative else "absolute_u"]
        return found

    @property
    def budgets(self) -> list[Budget]:
        """Uncertainty budgets of the mean ratio and of the modulus, on the model's scale and absolute."""
        if self.answer is None:
            return []
        both = (self.answer.budget(absolute=absolute) for absolute in (False, True))
        return [self.answer.ratio, *(budget for budget in both if budget is not None)]

    @property
    def shares(self) -> dict[str, float]:
        """Share of each line in the variance, absolute where that is asked for and known."""
        if self.answer is None:
            return {}
        absolute = not self.wanted.relative and self.answer.validation.u is not None
        budget = self.answer.budget(absolute=absolute)
        return {} if budget is None else {row["name"]: row["share"] for row in budget.rows()}

    def summary(self) -> dict[str, Any]:
        """The result without its points, under public names."""
        plan, answer, groups = self.prospect.allocation, self.answer, ratios_of(self.points)
        scattered = mounting_scatter(groups)
        shares = self.shares
        return {
            "tolerance": self.wanted.tolerance,
            "time_s": self.wanted.time,
            "relative_to_model": self.wanted.relative,
            "planned": self.prospect.summary(),
            "stopped": self.stopped,
            "notes": list(self.notes),
            "mountings": len(groups),
            "sets": sum(map(len, groups)),
            "dwell_s": plan.dwell,
            "load_N": self.prospect.load,
            "noise_density": self.noise_density,
            "mounting_scatter": None if scattered is None else scattered.u,
            "mounting_scatter_freedom": None if scattered is None else scattered.degrees_of_freedom,
            "mounting_scatter_bound": None if scattered is None else scattered.bound_u,
            "mounting_scatter_told": None if scattered is None else scattered.significant,
            "coverage": COVERAGE,
            **({} if answer is None else {name: value for name, value in answer.row.items() if name != "model"}),
            "answered_by": self.prospect.found.model,
            "shares": shares,
            "binds": max(shares, key=lambda name: shares[name], default=None),
            "validation_line": self.prospect.found.validation.summary(),
            "budgets": [budget.summary() for budget in self.budgets],
        }
