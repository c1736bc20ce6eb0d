"""How long runs take that end by the scatter of their own first sets."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import fdtri  # scipy.stats takes a second to import

from palpate.instrument.allocation.allocate import allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.stopping import FIRST, first_sets
from palpate.instrument.allocation.times import Times, times

BENCH = Costs(start=4.0, mounting=93.0, set=1.6, person=60.0)
LINES = [BudgetLine("gain scatter", 0.082, RepeatUnit.SET, 7), BudgetLine("noise", 0.002, RepeatUnit.SECOND)]
SETS = 67.64  # that 1 % takes with the prior's scatter


def at_one_percent(lines: list[BudgetLine] = LINES, most: int = 10_000) -> tuple[int, Times]:
    """Number of first sets, and the times of runs to 1 %."""
    plan = allocate(lines, BENCH, 0.01, fewest=FIRST)
    first = first_sets(plan)
    return first, times(lines, BENCH, 0.01, plan, (first, most))


@pytest.mark.parametrize("freedom", [7, 20, 1e9])
def test_runs_are_drawn_by_f_and_end_at_the_bound(freedom: float) -> None:
    """The variance of the first sets over that of the prior is distributed as F."""
    first, found = at_one_percent([replace(LINES[0], degrees_of_freedom=freedom), LINES[1]], most=400)
    bound = 97 + 1.7 * SETS * fdtri(first - 1, freedom, 0.95)
    assert found.longest == pytest.approx(bound, rel=0.01)
    drawn = np.random.default_rng(1).f(first - 1, freedom, size=100_000)
    taken = 97 + 1.7 * np.ceil(np.clip(SETS * drawn, first, 400))
    assert found.mean == pytest.approx(np.minimum(taken, bound).mean(), rel=0.01)


def test_a_prior_without_end_of_freedom_counts_as_certain() -> None:
    certain = [replace(LINES[0], degrees_of_freedom=math.inf), LINES[1]]
    assert at_one_percent(certain) == at_one_percent([replace(LINES[0], degrees_of_freedom=1e9), LINES[1]])


def test_no_run_has_more_than_the_most_sets() -> None:
    _, free = at_one_percent()
    _, ended = at_one_percent(most=100)
    assert ended.longest == pytest.approx(97 + 1.7 * 100)
    assert ended.mean < free.mean
