"""The course of a measurement: whether the sets so far are enough, and when the object is mounted again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

from palpate.instrument.allocation.lines import MOST_FREEDOM, BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.stopping import (
    Ratios,
    StoppingVerdict,
    answer,
    enough,
    first_sets,
    pooled,
)
from palpate.instrument.allocation.table import FIRST, OutOfReach
from palpate.instrument.findings.film_forces import CALIBRATION, PRIOR_FREEDOM
from palpate.instrument.findings.object_modulus import COVERAGE, estimate
from palpate.instrument.models.curve import RatioCurve
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import plus_minus, show
from palpate.instrument.sensor.design import Design
from palpate.instrument.uncertainty.budget import Between, Budget, Component, between_groups
from palpate.procedures.engine.plan import expected_noise, noise_of
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.object_modulus.planning import (
    BOUND_SETS,
    CURVE,
    EDGE,
    MOUNTED,
    VALIDATION,
    ExpectedRatio,
    Prospect,
    Wanted,
    cost_of_trend,
    costs_of,
    end_seconds,
    lines_of,
    sensitivity_at,
)
from palpate.procedures.records.columns import Column

# --- The points and the result of the measurement of one object's modulus ------------------------------

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
        return Budget(quantity, modulus, "Pa", tuple(parts), self.ratio.correlations, self.ratio.prior)


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
    budget = Budget("force ratio", ratio, "", parts, relative.correlations, relative.prior)
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
    def reached(self) -> float | None:
        """Half-width of the 95 % interval that the tolerance is about, relative; None: only a bound is known."""
        found = None if self.answer is None else self.answer.budget(absolute=not self.wanted.relative)
        return None if found is None else found.expanded() / found.value

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
            "reached_U95": self.reached,
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
        }


# --- the course ----------------------------------------------------------------------------------------

RESERVE = 1.0  # s, for what takes longer than usual
NOISY, MATTERS = 1.5, 0.3  # times the planned noise that is told, and the share of the scatter from which on
IN_A_ROW = 5  # sets that are not valid, after which the measurement ends
TOO_ALIKE = 0.001  # probability that sets repeat so well by chance, if their gains scatter as the design's do


@dataclass(frozen=True, slots=True)
class Course:
    """The course of a measurement by its plan.

    Attributes:
        design: the sensor.
        question: the model that turns a ratio into a modulus, and the thickness of the object.
        curve: the curve of that model, corrected by references.
        wanted: what is asked for.
        prospect: the plan.
    """

    design: Design
    question: RatioQuestion
    curve: RatioCurve
    wanted: Wanted
    prospect: Prospect

    @property
    def costs(self) -> Costs:
        """Bench times, by which further mountings and sets are chosen."""
        return costs_of(self.prospect.load, self.wanted.frequency, self.wanted.mounts)

    def verdict(self, points: Sequence[ModulusPoint]) -> StoppingVerdict:
        """Whether the points are enough, and how many mountings and sets there will be in all."""
        found = self._whatever_it_takes(points)
        return found if found.why or not points else self._within_time(points, found)

    def _whatever_it_takes(self, points: Sequence[ModulusPoint]) -> StoppingVerdict:
        """The verdict if time were no matter."""
        plan, ratios = self.prospect.allocation, ratios_of(points)
        found = StoppingVerdict(plan.mountings, plan.sets, _unusable(points))
        if found.why or not ratios:
            return found
        slope = self._sensitivity(ratios)
        if slope is None:
            why = "the ratio is only good for a bound, however many sets there are"
            return replace(found, why=why) if sum(map(len, ratios)) >= BOUND_SETS else found
        if self.wanted.tolerance is None:
            return found
        return self._for_tolerance(self.wanted.tolerance, slope, ratios)

    def _for_tolerance(self, tolerance: float, slope: float, ratios: Ratios) -> StoppingVerdict:
        plan = self.prospect.allocation
        lines = self._lines(ratios, slope, absolute=not self.wanted.relative)
        try:
            found = enough(lines, self.costs, tolerance, plan, slope, ratios)
        except OutOfReach as error:
            why = "by the scatter that was found no time on the bench is enough"
            if error.floor >= tolerance:
                why = f"{error.binds} leaves {plus_minus(error.floor)}, which no set lowers"
            return StoppingVerdict(plan.mountings, plan.sets, why)
        asked, each = plan.mountings, plan.sets // plan.mountings
        missing = asked - sum(len(sets) >= each for sets in ratios)  # one that was interrupted does not count
        if self.wanted.mountings is None or missing <= 0:
            return found
        asked = len(ratios) + missing - (len(ratios[-1]) < each)
        if not found.why and found.mountings >= asked:
            return found
        each = each if found.why else max(each, math.ceil(found.sets / asked))
        return StoppingVerdict(asked, asked * each, "")

    def _within_time(self, points: Sequence[ModulusPoint], found: StoppingVerdict) -> StoppingVerdict:
        """The verdict; a set that would not fit into the time ends the measurement before it.

        That time is the given one, or else the printed bound, which leaves the first sets of each mounting alone.
        """
        bound = self.prospect.times.longest
        limit = bound if self.wanted.time is None else self.wanted.time
        if self._seconds_after(points, found) <= limit:
            return found
        if self.wanted.time is not None:
            return replace(found, why=f"another set would not end within {limit:g} s")
        if self._first_are_due(ratios_of(points)):
            return found
        needed = self.costs.seconds(found.mountings, found.sets, self.prospect.allocation.dwell)
        told = f"the bound of {limit:.0f} s is spent; as the first sets scatter it takes {needed:.0f} s (--time)"
        return replace(found, why=told)

    def _first_are_due(self, ratios: Ratios) -> bool:
        """Whether planned mountings lack sets of those that decide how many there are in all."""
        plan = self.prospect.allocation
        first = first_sets(plan)
        return sum(min(len(sets), first) for sets in ratios) < first * (self.wanted.mountings or 1)

    def _seconds_after(self, points: Sequence[ModulusPoint], found: StoppingVerdict) -> float:
        """Bench time at the end of a measurement that takes another set [s]."""
        costs, taken = self.costs, math.fsum(point.seconds for point in points)
        following = costs.set + self.prospect.allocation.dwell
        following += costs.mounting if _remounts(points, found) else 0.0
        return taken + following + end_seconds(self.prospect.load) + RESERVE

    def remounts(self, points: Sequence[ModulusPoint]) -> bool:
        """Whether the object is mounted again before the next set."""
        return _remounts(points, self.verdict(points))

    def answer(self, points: Sequence[ModulusPoint]) -> ObjectModulusAnswer | None:
        """The modulus by the valid points; None: there is none. Raises EstimateError."""
        ratios = ratios_of(points)
        if not ratios:
            return None
        lines = [line for line in self._lines(ratios, 1.0, absolute=False) if line.name != CURVE]
        by_time = self.wanted.tolerance is None or not self._for_tolerance_ended(ratios)
        found = answer(lines, self.prospect.allocation, 1.0, ratios, by_time=by_time)
        return answered(found.ratio, found.budget, self.question, self.prospect.found)

    def notes(self, points: Sequence[ModulusPoint]) -> tuple[str, ...]:
        """What else to know of the answer, for people."""
        ratios, found = ratios_of(points), []
        slope = self._sensitivity(ratios) if ratios else None
        if ratios and slope is None:
            low, high = (show(end, "Pa", 2) for end in self.curve.moduli)
            found.append(
                f"the ratio is at an end of what model {self.prospect.found.model!r} tells ({low} to {high}): a sensor "
                "with a ring more like the object, or palpate test modulus, would do better"
            )
        if ratios and (late := self._late(points, ratios)):
            found.append(late)
        if ratios and (noisy := self._noisy(points)):
            found.append(noisy)
        if ratios and self.too_alike(ratios):
            found.append(
                "the sets repeat far better than gains are known to scatter from set to set, so that this scatter "
                "counts for mountings"
            )
        return tuple(found)

    def _late(self, points: Sequence[ModulusPoint], ratios: Ratios) -> str:
        """Why the measurement needed more than the bound, which is enough for most runs; empty: it did not."""
        bound, plan = self.prospect.times.longest, self.prospect.allocation
        found, taken = self._whatever_it_takes(points), math.fsum(point.seconds for point in points)
        within = taken + end_seconds(self.prospect.load) if found.why else self._seconds_after(points, found)
        if self.wanted.tolerance is None or within <= bound:
            return ""
        expected = math.hypot(self.design.ratio_scatter, self._set_noise)
        told = f"the {bound:.0f} s that are enough for 95 % of runs were not: sets"
        if any(len(sets) > 1 for sets in ratios):
            told += f" scatter by {100 * pooled(0.0, 0.0, *ratios).u:.2g} %, and"
        told += f" were expected to by {100 * expected:.2g} %"
        if len(ratios) > plan.mountings:
            told += f"; {len(ratios)} mountings were made, not {plan.mountings}"
        return told

    @property
    def _cycles(self) -> int:
        return round(self.prospect.allocation.dwell * self.wanted.frequency)

    @property
    def _set_noise(self) -> float:
        """Relative standard deviation of the ratio of a set by noise that is expected."""
        noise = expected_noise(self.design, self.prospect.load, self.prospect.found.ratio)
        return noise * cost_of_trend(self._cycles) / math.sqrt(self.prospect.allocation.dwell)

    def noise_density(self, points: Sequence[ModulusPoint]) -> float | None:
        """Amplitude density of the films' noise by the points [V/√Hz]; None: no point is valid."""
        parts = [point.noise_u / point.force_ratio for point in points if point.valid and point.force_ratio > 0]
        if not parts:
            return None
        measured = math.hypot(*parts) / math.sqrt(len(parts))
        return noise_of(self.design) * measured / self._set_noise

    def _noisy(self, points: Sequence[ModulusPoint]) -> str:
        """That films were noisier than the plan says, where it matters; empty: they were not."""
        density, planned = self.noise_density(points), noise_of(self.design)
        if density is None or density < NOISY * planned:
            return ""
        if self._set_noise * density / planned < MATTERS * self.design.ratio_scatter:
            return ""
        told = show(density, "V/√Hz", 2)
        return (
            f"noise of the films was {told}, not {show(planned, 'V/√Hz', 2)}: with noise = {told!r} in the bench file"
            " the next plan has longer dwells"
        )

    def _for_tolerance_ended(self, ratios: Ratios) -> bool:
        """Whether the number of sets follows from the scatter of the first ones."""
        return sum(map(len, ratios)) >= first_sets(self.prospect.allocation)

    def too_alike(self, ratios: Ratios) -> bool:
        """Whether the sets repeat far better than gains are known to scatter from set to set.

        Then that scatter may come with the mounting instead, and sets do not lower it. What is known of the scatter is
        an estimate, too: many sets that scatter by half as much are still no sign of that.
        """
        freedom = sum(len(each) - 1 for each in ratios)
        if freedom < FIRST - 1:
            return False
        from scipy.special import fdtr

        share = (pooled(0.0, 0.0, *ratios).u / self.design.ratio_scatter) ** 2
        return float(fdtr(freedom, min(PRIOR_FREEDOM, MOST_FREEDOM), share)) < TOO_ALIKE

    def _sensitivity(self, ratios: Ratios) -> float | None:
        return sensitivity_at(self.curve, _mean(ratios))

    def _lines(self, ratios: Ratios, slope: float, *, absolute: bool) -> list[BudgetLine]:
        """The lines of the plan at the measured ratio; a scatter that sets do not show counts for mountings."""
        found = replace(self.prospect.found, ratio=_mean(ratios), sensitivity=slope)
        lines = lines_of(self.design, found, self.prospect.load, self.wanted, absolute, self._cycles)
        if self.too_alike(ratios):
            scatter = math.hypot(self.design.ratio_scatter, self.wanted.mounted)
            mounted = BudgetLine(MOUNTED, slope * scatter, RepeatUnit.MOUNTING, PRIOR_FREEDOM)
            return [*(line for line in lines if line.name != MOUNTED), mounted]
        return list(lines)


def _remounts(points: Sequence[ModulusPoint], verdict: StoppingVerdict) -> bool:
    ratios = ratios_of(points)
    each = max(1, verdict.sets // verdict.mountings)
    return bool(ratios) and len(ratios) < verdict.mountings and len(ratios[-1]) >= each


def _mean(ratios: Ratios) -> float:
    """Geometric mean of the geometric means of the mountings."""
    means = [math.fsum(map(math.log, each)) / len(each) for each in ratios]
    return math.exp(math.fsum(means) / len(means))


def _unusable(points: Sequence[ModulusPoint]) -> str:
    last = points[-IN_A_ROW:]
    if len(last) == IN_A_ROW and not any(point.valid for point in last):
        return f"the last {IN_A_ROW} sets are not valid: {', '.join(last[-1].flags)}"
    return ""
