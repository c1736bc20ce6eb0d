"""When a run has measured enough, of one object or of several to be ordered, and whether it then tells the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.order import (
    Family,
    early_pairs,
    expected_sets,
    is_told,
    least_risk,
    needed,
    order,
    what_it_takes,
)
from palpate.instrument.allocation.stopping import answer, enough, first_sets, pooled
from palpate.instrument.allocation.table import FIRST, Allocation, OutOfReach, RunOption, Table
from palpate.instrument.errors import RangeError

BENCH = Costs(start=4.0, mounting=93.0, set=1.6, person=60.0)
LINES = [BudgetLine("gain scatter", 0.082, RepeatUnit.SET, 7), BudgetLine("noise", 0.002, RepeatUnit.SECOND)]
MOUNTED = [*LINES, BudgetLine("mounting", 0.02, RepeatUnit.MOUNTING)]
PRIOR = [*LINES, BudgetLine("mounting", 0.02, RepeatUnit.MOUNTING, 2)]


def plan(tolerance: float = 0.045, lines: list[BudgetLine] = LINES) -> Allocation:
    mountings = range(1, 61) if len(lines) > len(LINES) else (1,)
    return Table.of([RunOption(lines, BENCH, 0.1)], mountings).for_tolerance(tolerance)


def sets(count: int, scatter: float, seed: int = 0, about: float = 0.3) -> list[float]:
    """Ratios whose logarithms have exactly this standard deviation about exactly this mean."""
    logs = np.random.default_rng(seed).standard_normal(count)
    logs = (logs - logs.mean()) / logs.std(ddof=1)
    return list(about * np.exp(scatter * logs))


def test_prior_and_sets_are_pooled_by_their_degrees_of_freedom() -> None:
    found = pooled(0.04, 7, sets(6, 0.05), sets(4, 0.03, about=0.5))
    assert found.u == pytest.approx(math.sqrt((7 * 0.04**2 + 5 * 0.05**2 + 3 * 0.03**2) / 15))
    assert (found.degrees_of_freedom, found.refuted) == (15, False)
    assert pooled(0.04, 7) == replace(found, u=pytest.approx(0.04), degrees_of_freedom=7)
    assert pooled(0.0, 0, sets(5, 0.05)).u == pytest.approx(0.05)
    assert pooled(0.04, math.inf, sets(9, 0.045)).degrees_of_freedom == math.inf


def test_a_prior_that_the_sets_refute_is_dropped() -> None:
    found = pooled(0.04, 7, sets(10, 0.04 * math.sqrt(21.8 / 9)))  # χ² of 9 degrees of freedom passes 21.67 in 1 %
    assert (found.refuted, found.degrees_of_freedom) == (True, 9)
    assert found.u == pytest.approx(0.04 * math.sqrt(21.8 / 9))
    assert not pooled(0.04, 7, sets(10, 0.04 * math.sqrt(21.5 / 9))).refuted
    assert pooled(0.04, math.inf, sets(10, 0.08)).refuted


def test_the_first_sets_decide_how_many_there_are() -> None:
    planned = plan()
    first = first_sets(planned)
    assert (planned.sets, first) == (18, 10)
    assert enough(LINES, BENCH, 0.045, planned, 2.0, [sets(9, 0.01)]).sets == 18
    for scatter, count in {0.041: 17, 0.0205: 10, 0.082: 70}.items():  # four times the sets at twice the scatter
        ratios = [sets(first, scatter)]
        found = enough(LINES, BENCH, 0.045, planned, 2.0, ratios).sets
        assert found == pytest.approx(count, rel=0.04)  # the least one of a grid with steps of 2 %
        more = [ratios[0] + sets(found - first, 0.2)] if found > first else ratios  # later sets change nothing
        verdict = enough(LINES, BENCH, 0.045, planned, 2.0, more)
        assert verdict.sets == found
        assert verdict.why.endswith("reached, ± 4.5 % was asked for")


def test_the_interval_is_students_with_the_scatter_of_the_first_sets() -> None:
    ratios = [sets(10, 0.041) + sets(8, 0.001)]
    found = answer(LINES, plan(), 2.0, ratios)
    assert found.degrees_of_freedom == pytest.approx(9)
    assert found.budget.expanded() == pytest.approx(stdtrit(9, 0.975) * 0.082 / math.sqrt(18))
    assert found.ratio == pytest.approx(math.exp(np.log(ratios[0]).mean()))
    assert math.fsum(row["share"] for row in found.budget.rows()) == pytest.approx(1)
    assert answer(LINES, plan(), 2.0, ratios, by_time=True).degrees_of_freedom == pytest.approx(17)


def test_few_sets_lean_upon_the_prior() -> None:
    found = answer(LINES, plan(), 2.0, [sets(3, 0.01)])
    assert found.u == pytest.approx(2 * math.sqrt((7 * 0.0415**2 + 2 * 0.01**2) / 9 / 3), rel=0.01)
    assert found.degrees_of_freedom == pytest.approx(9, rel=0.01)


def test_mountings_that_scatter_more_than_stated_take_further_ones_and_few_degrees_of_freedom() -> None:
    planned = plan(0.04, MOUNTED)
    each = planned.sets // planned.mountings
    near = [sets(each, 0.041, seed, about) for seed, about in enumerate((0.3, 0.301))]
    far = [sets(each, 0.041, seed, about) for seed, about in enumerate((0.3, 0.4))]
    assert planned.mountings == 2
    assert enough(MOUNTED, BENCH, 0.04, planned, 2.0, near).why
    verdict = enough(MOUNTED, BENCH, 0.04, planned, 2.0, far)
    assert (verdict.why, verdict.mountings) == ("", 3)
    found = answer(MOUNTED, planned, 2.0, far)
    assert (found.mountings_refuted, found.sets_refuted) == (True, False)
    assert found.degrees_of_freedom == pytest.approx(1, rel=0.1)


@pytest.mark.parametrize("apart", [0.0, 0.05])
def test_a_prior_of_mountings_is_pooled_with_them_upwards_and_downwards(apart: float) -> None:
    planned = plan(0.045, PRIOR)
    groups = [sets(20, 0.02, seed, 0.3 * math.exp(shift)) for seed, shift in enumerate((-apart, 0.0, apart))]
    found = answer(PRIOR, planned, 2.0, groups, by_time=True)
    (mounted,) = [part for part in found.budget.components if part.name == "mounting"]
    of_means = 2 * apart**2 - 2 * 0.02**2 / 20  # sum of squares, less what the sets explain
    scatter = math.sqrt((2 * 0.01**2 + max(0.0, of_means)) / 4)
    assert mounted.u == pytest.approx(2.0 * scatter / math.sqrt(3), rel=1e-6)
    assert mounted.degrees_of_freedom == 4
    assert found.budget.expanded() > 1.96 * found.u


def test_no_run_ends_before_its_planned_number_of_mountings() -> None:
    planned = plan(0.045, PRIOR)
    assert planned.mountings > 2
    groups = [sets(400, 1e-4, seed) for seed in range(planned.mountings)]
    assert not enough(PRIOR, BENCH, 0.045, planned, 2.0, groups[:-1]).why
    assert enough(PRIOR, BENCH, 0.045, planned, 2.0, groups).why


def test_a_mounting_scatter_that_nobody_told_of_is_seen() -> None:
    found = answer(LINES, plan(), 2.0, [sets(18, 0.041, seed, about) for seed, about in enumerate((0.3, 0.4, 0.35))])
    assert found.mountings_refuted
    assert "scatter of mountings" in {row["name"] for row in found.budget.rows()}


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: pooled(0.04, 7, [0.3, -0.3]), "ratio -0.3"),
        (lambda: pooled(0.04, 7, [0.3, math.nan]), "ratio nan"),
        (lambda: pooled(0.04, 0, [0.3]), "one ratio alone"),
        (lambda: pooled(-0.04, 7), "prior scatter -0.04"),
        (lambda: pooled(0.04, -1), "-1 degrees"),
        (lambda: answer(LINES, plan(), 2.0, [[]]), "no set is measured"),
        (lambda: answer(LINES, plan(), 0.0, [sets(10, 0.01)]), "sensitivity 0"),
    ],
)
def test_what_tells_no_scatter_is_refused(wrong: Callable[[], object], why: str) -> None:
    with pytest.raises(RangeError, match=why):
        wrong()


def test_more_mountings_than_a_plan_chooses_may_be_asked_for_and_may_not_be_enough() -> None:
    lines = [*LINES, BudgetLine("mounting", 0.5, RepeatUnit.MOUNTING)]
    many = Table.of([RunOption(lines, BENCH, 0.1)], (100,)).for_tolerance(0.2)
    assert many.mountings == 100
    assert not enough(lines, BENCH, 0.2, many, 2.0, [sets(10, 0.041)]).why
    with pytest.raises(OutOfReach, match="mounting binds"):
        enough(lines, BENCH, 0.02, many, 2.0, [sets(10, 0.041)])


@pytest.mark.slow
def test_intervals_of_runs_that_stop_by_themselves_hold_the_truth() -> None:
    """The scatter of mountings is drawn from the prior; 300 runs tell the share of intervals to 1.3 %."""
    from tests.benchmarks.front import TOLERANCES, TRUTHS, ended_runs

    ended = [each for tolerance in TOLERANCES[:3] for each in ended_runs(TRUTHS[0], tolerance, 100)]
    assert 0.92 <= np.mean([each.held for each in ended]) <= 0.98
    assert np.mean([each.half <= each.tolerance * (1 + 1e-9) for each in ended]) >= 0.92


def test_sets_of_one_mounting_do_not_make_up_for_those_that_others_lack() -> None:
    """The best plan moves with the ratio: after mountings of fewer sets it may be as many mountings of more."""
    lines = [BudgetLine("gain scatter", 0.152, RepeatUnit.SET, 7), BudgetLine("mounting", 0.034, RepeatUnit.MOUNTING)]
    planned, scatter = plan(0.045, [*lines, BudgetLine("none", 0.0, RepeatUnit.NOTHING)]), 0.152 / 3.7
    first = enough(lines, BENCH, 0.045, planned, 3.7, [sets(first_sets(planned), scatter)])
    each = first.sets // first.mountings
    about = 0.3 * np.exp(0.034 / 3.7 * np.random.default_rng(1).standard_normal(first.mountings + 3))
    done = [sets(each - 9, scatter, seed, ratio) for seed, ratio in enumerate(about[: first.mountings - 1])]
    done[0][: first_sets(planned)] = sets(first_sets(planned), scatter)
    done.append(sets(each, scatter, 90, about[first.mountings]))
    verdict = enough(lines, BENCH, 0.045, planned, 3.7, done)
    assert (verdict.why, verdict.mountings) == ("", first.mountings + 1)
    done.append(sets(each, scatter, 91, about[first.mountings + 1]))
    assert enough(lines, BENCH, 0.045, planned, 3.7, done).why


def test_a_mounting_that_was_interrupted_counts_by_what_its_sets_tell() -> None:
    """After an interruption an object is mounted anew: two mountings share the first sets, and the later has more."""
    made, taken = plan(0.019), sets(80, 0.041)
    whole, cut = (answer(LINES, made, 2.0, each) for each in ([taken], [taken[:5], taken[5:]]))
    assert cut.ratio == pytest.approx(whole.ratio, rel=1e-6)  # without a scatter of mountings all sets count alike
    assert cut.u == pytest.approx(whole.u, rel=0.03)
    first, quick = FIRST, plan(0.2)
    assert enough(LINES, BENCH, 0.2, quick, 2.0, [taken[:5], taken[5:first]]).why
    assert not enough(LINES, BENCH, 0.2, quick, 2.0, [taken[:5], taken[5 : first - 1]]).why
    apart = [*LINES, BudgetLine("mounting", 0.1, RepeatUnit.MOUNTING)]
    assert answer(apart, made, 2.0, [taken[:5], taken[5:]]).u == pytest.approx(0.1 / math.sqrt(2), rel=0.1)


# --- The order of objects by their ratios, to a stated risk of a wrong pair ----------------------------

SCATTER = 0.04
OF_SETS = [BudgetLine("gain scatter", SCATTER, RepeatUnit.SET, 7)]
THREE = Family(3, 0.05, 5, SCATTER, 7)


def around(ratio: float, *steps: float) -> list[float]:
    """Ratios whose logarithms have these distances from that of `ratio`."""
    return [ratio * math.exp(step) for step in steps]


def test_objects_far_apart_are_told_by_one_set_each_and_equal_ones_by_none() -> None:
    found = order(THREE, {"soft": [0.1], "hard": [0.5], "middle": [0.25]})
    assert found.names == ("hard", "middle", "soft")
    assert found.not_told == ()
    assert found.risk is not None and found.risk < 0.05
    alike = order(THREE, {"a": [0.2], "b": [0.2], "c": [0.5]})
    assert alike.not_told == (("a", "b"),)


def test_no_pair_is_told_without_two_objects_and_none_of_them_has_a_risk() -> None:
    found = order(THREE, {"a": [0.2], "b": []})
    assert (found.names, found.not_told, found.risk) == (("a",), (), None)


def test_an_early_look_asks_for_more_than_the_last_one() -> None:
    sets = {"a": around(0.2, 0.02, -0.02, 0.01), "b": around(0.18, 0.02, -0.02, 0.01)}
    assert early_pairs(THREE, sets) == frozenset()
    assert not is_told(THREE, sets, "b")
    assert order(THREE, sets).not_told == ()


def test_a_pair_that_was_told_early_stays_told() -> None:
    sets = {"a": [0.3], "b": around(0.2, 0.0, 0.1, -0.12, 0.3)}
    family = Family(2, 0.05, 5, SCATTER, 7)
    assert early_pairs(family, {**sets, "b": sets["b"][:1]}) == early_pairs(family, sets) == {("a", "b")}


def test_sets_that_scatter_more_than_was_known_tell_less() -> None:
    quiet, wild = ({"a": around(0.3, s, -s, s), "b": around(0.26, s, -s, -s)} for s in (0.03, 0.2))
    assert order(THREE, quiet).not_told == ()
    found = order(THREE, wild)
    assert found.not_told == (("a", "b"),)
    assert found.refuted
    assert found.scatter == pytest.approx(0.23, rel=0.1)


def test_planned_sets_grow_as_the_gap_shrinks_up_to_the_most() -> None:
    counts = [needed(THREE, OF_SETS, 0.1, gap) for gap in (0.5, 0.15, 0.11, 0.05)]
    assert counts == [1, 3, 4, None]
    assert [expected_sets(THREE, OF_SETS, 0.1, gap, 3, 10) for gap in (0.5, 0.3, 0.1)] == [1, 1, 5]
    plan = what_it_takes(THREE, OF_SETS, Costs(0, 90, 2), 0.1, 0.05)
    assert plan is not None and plan.sets == 19
    assert what_it_takes(THREE, OF_SETS, Costs(0, 90, 2), 0.1, 0.0) is None
    assert least_risk(THREE, OF_SETS, 0.1, 0.0) == 1.0
    assert least_risk(THREE, OF_SETS, 0.1, 0.15) < 1e-3


def test_equal_objects_are_seldom_ordered_though_every_set_is_looked_at() -> None:
    rng = np.random.default_rng(5)
    wrong = 0
    for _ in range(200):
        ratios = {name: np.exp(SCATTER * rng.standard_normal(5)).tolist() for name in "abc"}
        wrong += len(order(THREE, ratios).not_told) < 3
    assert wrong <= 18  # twice the risk is told if the direction does not count; 1 % above


@pytest.mark.slow
def test_runs_that_end_early_are_seldom_wrong_and_take_what_was_predicted() -> None:
    from tests.benchmarks.repeats import ORDER_TRUTHS, ranked

    for truth in (ORDER_TRUTHS[0], ORDER_TRUTHS[-2]):
        rows = list(ranked(*truth, runs=60))
        assert all(row.met is not False for row in rows), rows
