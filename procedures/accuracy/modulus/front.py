"""The front of a modulus: its least relative uncertainty against bench time, and what that uncertainty consists of.

Every number comes from the planner of `palpate measure modulus`: its lines, its bench times and its plans.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from palpate.instrument.allocation.allocate import BelowFloor
from palpate.instrument.allocation.lines import BudgetLine, RepeatUnit, budget
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.object_modulus import ByReferences
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.quantity import show
from palpate.instrument.sensor.design import Design
from palpate.procedures.measurements.object_modulus.planning import below_floor, not_known, too_many_sets
from palpate.procedures.measurements.object_modulus.prospect import (
    ExpectedRatio,
    Prospect,
    Wanted,
    best_of,
    costs_of,
    expected,
    lines_of,
    shortest,
)
from palpate.procedures.measurements.prospects import MOST_SETS

TARGETS = (0.2, 0.1, 0.05, 0.02, 0.01)  # relative standard uncertainty
POINTS = 48  # of the front
LEAST_END, GREATEST_END = 600.0, 4 * 3600.0  # s, between which the front ends


@dataclass(frozen=True, slots=True)
class FrontPoint:
    """The most accurate plan in some bench time.

    Attributes:
        after: bench time after the first mounting [s].
        plan: the plan; its uncertainties are `scale_u` and `absolute_u` (None: not known).
        noise_u: relative uncertainty of the modulus by noise alone.
        scale_shares, absolute_shares: share of each line in the variance; of the absolute one None if it is not known.
    """

    after: float
    plan: Prospect
    noise_u: float
    scale_shares: dict[str, float]
    absolute_shares: dict[str, float] | None

    def summary(self) -> dict[str, Any]:
        """The point as JSON has it."""
        told = {name: value for name, value in self.plan.summary().items() if name not in SHARED}
        return {
            **told,
            "seconds_after_mounting": self.after,
            "noise_u": self.noise_u,
            "scale_shares": self.scale_shares,
            "absolute_shares": self.absolute_shares,
        }


SHARED = ("force_ratio", "sensitivity", "shares", "binds")  # told once for the front, or by the point itself


@dataclass(frozen=True, slots=True)
class QuickestPlan:
    """The quickest plan for a tolerance.

    Attributes:
        absolute: whether the tolerance is absolute, not on the model's scale.
        plan: the plan; None: no time on the bench reaches the tolerance.
        after: its bench time after the first mounting, on average [s].
        why: why there is no plan, with other ways there.
    """

    tolerance: float
    absolute: bool
    plan: Prospect | None
    after: float | None = None
    why: str = ""

    def summary(self) -> dict[str, Any]:
        """The target as JSON has it."""
        plan = None if self.plan is None else self.plan.summary()
        return {"tolerance": self.tolerance, "absolute": self.absolute, "plan": plan, "why": self.why}


@dataclass(frozen=True, slots=True)
class PlanningCase:
    """What plans are made for.

    Attributes:
        design: the sensor of the bench, with its calibrated films.
        question: the model that turns the ratio into the modulus.
        loads: loads among which a plan chooses [N, peak to peak].
        wanted: frequency of the load, what is known of mountings, and who mounts; each plan has its own tolerance.
        references: calibration of the model by references; None: there is none.
    """

    design: Design
    question: RatioQuestion
    loads: Sequence[float]
    wanted: Wanted
    references: ByReferences | None = None


@dataclass(frozen=True, slots=True)
class ModulusFront:
    """Front of one object on one bench.

    Attributes:
        modulus: Young modulus of the object [Pa].
        found: what the model expects of it.
        lines: lines of the absolute uncertainty under the greatest load; of the scale one, if the validation error is
            not known.
        mounting: bench time until the first set can begin, and of the end [s].
        person: the part of it that a person takes [s].
        points: the front under the greatest load, from one set on.
        targets: plans for TARGETS, on the scale and absolute.
        mounting_u: relative uncertainty of the modulus by one mounting; None: that scatter was never measured.
        model_u: what no bench time lowers, the model's validation error included; None: not known.
    """

    modulus: float
    found: ExpectedRatio
    lines: tuple[BudgetLine, ...]
    mounting: float
    person: float
    points: tuple[FrontPoint, ...]
    targets: tuple[QuickestPlan, ...]
    mounting_u: float | None
    model_u: float | None

    @classmethod
    def of(cls, setting: PlanningCase, modulus: float) -> Self:
        """Plan every point for an object of a Young modulus [Pa].

        Raises:
            RangeError: the model does not answer for this sensor, or tells no more than a bound of the object.
        """
        design, question, loads = setting.design, setting.question, setting.loads
        found = expected(question, modulus, setting.references)
        if found.sensitivity is None:
            raise RangeError(
                f"of an object of {show(modulus, 'Pa')} model {found.model!r} tells no more than a bound, whatever"
                " the time: its ratio hardly depends on the modulus; take a sensor with a ring more like it, or"
                " palpate test modulus"
            )

        def wanted(tolerance: float | None, time: float | None, relative: bool) -> Wanted:
            return replace(setting.wanted, tolerance=tolerance, time=time, relative=relative)

        def target(tolerance: float, absolute: bool) -> QuickestPlan:
            asked = wanted(tolerance, None, not absolute)
            try:
                if absolute and found.validation.u is None:
                    raise not_known(asked, found, design, loads)
                plan = best_of(design, found, asked, loads)
            except BelowFloor as error:
                why = str(below_floor(asked, question, found, design, loads, error))
            except RangeError as error:
                why = str(error)
            else:
                if plan.allocation.sets <= MOST_SETS:
                    return QuickestPlan(tolerance, absolute, plan, _after(plan, plan.times.mean, asked))
                why = str(too_many_sets(asked, found, design, loads, plan))
            return QuickestPlan(tolerance, absolute, None, why=why)

        targets = [target(tolerance, absolute) for absolute in (False, True) for tolerance in TARGETS]
        frequency = setting.wanted.frequency
        costs = costs_of(max(loads), frequency, setting.wanted.mounts)
        first = costs.seconds(1, 1, shortest(frequency))
        longest = max((each.plan.allocation.seconds for each in targets if each.plan is not None), default=0.0)
        end = min(max(LEAST_END, 1.3 * longest), GREATEST_END)
        ends = first + np.geomspace(costs.set / 2, end - first, POINTS)
        plans = [best_of(design, found, wanted(None, float(time), True), (max(loads),)) for time in (first, *ends)]
        usual = wanted(None, None, True)
        plans = [plan for plan in plans if plan.allocation.sets <= MOST_SETS]
        points = {plan.allocation.seconds: _point(design, found, usual, plan) for plan in plans}
        known = found.validation.u is not None
        lines = lines_of(design, found, plans[-1].load, usual, absolute=known)
        floor = math.hypot(*(line.u for line in lines if line.per is RepeatUnit.NOTHING))
        by_mounting = [line.u for line in lines if line.per is RepeatUnit.MOUNTING]
        return cls(
            modulus=modulus,
            found=found,
            lines=lines,
            mounting=costs.start + costs.mounting,
            person=costs.person,
            points=tuple(points[seconds] for seconds in sorted(points)),
            targets=tuple(targets),
            mounting_u=None if setting.wanted.mounted is None else math.hypot(*by_mounting),
            model_u=floor if known else None,
        )

    def summary(self) -> dict[str, Any]:
        """The front as JSON has it."""
        return {
            "modulus_Pa": self.modulus,
            "model": self.found.model,
            "force_ratio": self.found.ratio,
            "sensitivity": self.found.sensitivity,
            "validation": self.found.validation.summary(),
            "lines": [{"name": line.name, "u": line.u, "per": line.per.value} for line in self.lines],
            "mounting_s": self.mounting,
            "person_s": self.person,
            "mounting_u": self.mounting_u,
            "model_u": self.model_u,
            "front": [point.summary() for point in self.points],
            "targets": [target.summary() for target in self.targets],
        }


def _after(plan: Prospect, seconds: float, wanted: Wanted) -> float:
    """What is left of a plan's bench time after its first mounting [s]."""
    costs = costs_of(plan.load, wanted.frequency, wanted.mounts)
    return seconds - costs.start - costs.mounting


def _point(design: Design, found: ExpectedRatio, wanted: Wanted, plan: Prospect) -> FrontPoint:
    taken = plan.allocation
    shares: list[dict[str, float]] = []
    for absolute in (False, True):
        lines = lines_of(design, found, plan.load, wanted, absolute)
        rows = budget(lines, taken.mountings, taken.sets, taken.dwell).rows()
        shares.append({row["name"]: row["share"] for row in rows})
    noise = math.hypot(*(line.u for line in lines if line.per is RepeatUnit.SECOND))
    known = found.validation.u is not None
    after = _after(plan, taken.seconds, wanted)
    return FrontPoint(after, plan, noise / math.sqrt(taken.sets * taken.dwell), shares[0], shares[1] if known else None)
