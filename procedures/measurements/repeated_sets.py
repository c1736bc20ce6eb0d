"""Load sets that are repeated for a tolerance: a plan in whole rounds of loads, and the most sets that a run takes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.instrument.allocation.allocate import Allocation
from palpate.instrument.allocation.lines import BudgetLine, Costs, budget

MOST = 5, 20  # times the planned sets, and sets besides: a run that needs more ends without the tolerance
MOST_SETS = 10_000  # of a plan, and of a run


def in_rounds(lines: Sequence[BudgetLine], costs: Costs, sets: int, dwell: float, each: int = 1) -> Allocation:
    """The plan of one mounting with `sets` sets or a few more, in whole rounds of `each`, and a dwell of a set [s]."""
    sets = each * math.ceil(sets / each)
    reached = budget(lines, 1, sets, dwell)
    shares = {row["name"]: row["share"] for row in reached.rows()}
    binds = max(shares, key=lambda name: shares[name])
    seconds = costs.seconds(1, sets, dwell)
    return Allocation(1, sets, dwell, seconds, reached.u, shares, binds, reached.degrees_of_freedom)


def most_sets(plan: Allocation, each: int = 1) -> int:
    """The most sets of a run with a tolerance, in whole rounds of `each`."""
    return each * math.ceil((MOST[0] * plan.sets + MOST[1]) / each)


def share(u: float, digits: int = 2) -> str:
    """A share in percent, with so many digits."""
    percent = 100 * u
    return f"{percent:.{digits}g} %" if percent < 10**digits - 0.5 else f"{percent:.0f} %"


def reachable(floor: float) -> str:
    """A share a little above a floor, in percent with two digits: one that may be asked for."""
    step = 10.0 ** (math.floor(math.log10(1.01 * floor)) - 1)
    return share(step * math.ceil(1.01 * floor / step))
