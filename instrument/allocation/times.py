"""How long a run takes that ends by the scatter of its own first sets: on average, and at most.

times(lines, costs, 0.02, plan, (10, 100)).mean
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from palpate.instrument.allocation.allocate import Allocation, allocate
from palpate.instrument.allocation.lines import Costs, Line, Unit, budget, merged
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
    """

    mean: float
    longest: float


def times(
    lines: Sequence[Line],
    costs: Costs,
    tolerance: float,
    plan: Allocation,
    sets_between: tuple[int, int],
    limit: float | None = None,
) -> Times:
    """Bench times before it is known how much sets scatter in this run.

    The variance of the first sets over that of the prior is distributed as F, because the prior is an estimate, too.
    Its mean is above 1: where a run has more than its first sets, it takes longer than its plan on average. The bound
    is the time that 95 % of the runs need at most, and no run goes on beyond it.

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
    of_sets = [line for line in lines if line.per in (Unit.SET, Unit.SECOND)]
    freedom = min(budget(of_sets, 1, 1, plan.dwell).degrees_of_freedom, MOST_FREEDOM)

    def seconds(share: float) -> float:
        """Time that this share of runs does not pass."""
        factor = float(fdtri(first - 1, freedom, share)) ** 0.5
        found = [replace(line, u=factor * line.u) if line in of_sets else line for line in lines]
        run = allocate(merged(found, plan.dwell), costs, tolerance, plan.dwell, fewest)
        return costs.seconds(run.mountings, min(run.sets, most), plan.dwell)

    bound = max(plan.seconds, seconds(COVERAGE))
    end = bound if limit is None else limit
    taken = [min(seconds(float(share)), end) for share in (np.arange(PARTS) + 0.5) / PARTS]
    return Times(float(np.mean(taken)), min(bound, end))
