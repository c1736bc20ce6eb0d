"""What the measurement of one object's modulus finds, and how it is shown: predicted and reached."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from palpate.instrument.findings.film_forces import CALIBRATION
from palpate.instrument.findings.object_modulus import COVERAGE, estimate
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.quantity import counted, plus_minus, show
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.uncertainty.budget import Between, Budget, Component, between_groups
from palpate.procedures.lab.session import Outcome
from palpate.procedures.measurements import columns
from palpate.procedures.measurements.object_modulus.planning import (
    CURVE,
    EDGE,
    VALIDATION,
    ExpectedRatio,
    Prospect,
    Wanted,
    planned_lines,
    scatter_told,
)
from palpate.procedures.measurements.prospects import share
from palpate.procedures.records.columns import Column
from palpate.procedures.showing.figure import name_all, new_figure, save, with_u
from palpate.procedures.showing.moduli import between
from palpate.procedures.showing.text import stamped, taken

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
            "load_N": self.prospect.allocation.load,
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


# --- what it shows -------------------------------------------------------------------------------------

MOST_NAMED = 7  # mountings in the legend of the plot


def show_modulus(result: ObjectModulusResult, outcome: Outcome) -> list[object]:
    """What was wanted, planned, measured and reached."""
    shares, groups = result.shares, ratios_of(result.points)
    return [
        stamped(outcome["simulated"], "Young modulus of one object"),
        *planned_lines(result.wanted, result.prospect),
        *_measured(result),
        *([] if (found := mounting_scatter(groups)) is None else [f"mountings      {scatter_told(found)}"]),
        f"stopped        {result.stopped}; {counted(sum(map(len, groups)), 'set')} in "
        f"{counted(len(groups), 'mounting')}, {taken(outcome)}",
        *([] if not shares else [_binds(shares)]),
        *(f"note           {note}" for note in result.notes),
    ]


def _binds(shares: Mapping[str, float]) -> str:
    name = max(shares, key=lambda each: shares[each])
    return f"binds          {name}, {share(shares[name])} of the variance"


def _measured(result: ObjectModulusResult) -> list[str]:
    """The modulus with both intervals, and both relative uncertainties."""
    if result.answer is None:
        return ["measured       nothing: no set is valid"]
    row, line = result.answer.row, result.answer.validation
    scale, modulus = between(row["kind"], row["scale_low_Pa"], row["scale_high_Pa"]), ""
    if row["modulus_Pa"] is None:
        scale = f"{scale} (95 %, scale); {row['note']}"
    else:
        modulus = f"{show(row['modulus_Pa'], 'Pa', 3)} {_half(result.answer, absolute=False)}"
        scale = f"{scale} (95 %, scale)"
    lines = [f"measured       {modulus}{scale}", _absolute(result.answer, row, line)]
    if row["modulus_Pa"] is not None and result.wanted.sample:
        of_thesis = get_sample(result.wanted.sample).modulus
        apart = (
            f"{share(abs(of_thesis / row['modulus_Pa'] - 1))} {'above' if of_thesis > row['modulus_Pa'] else 'below'}"
        )
        lines.append(
            f"thesis         {show(of_thesis, 'Pa', 3)}, {apart} what is measured; the interval on the scale leaves out"
            " how far the model is off"
        )
    return lines


def _half(answer: ObjectModulusAnswer, *, absolute: bool) -> str:
    """Half-width of the 95 % interval, with a comma; empty: it is not known."""
    budget = answer.budget(absolute=absolute)
    return "" if budget is None else f"{plus_minus(budget.expanded() / budget.value)}, "


def _absolute(answer: ObjectModulusAnswer, row: Mapping[str, object], line: ValidationLine) -> str:
    if row["absolute_kind"] is None:
        return f"absolute       {line.source}"
    low, high = (end if isinstance(end := row[f"absolute_{name}_Pa"], float) else None for name in ("low", "high"))
    interval = between(str(row["absolute_kind"]), low, high)
    return f"absolute       {_half(answer, absolute=True)}{interval} (95 %); {line.source}"


def plot_modulus(result: ObjectModulusResult, simulated: bool, folder: Path) -> Path:
    """Draw the ratio of each set, and the share of each line in the variance. Returns the PNG file."""
    figure, (left, right) = new_figure(simulated, 2, f"modulus of one object by model {result.prospect.found.model}")
    mountings = dict.fromkeys(point.mounting for point in result.points)
    for number in mountings:
        own = [(place, p) for place, p in enumerate(result.points, 1) if p.mounting == number and p.valid]
        label = f"mounting {number}" if len(mountings) <= MOST_NAMED else None
        ratios = with_u([p for _, p in own], "force_ratio")
        left.errorbar([place for place, _ in own], *ratios, fmt="o", ms=4, lw=1, capsize=2, label=label)
    if result.answer is not None:
        ratio = result.answer.ratio
        left.axhspan(*ratio.interval(), alpha=0.2, label="mean, 95 %")
    left.set(xlabel="number of the set", ylabel="force ratio (bars: standard uncertainty)")
    name_all(left, 4)
    shares = sorted(result.shares.items(), key=lambda each: each[1])
    right.barh([name for name, _ in shares], [100 * value for _, value in shares])
    right.set(xlabel="share of the variance (%)")
    return save(figure, folder)
