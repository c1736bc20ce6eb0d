"""Sets of one quantity that are repeated for a tolerance, or to fill a time.

    found, refused = planned({"1": [RunOption(lines, costs, dwell=0.1)]}, tolerance=0.02, rounds=3)
    while not found["1"].is_enough(taken, ratios) and taken < found["1"].most: ...  # one more set
    found["1"].answer(ratios).u

Sets are taken in whole rounds, such as each of some loads once. The first ones tell how much sets scatter, and that
tells how many there are in all (`stopping`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from palpate.instrument.allocation.lines import BudgetLine, Costs
from palpate.instrument.allocation.stopping import RunRatio, answer, enough
from palpate.instrument.allocation.table import MOST_SETS, ROUNDING, Allocation, OutOfReach, RunOption, Table
from palpate.instrument.errors import RangeError

MOST = 5, 20  # times the planned sets, and sets besides: a run that needs more ends without the tolerance

T = TypeVar("T")


@dataclass(frozen=True)
class Repeated:
    """Sets of one quantity, repeated for a tolerance or to fill a time.

    Attributes:
        lines: lines of the quantity's uncertainty.
        costs: bench times.
        plan: the plan.
        tolerance: half-width of the 95 % interval, as the lines count; None: as good as the time allows.
        rounds: number of sets of a round; only whole ones are taken.
    """

    lines: Sequence[BudgetLine]
    costs: Costs
    plan: Allocation
    tolerance: float | None
    rounds: int = field(default=1, kw_only=True)

    @property
    def most(self) -> int:
        """The most sets of a run with a tolerance."""
        sets = MOST[0] * self.plan.sets + MOST[1]
        return self.rounds * min(math.ceil(sets / self.rounds), MOST_SETS // self.rounds)

    def is_enough(
        self, taken: int, *ratios: Sequence[float], lines: Sequence[BudgetLine] = (), sensitivity: float = 1.0
    ) -> bool:
        """Whether the tolerance needs no further set, or by the scatter that was found no number of sets reaches it.

        Args:
            taken: number of sets, those that are not valid among them; no round is broken off.
            ratios: those of the valid sets; of several quantities with the same lines, those of each.
            lines: lines at what was found; empty: those of the plan.
            sensitivity: as of `enough`.
        """
        if self.tolerance is None or not taken or taken % self.rounds:
            return False
        asked = lines or self.lines, self.costs, self.tolerance, self.plan, sensitivity
        try:
            return all(enough(*asked, [each]).why for each in ratios)
        except RangeError:
            return True

    def reaches(self, half: float) -> bool:
        """Whether a half-width is within the tolerance."""
        return self.tolerance is not None and half <= self.tolerance * (1 + ROUNDING)

    def answer(self, ratios: Sequence[float], lines: Sequence[BudgetLine] = ()) -> RunRatio:
        """The mean ratio, and its relative uncertainty by what the valid sets scatter. `lines` as for `is_enough`."""
        return answer(lines or self.lines, self.plan, 1.0, [ratios], by_time=self.tolerance is None)


def planned(
    ways: Mapping[T, Sequence[RunOption]], tolerance: float, rounds: int = 1
) -> tuple[dict[T, Repeated], dict[T, OutOfReach]]:
    """The sets of each quantity for a tolerance, and why others cannot have it."""
    found, refused = {}, {}
    for name, each in ways.items():
        try:
            plan = Table.of(each, rounds=rounds).for_tolerance(tolerance)
            found[name] = Repeated(each[0].lines, each[0].costs, plan, tolerance, rounds=rounds)
        except OutOfReach as error:
            refused[name] = error
    return found, refused
