"""Differences between the results of two runs of one procedure, and between their points, with their uncertainties.

Two runs share what they rest on: a calibration, a sample's area, a model. How much they share is not recorded, so the
uncertainty of a difference is told twice: as if they shared nothing, and as if each contribution of kind B that both
budgets have by one name were the same in both, so that only what it differs by is left. The truth lies between.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from palpate.instrument.errors import UsageError
from palpate.instrument.uncertainty.budget import Budget, Component, groups
from palpate.instrument.uncertainty.decision import Estimate
from palpate.procedures.engine.verdict import of_points
from palpate.procedures.records.columns import Column
from palpate.procedures.records.run import Run

Told = Mapping[str, Any]  # a budget as the record has it


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of a quantity between two runs.

    Attributes:
        first, other: what the runs found.
        independent, shared: the other value less the first, if the runs share nothing, and if they share all they can.
    """

    first: Told
    other: Told
    independent: Budget
    shared: Budget

    @property
    def half_width(self) -> float:
        """Half-width of the 95 % interval, the wider one of both."""
        return max(self.independent.expanded(), self.shared.expanded())

    @property
    def told_apart(self) -> bool:
        """Whether that interval leaves out zero."""
        return abs(self.shared.value) > self.half_width

    def summary(self) -> dict[str, Any]:
        """The difference for JSON."""
        return {
            "quantity": self.first["quantity"],
            "unit": self.first["unit"],
            "first": self.first["value"],
            "first_u": self.first["u"],
            "other": self.other["value"],
            "other_u": self.other["u"],
            "difference": self.shared.value,
            "independent_u": self.independent.u,
            "shared_u": self.shared.u,
            "half_width": self.half_width,
            "told_apart": self.told_apart,
        }


def check_alike(runs: Sequence[Run]) -> None:
    """Check that runs can be compared. Raises UsageError: they are of unlike procedures."""
    for run in runs[1:]:
        if run.procedure != runs[0].procedure:
            raise UsageError(
                f"{runs[0].folder} is of procedure {runs[0].procedure!r} and {run.folder} of {run.procedure!r}, which"
                " have no result in common; give runs of one procedure, or make a report of each"
            )


def differences(first: Iterable[Told], other: Iterable[Told]) -> Iterator[Difference]:
    """The differences of all quantities that the budgets of both runs have. Several of one name go by their order."""
    others = _by_name(other)
    for name, one in _by_name(first).items():
        if name in others:
            two = others[name]
            yield Difference(one, two, _budget(one, two, frozenset()), _budget(one, two, _shared(one, two)))


def _by_name(budgets: Iterable[Told]) -> dict[tuple[str, int], Told]:
    seen: Counter[str] = Counter()
    found = {}
    for entry in budgets:
        budget = entry.get("budget", entry)
        seen[budget["quantity"]] += 1
        found[budget["quantity"], seen[budget["quantity"]]] = budget
    return found


def _shared(one: Told, other: Told) -> frozenset[str]:
    """Names of the inputs that may be the same in both: of kind B, as are all that they are correlated with."""
    both = _of_kind_b(one).items() & _of_kind_b(other).items()
    return frozenset(name for names, _ in both for name in names)


def _of_kind_b(budget: Told) -> dict[frozenset[str], frozenset[tuple[frozenset[str], float]]]:
    """Each group of inputs of kind B that are correlated with each other, with the coefficients of their pairs."""
    components, pairs = budget["components"], _correlations(budget)
    found = {}
    for group in groups([each["name"] for each in components], pairs):
        if all(components[i]["kind"] == "B" for i in group):
            names = frozenset(components[i]["name"] for i in group)
            found[names] = frozenset((frozenset(pair), r) for pair, r in pairs.items() if pair[0] in names)
    return found


def _correlations(budget: Told) -> dict[tuple[str, str], float]:
    return {(each["of"][0], each["of"][1]): each["coefficient"] for each in budget["correlations"]}


def _budget(one: Told, other: Told, shared: frozenset[str]) -> Budget:
    """The budget of the other value less the first, where both have the shared inputs in common."""
    found: dict[str, tuple[float, float, Any]] = {}  # contribution, degrees of freedom and kind by name
    correlations: dict[tuple[str, str], float] = {}
    for sign, budget, of in ((-1.0, one, " of the first run"), (1.0, other, " of the other run")):
        names = {each["name"]: each["name"] + ("" if each["name"] in shared else of) for each in budget["components"]}
        for each in budget["components"]:
            freedom = math.inf if each["degrees_of_freedom"] is None else each["degrees_of_freedom"]
            before, least, _ = found.get(names[each["name"]], (0.0, math.inf, None))
            contribution = before + sign * each["contribution"]
            found[names[each["name"]]] = contribution, min(freedom, least), each["kind"]
        correlations |= {(names[a], names[b]): r for (a, b), r in _correlations(budget).items()}
    components = tuple(Component(name, 1.0, *rest) for name, rest in found.items())
    return Budget(one["quantity"], other["value"] - one["value"], one["unit"], components, correlations)


