"""The order of objects to a stated risk of error: how many load sets each gets, and what they told in the end."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.allocation.order import (
    Family,
    Pair,
    expected_sets,
    is_told,
    least_risk,
    needed,
    order,
    what_it_takes,
)
from palpate.instrument.errors import RangeError
from palpate.instrument.findings.film_forces import NOISE, PRIOR_FREEDOM, SCATTER
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.sample import SAMPLES, Sample
from palpate.procedures.engine.plan import Predicted, expected_noise, point_seconds
from palpate.procedures.lab.lab import BY_HAND, Mounts
from palpate.procedures.measurements.prospects import expected_ratio
from palpate.procedures.measurements.softness.result import NotTold, Ranked, SoftnessPoint
from palpate.procedures.showing.plan import duration

SMALLEST_RISK, LARGEST_RISK = 1e-6, 0.5
MOST, MOST_SETS = 5, 100  # sets of an object: usually, and at most
LEAST_RATIO = 0.1  # by which the noise of an unknown object is judged


@dataclass(frozen=True)
class Ranking:
    """The course of a softness test that ends when the order is known.

    Attributes:
        design: the sensor.
        objects: the objects, in the order in which they are mounted.
        loads: loads, peak to peak, which the sets of an object take in turn [N].
        frequency: frequency of the load [Hz].
        dwell: dwell of a set [s].
        risk: greatest risk of a wrong pair in the order.
        most: greatest number of sets of an object.
        mounts: who mounts the objects, and how long that takes.
    """

    design: Design
    objects: tuple[Sample, ...]
    loads: tuple[float, ...]
    frequency: float
    dwell: float
    risk: float
    most: int
    mounts: Mounts = BY_HAND

    def check(self) -> None:
        """Refuse what cannot be, before anything moves.

        Raises:
            RangeError: the risk, the number of sets or that of the objects is outside its limits, or two objects are
                expected to be so much alike that so many sets do not tell them apart in every second run.
        """
        if len(self.objects) < 2:
            raise RangeError("--risk: one object has no order; name two or more, or leave --risk out")
        if not SMALLEST_RISK <= self.risk <= LARGEST_RISK:
            raise RangeError(
                f"--risk {self.risk:g} is outside {SMALLEST_RISK:g} to {LARGEST_RISK:g}; give a share such as '5 %'"
            )
        if not 1 <= self.most <= MOST_SETS:
            raise RangeError(f"--sets {self.most} is outside 1 to {MOST_SETS}; give a number inside")
        worst = [(risk, pair) for pair in self._expected_pairs if (risk := self._least_risk(pair)) > self.risk]
        if worst:
            raise self._refusal(*max(worst))

    @cached_property
    def family(self) -> Family:
        """All comparisons of the run, with what is known of the scatter of sets."""
        u = budget(self._lines(), 1, 1, self.dwell).u
        return Family(len(self.objects), self.risk, self.most, u, PRIOR_FREEDOM)

    @property
    def costs(self) -> Costs:
        """Bench times of one object; the first of its sets takes longer, which counts for the mounting."""
        first, later = (
            point_seconds(self.frequency, self.dwell, first=first, mounts=self.mounts) for first in (True, False)
        )
        return Costs(0.0, first - later, later - self.dwell, self.mounts.person)

    def has_enough(self, name: str, points: Sequence[SoftnessPoint]) -> bool:
        """Whether an object has enough sets: it is told from those before it, and has what those after it need."""
        ratios = ratios_of(points)
        return len(ratios.get(name, ())) >= self._least(name) and is_told(self.family, ratios, name)

    def ranked(self, points: Sequence[SoftnessPoint]) -> Ranked:
        """What the points told. Raises RangeError: none is valid."""
        ratios = ratios_of(points)
        found = order(self.family, ratios)
        return Ranked(
            self.risk,
            found.risk,
            {each.name: len(ratios.get(each.name, ())) for each in self.objects},
            tuple(self._not_told(pair, ratios, found.scatter) for pair in found.not_told),
            found.scatter,
        )

    def predicted(self) -> Predicted:
        """What the run is predicted to take; a plan for people."""
        sets = self._planned()
        seconds = math.fsum(self.costs.seconds(1, number, self.dwell) for number in sets.values())
        each = ", ".join(f"{name}: {number}" for name, number in sets.items())
        shares = {row["name"]: row["share"] for row in budget(self._lines(), 1, 1, self.dwell).rows()}
        binds = max(shares, key=lambda name: shares[name])
        left = [pair for pair in self._expected_pairs if self._needed(pair) is None]
        lines = [
            f"wanted         the order of {counted(len(self.objects), 'object')} to a risk of {100 * self.risk:.3g} %",
            f"plan           up to {counted(self.most, 'set')} of each object; it goes on as soon as it is told",
            f"expected       sets of each: {each}: {duration(seconds)} ({self.mounts.described(len(sets))})",
            f"binds          {binds}, {shares[binds]:.0%} of the variance of a set",
            *([f"doubtful       {told_pairs(left)}: may need more than {self.most} sets"] if left else []),
        ]
        told = {"risk": self.risk, "planned": {"sets": sets, "seconds": seconds, "shares": shares, "binds": binds}}
        return Predicted(seconds, None, told, lines)

    @cached_property
    def _ratios(self) -> dict[str, float]:
        """Expected ratio of each object that is one of the known samples; nothing is expected of others."""
        known = [each for each in self.objects if SAMPLES.get(each.name) == each]
        return {each.name: expected_ratio(self.design, each.name) for each in known}

    def _lines(self, scatter: float | None = None) -> list[BudgetLine]:
        """Lines of the ratio of one set; what all objects have in common, such as the films' calibration, is left out.

        `scatter`: that of sets, noise included, where a run told it.
        """
        if scatter is not None:
            return [BudgetLine(SCATTER, scatter, RepeatUnit.SET)]
        noise = expected_noise(self.design, min(self.loads), min(self._ratios.values(), default=LEAST_RATIO))
        return [
            BudgetLine(SCATTER, self.design.ratio_scatter, RepeatUnit.SET, PRIOR_FREEDOM),
            BudgetLine(NOISE, noise, RepeatUnit.SECOND),
        ]

    @cached_property
    def _expected_pairs(self) -> tuple[Pair, ...]:
        names = list(self._ratios)
        return tuple((one, other) for n, one in enumerate(names) for other in names[n + 1 :])

    def _gap(self, pair: Pair) -> float:
        one, other = (self._ratios[name] for name in pair)
        return abs(math.log(one / other))

    def _needed(self, pair: Pair) -> int | None:
        return needed(self.family, self._lines(), self.dwell, self._gap(pair))

    def _least_risk(self, pair: Pair) -> float:
        return least_risk(self.family, self._lines(), self.dwell, self._gap(pair))

    def _least(self, name: str) -> int:
        """Sets that an object needs to be told later from those that are mounted after it."""
        names = [each.name for each in self.objects]
        after = names[names.index(name) + 1 :]
        if any(each not in self._ratios for each in (*after, *([name] if after else []))):
            return self.most
        return max((self._needed((name, other)) or self.most for other in after), default=1)

    def _planned(self) -> dict[str, int]:
        """Expected number of sets of each object."""
        sets: dict[str, int] = {}
        for each in self.objects:
            name = each.name
            number, freedom = self._least(name), PRIOR_FREEDOM + sum(sets.values()) - len(sets)
            for before, others in sets.items():
                known = name in self._ratios and before in self._ratios
                gap = self._gap((before, name)) if known else 0.0
                number = max(number, expected_sets(self.family, self._lines(), self.dwell, gap, others, freedom))
            sets[name] = number
        return sets

    def _not_told(self, pair: Pair, ratios: Mapping[str, Sequence[float]], scatter: float) -> NotTold:
        one, other = (math.fsum(map(math.log, ratios[name])) / len(ratios[name]) for name in pair)
        alone = Family(2, self.risk, MOST_SETS, scatter, PRIOR_FREEDOM)
        plan = what_it_takes(alone, self._lines(scatter), self.costs, self.dwell, one - other)
        return NotTold(pair, None, None) if plan is None else NotTold(pair, plan.sets, 2 * plan.seconds)

    def _refusal(self, least: float, pair: Pair) -> RangeError:
        plan = what_it_takes(self.family, self._lines(), self.costs, self.dwell, self._gap(pair))
        shares = budget(self._lines(), 1, 1, self.dwell).rows()
        binds = max(shares, key=lambda row: row["share"])["name"]
        told, asked = " and ".join(pair), f"--risk '{100 * self.risk:.3g} %'"
        lines = [
            f"{asked} cannot be expected of {counted(self.most, 'set')} of each object: {binds} leaves a risk of "
            f"{100 * least:.2g} % that {told} are in the wrong order",
            f"best now  --risk '{100 * 1.01 * least:.2g} %'"
            if least < LARGEST_RISK
            else "best now  no risk worth naming",
        ]
        if plan is not None and plan.sets <= MOST_SETS:
            lines.append(f"or        --sets {plan.sets}")
        else:
            lines.append(f"or        leave {pair[0]} or {pair[1]} out: no {MOST_SETS} sets tell them apart")
        return RangeError("\n  ".join(lines))


def ratios_of(points: Sequence[SoftnessPoint]) -> dict[str, list[float]]:
    """Ratios of the valid points of each object, in the order of the points."""
    groups: dict[str, list[float]] = {}
    for point in points:
        if point.valid and point.force_ratio > 0:
            groups.setdefault(point.object, []).append(point.force_ratio)
    return groups


def told_pairs(pairs: Sequence[Pair]) -> str:
    """Pairs of objects for people."""
    return ", ".join(" and ".join(pair) for pair in pairs)


def ranked_lines(ranked: Ranked) -> list[str]:
    """What a run told of the order, for people."""
    asked = f"{100 * ranked.risk:.3g} %"
    sets = ", ".join(f"{name}: {number}" for name, number in ranked.sets.items())
    reached = None if ranked.achieved_risk is None else f"{100 * ranked.achieved_risk:.2g} %"
    known = "the order is" if not ranked.not_told else "the other pairs are"
    told = "no pair is known to that risk" if reached is None else f"{known} known to a risk of {reached}"
    lines = [
        f"risk           {asked} of a wrong pair was asked for; {told}",
        f"sets           {sets}; from set to set the ratio scatters by {100 * ranked.scatter:.2g} %",
    ]
    for each in ranked.not_told:
        told = " and ".join(each.objects)
        if each.sets is None or each.seconds is None or each.sets > MOST_SETS:
            lines.append(f"not told       {told}: no {MOST_SETS} sets would tell them apart")
        else:
            names = ",".join(each.objects)
            lines.append(
                f"not told       {told}: {counted(each.sets, 'set')} of each would, in {duration(each.seconds)}: the"
                f" same command for {names} with --sets {each.sets}"
            )
    return [
        *lines,
        "note           each object is mounted once; what mountings scatter is not known and counts as none",
    ]
