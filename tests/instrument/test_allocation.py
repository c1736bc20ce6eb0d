"""Plans of mountings, sets and dwell: rows of one table, looked up for a tolerance or a time, and what is refused."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from scipy.special import stdtrit  # scipy.stats takes a second to import

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget, half_widths
from palpate.instrument.allocation.preparations import Preparation, prepared
from palpate.instrument.allocation.stopping import run_times
from palpate.instrument.allocation.table import (
    FIRST,
    MOST_SETS,
    Allocation,
    OutOfReach,
    RunOption,
    Table,
    dwells,
)
from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import mixture_factor
from tests.benchmarks.front import WORST, quickest, setting

BENCH = Costs(start=4.0, mounting=75.0, set=1.6, person=60.0)
SCATTER, NOISE = BudgetLine("gain scatter", 0.082, RepeatUnit.SET, 7), BudgetLine("noise", 0.002, RepeatUnit.SECOND)
MOUNTING = BudgetLine("mounting", 0.02, RepeatUnit.MOUNTING, 2)
VALIDATION = BudgetLine("validation", 0.117, RepeatUnit.NOTHING, 5)


def table(*lines: BudgetLine, loads: tuple[float, ...] = (0.0,), costs: Costs = BENCH, most: int = 60) -> Table:
    ways = [RunOption(lines, replace(costs, mounting=costs.mounting + load / 10), 0.1, load) for load in loads]
    return Table.of(ways, range(1, most + 1))


def planned(lines: list[BudgetLine], tolerance: float, each: Sequence[float] = (0.1,), rounds: int = 1) -> Allocation:
    return Table.of([RunOption(lines, BENCH, dwell) for dwell in each], rounds=rounds).for_tolerance(tolerance)


def in_time(seconds: float, *lines: BudgetLine) -> Allocation:
    return Table.of([RunOption(lines, BENCH, 0.1)], fewest=1, by_time=True).for_time(seconds)


@pytest.mark.slow
def test_no_plan_is_much_quicker() -> None:
    ways, tolerance = setting(Random(6))
    found = Table.of([replace(way, load=0.0) for way in ways], range(1, 21)).for_tolerance(tolerance)
    assert found.half <= tolerance * (1 + 1e-9)
    assert found.mean <= quickest(ways, tolerance, most=21) * (1 + WORST)


def test_a_half_width_is_students_by_the_first_sets_that_tell_the_scatter() -> None:
    found = planned([SCATTER, NOISE], 0.05)
    u = math.hypot(0.082 / math.sqrt(found.sets), 0.002 / math.sqrt(0.1 * found.sets))
    assert found.u == pytest.approx(u)
    assert found.half == pytest.approx(stdtrit(max(10, math.ceil(found.sets / 2)) - 1, 0.975) * u)
    assert (found.mountings, found.dwell, found.binds) == (1, 0.1, "gain scatter")
    assert found.seconds == pytest.approx(79 + 1.7 * found.sets)
    assert math.fsum(found.shares.values()) == pytest.approx(1)


@pytest.mark.parametrize(("share", "freedom", "rest"), [(0.7, 2, 9), (0.3, 3, 30), (0.9, 2.5, 5), (1, 2, 9), (0, 2, 9)])
def test_a_prior_of_few_degrees_of_freedom_makes_a_mixture_of_distributions(
    share: float, freedom: float, rest: float
) -> None:
    rng, runs = np.random.default_rng(4), 400_000
    drawn = np.sqrt(share) * rng.standard_t(freedom, runs) + np.sqrt(1 - share) * rng.standard_t(rest, runs)
    assert mixture_factor(share, freedom, rest) == pytest.approx(np.quantile(abs(drawn), 0.95), rel=0.01)


@pytest.mark.parametrize("mountings", [1, 3, 12])
def test_many_half_widths_at_once_are_those_of_budgets(mountings: int) -> None:
    lines = [replace(SCATTER, degrees_of_freedom=9), replace(MOUNTING, degrees_of_freedom=2 + mountings - 1)]
    one = budget(lines, mountings, 20 * mountings, 0.1).expanded()
    k, n = np.array([float(mountings)]), np.array([20.0])
    many = half_widths([SCATTER, MOUNTING], k, n, 0.1, np.array([9.0]))
    assert many[0] == pytest.approx(one, rel=6e-3)  # of a table that is looked up
    assert many[0] >= one * (1 - 1e-4)


def test_tolerance_time_and_front_are_looked_up_in_the_same_rows() -> None:
    rows = table(SCATTER, NOISE, MOUNTING)
    front = [rows.row(number) for number in rows.front_rows()]
    assert all(a.mean < b.mean and a.half > b.half for a, b in pairwise(front))
    for point in front[:: len(front) // 7]:
        assert rows.for_tolerance(point.half) == point
        assert rows.for_time(point.seconds).half <= point.half
    assert min(point.sets / point.mountings for point in front) == FIRST
    assert max(point.sets for point in front) <= MOST_SETS


def test_a_greater_load_is_taken_where_it_costs_little() -> None:
    assert table(SCATTER, NOISE, loads=(2.0, 4.0)).for_tolerance(0.05).load == 4.0
    assert table(SCATTER, NOISE, loads=(2.0, 400.0)).for_tolerance(0.05).load == 2.0


def test_sets_come_in_whole_rounds_and_dwells_double_while_noise_pays() -> None:
    assert planned([SCATTER, NOISE], 0.05, rounds=6).sets % 6 == 0
    assert dwells([SCATTER, NOISE], 0.1) == [0.1]
    noisy = [SCATTER, BudgetLine("noise", 0.1, RepeatUnit.SECOND)]
    several = dwells(noisy, 0.1)
    assert several[:3] == [0.1, 0.2, 0.4]
    assert planned(noisy, 0.02, several).dwell > 0.4
    assert planned(noisy, 0.02, several).seconds < planned(noisy, 0.02).seconds


def test_a_plan_in_a_time_may_have_few_sets_whose_scatter_the_prior_tells() -> None:
    found = in_time(79 + 3 * 1.7 + 0.01, SCATTER, NOISE)
    assert found.sets == 3
    assert found.half == pytest.approx(stdtrit(7 + 2, 0.975) * found.u, rel=0.01)


def test_a_tolerance_that_no_plan_reaches_tells_what_binds_and_the_best_there_is() -> None:
    with pytest.raises(OutOfReach, match=r"validation leaves × 1\.3, which no longer run") as caught:
        table(SCATTER, VALIDATION).for_tolerance(0.1)
    assert caught.value.floor <= 0.117 * stdtrit(5, 0.975)
    assert table(SCATTER, VALIDATION).for_tolerance(caught.value.best).half == pytest.approx(caught.value.best)
    with pytest.raises(OutOfReach, match=r"gain scatter binds, and a run has") as caught:
        planned([SCATTER], 1e-4)
    assert caught.value.floor == 0


def test_no_plan_is_better_than_what_no_longer_run_is_said_to_lower() -> None:
    films = BudgetLine("films' calibration", 0.03, RepeatUnit.NOTHING, 3)  # ± 9.5 % alone
    with pytest.raises(OutOfReach, match=r"films' calibration leaves ± 8\.9 %, which no longer run lowers") as caught:
        table(SCATTER, films).for_tolerance(0.001)
    assert caught.value.floor == caught.value.best


def test_runs_take_longer_than_planned_where_a_prior_lets_mountings_scatter() -> None:
    """A plan of one mounting learns nothing of their scatter; of more, every second run needs further ones."""
    rows = table(SCATTER, NOISE, MOUNTING)
    lines = [SCATTER, NOISE, MOUNTING]
    one, more = rows.for_tolerance(0.15), rows.for_tolerance(0.05)
    assert one.mountings == 1
    assert run_times(lines, BENCH, 0.15, one).mean == pytest.approx(one.mean, rel=0.01)
    assert more.mountings > 1
    found = run_times(lines, BENCH, 0.05, more)
    assert more.mean < found.mean < found.longest
    stated = [SCATTER, NOISE, replace(MOUNTING, degrees_of_freedom=math.inf)]
    certain = table(*stated).for_tolerance(0.05)
    assert run_times(stated, BENCH, 0.05, certain).mean == pytest.approx(certain.mean, rel=0.02)


FILMS = Preparation("films", u=0.07, fixed=90.0, each=3.0, least=3)
REFERENCES = Preparation("validation", u=0.1, fixed=0.0, each=400.0, rest=0.01)


@pytest.mark.slow
def test_what_binds_is_prepared_and_what_does_not_is_left_as_it_is() -> None:
    rows = table(SCATTER, NOISE, VALIDATION, BudgetLine("films", 0.03, RepeatUnit.NOTHING), most=12)
    assert prepared(rows, 0.5, [REFERENCES, FILMS]).numbers == {}
    found = prepared(rows, 0.2, [REFERENCES])
    assert found.numbers["validation"] > 0
    assert found.once == 400 * found.numbers["validation"]
    assert found.run.half <= 0.2
    assert prepared(rows, 0.1, [REFERENCES, FILMS]).numbers.keys() == {"validation", "films"}
    assert prepared(rows, 0.015, [REFERENCES, FILMS]) is None


@pytest.mark.slow
def test_no_number_of_units_is_much_quicker_in_all() -> None:
    rows = table(SCATTER, NOISE, MOUNTING, VALIDATION, most=12)
    found, best = prepared(rows, 0.15, [REFERENCES]), math.inf
    for units in range(1, 60):
        made = table(SCATTER, NOISE, MOUNTING, REFERENCES.line(units), most=12)
        try:
            best = min(best, REFERENCES.seconds(units) + made.for_tolerance(0.15).mean)
        except OutOfReach:
            continue
    assert found.once + found.run.mean <= 1.03 * best


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: planned([SCATTER], 0), "tolerance 0"),
        (lambda: planned([SCATTER], math.nan), "tolerance nan"),
        (lambda: planned([], 0.05), "at least one line"),
        (lambda: planned([SCATTER, SCATTER], 0.05), "'gain scatter'"),
        (lambda: in_time(80.6, SCATTER), "of 1 load set, takes 80.7 s"),
        (lambda: in_time(math.inf, SCATTER), "inf s is too short"),
        (lambda: BudgetLine("noise", -1, RepeatUnit.SECOND), "'noise': standard uncertainty -1"),
        (lambda: BudgetLine("noise", math.inf, RepeatUnit.SECOND), "finite"),
        (lambda: BudgetLine("noise", 1, RepeatUnit.SECOND, 0), "0 degrees of freedom"),
        (lambda: Costs(0, 10, 1, person=11), "a person takes 11 s"),
        (lambda: Costs(0, -1, 1), "'mounting': -1 s"),
        (lambda: budget([SCATTER], 2, 1, 0.1), "2 mountings, 1 sets"),
    ],
)
def test_what_makes_no_plan_is_refused(wrong: Callable[[], object], why: str) -> None:
    with pytest.raises(RangeError, match=why):
        wrong()