# --- points --------------------------------------------------------------------------------------------

FAR, BY_CHANCE = 2.0, math.erfc(math.sqrt(2.0))  # a difference beyond 2 u, and how often one is without a cause
GREATEST = 20  # differences that are told one by one

Place = tuple[object, ...]  # what a value of a point is: of which step, which of the points of that step, and so on


@dataclass(frozen=True, slots=True)
class PointDifference:
    """The difference of a quantity between points of two runs, which are of the same step.

    Attributes:
        step: what was asked for, by its names, and the number of the `set` among the points of that step, from 1.
        quantity: name of the column; of one with several values, as for each film, with the number of the value.
        first, other: what the runs found.
    """

    step: Mapping[str, Any]
    quantity: str
    unit: str
    first: Estimate
    other: Estimate

    @property
    def value(self) -> float:
        """The other value less the first."""
        return self.other.value - self.first.value

    @property
    def u(self) -> float:
        """Its standard uncertainty, if the runs share nothing."""
        return math.hypot(self.first.u, self.other.u)

    @property
    def in_u(self) -> float:
        """How many u it is."""
        return self.value / self.u

    def summary(self) -> dict[str, Any]:
        """The difference for JSON."""
        values = {
            "first": self.first.value,
            "first_u": self.first.u,
            "other": self.other.value,
            "other_u": self.other.u,
        }
        own = {"difference": self.value, "u": self.u, "in_u": self.in_u}
        return {"step": dict(self.step), "quantity": self.quantity, "unit": self.unit, **values, **own}


@dataclass(frozen=True, slots=True)
class ComparedPoints:
    """The points of two runs, compared one by one.

    Attributes:
        differences: all of them, the greatest by its u first.
        alone: how many values of the first run, and of the other, have none like them.
    """

    differences: Sequence[PointDifference]
    alone: tuple[int, int]

    @property
    def far(self) -> int:
        """How many differences are beyond 2 u."""
        return sum(abs(each.in_u) > FAR for each in self.differences)

    def summary(self) -> dict[str, Any]:
        """The comparison for JSON."""
        compared, greatest = len(self.differences), self.differences[:GREATEST]
        counts = {"compared": compared, "beyond_2_u": self.far, "by_chance": BY_CHANCE * compared, "alone": self.alone}
        return {**counts, "greatest": [each.summary() for each in greatest]}


def compared_points(
    columns: Mapping[str, Column], asked: Sequence[str], first: Sequence[Told], other: Sequence[Told]
) -> ComparedPoints:
    """Compare all values with an uncertainty of valid points that are of the same step.

    Args:
        columns: the columns of the points.
        asked: those that tell of which step a point is. The n-th points of one step belong together.
        first, other: points of the runs, as they are stored.
    """
    judged = {name: column for name, column in columns.items() if column.u}
    one, two = (_placed(judged, asked, points) for points in (first, other))
    found = []
    for place, estimate in one.items():
        if place in two:
            name, number, nth, *step = place
            place_of_point = dict(zip(asked, step, strict=True)) | {"set": nth}
            quantity = str(name) if number == 1 and (name, 2, nth, *step) not in one else f"{name} {number}"
            found.append(PointDifference(place_of_point, quantity, judged[str(name)].unit, estimate, two[place]))
    found.sort(key=lambda each: abs(each.in_u), reverse=True)
    return ComparedPoints(found, (len(one) - len(found), len(two) - len(found)))


def _placed(columns: Mapping[str, Column], asked: Sequence[str], points: Sequence[Told]) -> dict[Place, Estimate]:
    """What is known of points, each by name of the column, number of the value, number of the set, and step."""
    steps, seen = list[Place](), Counter[Place]()
    for point in points:
        step = tuple(point[name] for name in asked)
        seen[step] += 1
        steps.append((seen[step], *step))
    found: dict[Place, Estimate] = {}
    for name, quantity in of_points(columns, points).items():
        numbers: Counter[int | None] = Counter()
        for value in quantity.values:
            numbers[value.point] += 1
            if value.point is not None and value.estimate is not None and value.estimate.u > 0:
                found[name, numbers[value.point], *steps[value.point - 1]] = value.estimate
    return found
