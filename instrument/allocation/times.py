"""How long a run takes that ends by the scatter of its own first sets: on average, and at most.

times(lines, costs, 0.02, plan, (10, 100)).mean
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.allocation.allocate import Allocation, cheapest
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, merged
from palpate.instrument.allocation.stopping import first_sets
from palpate.instrument.uncertainty.budget import COVERAGE

PARTS = 50  # of equal probability, at whose middles the time is asked
MOST_FREEDOM = 1e9  # as good as infinitely many


@dataclass(frozen=True, slots=True)
class Times:
    """Bench times of the runs of one plan [s].

    Attributes:
        mean: their mean.
        longest: the bound, at which a run ends whether or not it has reached its tolerance.
        enough: share of runs that reach it within the bound, where no other limit of time ends them.
    """

    mean: float
    longest: float
    enough: float = COVERAGE


def times(
    lines: Sequence[BudgetLine],
    costs: Costs,
    tolerance: float,
    plan: Allocation,
    sets_between: tuple[int, int],
    limit: float | None = None,
) -> Times:
    """Bench times before it is known how much sets scatter in this run.

    The variance of the first sets over that of the prior is distributed as F, because the prior is an estimate, too.
    Its mean is above 1: where a run has more than its first sets, it takes longer than its plan on average. The bound
    is the time that 95 % of the runs need at most, and no run goes on beyond it. Where they would need more sets than
    a run has, it is that of the greatest number of sets, which is enough for fewer of them.

    Args:
        lines, costs, tolerance: those from which the plan was made.
        plan: the plan.
        sets_between: least number of sets in each mounting, and the number with which a run ends in any case.
        limit: bench time that ends a run instead of the bound [s]; None: the bound ends it.

    Raises:
        RangeError: as for `allocate`.
    """
    from scipy.special import fdtri

    (fewest, most), first = sets_between, first_sets(plan)
    of_sets = [line for line in lines if line.per in (RepeatUnit.SET, RepeatUnit.SECOND)]
    freedom = min(budget(of_sets, 1, 1, plan.dwell).degrees_of_freedom, MOST_FREEDOM)

    def sets_of(share: float) -> tuple[int, int]:
        """Mountings and sets that this share of runs does not pass."""
        factor = float(fdtri(first - 1, freedom, share)) ** 0.5
        found = [replace(line, u=factor * line.u) if line in of_sets else line for line in lines]
        mountings, sets, _ = cheapest(merged(found, plan.dwell), costs, tolerance, plan.dwell, fewest)
        return mountings, sets

    def seconds(mountings: int, sets: int) -> float:
        return costs.seconds(mountings, min(sets, most), plan.dwell)

    longest = sets_of(COVERAGE)
    bound = max(plan.seconds, seconds(*longest))
    end = bound if limit is None else limit
    runs = [sets_of(float(share)) for share in (np.arange(PARTS) + 0.5) / PARTS]
    enough = COVERAGE if longest[1] <= most else float(np.mean([sets <= most for _, sets in runs]))
    return Times(float(np.mean([min(seconds(*run), end) for run in runs])), min(bound, end), enough)
