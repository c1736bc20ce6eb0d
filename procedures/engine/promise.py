"""What a run is predicted to give, result by result, and what it gave, under the names of the results' budgets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from palpate.instrument.uncertainty.budget import Budget
from palpate.procedures.engine.plan import Plan, Predicted, S, Step

if TYPE_CHECKING:
    from palpate.procedures.engine.result import Result

RELATIVE = "relative"
RESULTS, ACHIEVED = "predicted_results", "achieved_results"  # keys of a plan and of a run in JSON


@dataclass(frozen=True, slots=True)
class Expected:
    """The uncertainty of one result.

    Attributes:
        name: name of the result; that of its budget, if it has one.
        u: standard uncertainty; in most cases the root mean square of what runs give, as a scatter that is known
            beforehand stands for the scatter of a run's own points.
        unit: unit of `u`; "relative": it is relative to the result.
    """

    name: str
    u: float
    unit: str = RELATIVE

    @classmethod
    def of(cls, budget: Budget) -> Expected:
        """The relative uncertainty of a budget's result."""
        return cls(budget.quantity, budget.u / abs(budget.value))


def predicted(steps: Sequence[Step], results: Sequence[Expected], u: float | None = None) -> Predicted:
    """The prediction of a run by its steps and its results; `u`: None: the greatest relative uncertainty among them."""
    told = {RESULTS: [asdict(each) for each in results]}
    return Predicted(math.fsum(step.seconds_expected for step in steps), greatest(results) if u is None else u, told)


def expected_of(plan: Plan[S]) -> list[Expected]:
    """The results that a plan predicts."""
    return [Expected(**row) for row in plan.predicted.details.get(RESULTS, ())]


def achieved(expected: Sequence[Expected], result: Result) -> list[Expected]:
    """What a run achieved of what was expected of it; a result that the run does not have is left out."""
    linear = [each if isinstance(each, Budget) else each.budget for each in result.budgets]
    known = {each.quantity: (each.value, each.u) for each in linear} | dict(getattr(result, "unbudgeted", {}))
    found = []
    for each in expected:
        value, u = known.get(each.name, (0.0, None))
        if u is None or (each.unit == RELATIVE and not value):
            continue
        found.append(Expected(each.name, u / abs(value) if each.unit == RELATIVE else u, each.unit))
    return found


def greatest(results: Sequence[Expected]) -> float | None:
    """The greatest relative uncertainty among some results; None: there is none."""
    return max((each.u for each in results if each.unit == RELATIVE), default=None)


def achieved_u(plan: Plan[S], result: Result) -> float | None:
    """The relative standard uncertainty that a run achieved, to compare with the plan's; None: it is not known."""
    expected = expected_of(plan)
    reached = achieved(expected, result)
    found: float | None = getattr(result, "achieved_u", greatest(reached) if len(reached) == len(expected) else None)
    return found
