"""Plans of mountings, sets and dwell: the cheapest for a tolerance, the best in some time, and what is refused."""

import math
from collections.abc import Callable, Iterator
from random import Random

import pytest

from palpate.instrument.allocation.allocate import Allocation, BelowFloor, allocate, allocate_time
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit, budget
from palpate.instrument.errors import EstimateError, RangeError

BENCH = Costs(start=4.0, mounting=93.0, set=1.6, person=60.0)
SCATTER, NOISE = BudgetLine("gain scatter", 0.082, RepeatUnit.SET, 7), BudgetLine("noise", 0.002, RepeatUnit.SECOND)
MOUNTING, VALIDATION = (
    BudgetLine("mounting", 0.04, RepeatUnit.MOUNTING, 2),
    BudgetLine("validation", 0.117, RepeatUnit.NOTHING, 5),
)


def setting(random: Random) -> tuple[list[BudgetLine], Costs, float]:
    """A random problem of a bench; its tolerance is above the floor, and a few mountings and sets reach it."""
    lines = [
        BudgetLine("scatter", 10 ** random.uniform(-3, -0.7), RepeatUnit.SET),
        BudgetLine("mounting", random.choice([0.0, 10 ** random.uniform(-3, -1)]), RepeatUnit.MOUNTING),
        BudgetLine("noise", 10 ** random.uniform(-4, -0.7), RepeatUnit.SECOND),
        BudgetLine("films", random.choice([0.0, 0.01]), RepeatUnit.NOTHING),
    ]
    costs = Costs(random.uniform(0, 30), random.uniform(5, 120), random.uniform(0.3, 5))
    plan = budget(lines, k := random.randint(1, 8), k * random.randint(1, 30), 10 ** random.uniform(-1, 0.5))
    return lines, costs, plan.u


def plans(most: int) -> Iterator[tuple[int, int]]:
    return ((k, k * n) for k in range(1, most) for n in range(1, 4 * most))


def cheapest(lines: list[BudgetLine], costs: Costs, tolerance: float, most: int = 40) -> float:
    """Bench time of the cheapest plan, by trying all of them; the dwell follows from the number of sets."""
    u = {line.name: line.u**2 for line in lines}
    best = math.inf
    for mountings, sets in plans(most):
        left = tolerance**2 - u["films"] - u["mounting"] / mountings - u["scatter"] / sets
        if left > 0:
            best = min(best, costs.seconds(mountings, sets, max(0.1, u["noise"] / left / sets)))
    return best


def surest(lines: list[BudgetLine], costs: Costs, seconds: float, most: int = 40) -> float:
    """Least uncertainty in some time, by trying all plans."""
    best = math.inf
    for mountings, sets in plans(most):
        dwell = (seconds - costs.seconds(mountings, sets, 0)) / sets
        if dwell >= 0.1:
            best = min(best, budget(lines, mountings, sets, dwell).u)
    return best


@pytest.mark.parametrize("seed", range(12))
def test_no_plan_of_whole_numbers_is_cheaper(seed: int) -> None:
    lines, costs, tolerance = setting(Random(seed))
    found = allocate(lines, costs, tolerance)
    assert found.u <= tolerance * (1 + 1e-9)
    assert found.seconds <= cheapest(lines, costs, tolerance) * (1 + 2e-4)


@pytest.mark.parametrize("seed", range(4))
def test_no_plan_in_that_time_is_surer(seed: int) -> None:
    lines, costs, tolerance = setting(Random(seed))
    seconds = allocate(lines, costs, tolerance).seconds * 1.07
    found = allocate_time(lines, costs, seconds)
    assert found.seconds <= seconds * (1 + 1e-9)
    assert found.u <= surest(lines, costs, seconds, 12) * (1 + 2e-4)


def test_time_and_tolerance_are_two_sides_of_one_plan() -> None:
    lines = [SCATTER, NOISE, MOUNTING]
    there = allocate(lines, BENCH, 0.02)
    back = allocate_time(lines, BENCH, there.seconds)
    assert (back.mountings, back.sets) == (there.mountings, there.sets)
    assert back.u == pytest.approx(there.u, rel=2e-4)


def test_a_plan_tells_its_time_its_uncertainty_and_what_binds() -> None:
    found = allocate([SCATTER, NOISE], BENCH, 0.05)
    assert (found.mountings, found.sets, found.dwell, found.binds) == (1, 3, 0.1, "gain scatter")
    assert found.seconds == pytest.approx(97 + 3 * 1.7)
    assert found.u == pytest.approx(math.hypot(0.082 / math.sqrt(3), 0.002 / math.sqrt(0.3)))
    assert found.shares["gain scatter"] == pytest.approx(0.994, abs=1e-3)
    assert math.fsum(found.shares.values()) == pytest.approx(1)
    assert found.degrees_of_freedom == pytest.approx(7 / 0.994**2, rel=1e-2)


def test_a_mounting_line_buys_mountings_and_dwell_is_bought_only_where_it_pays() -> None:
    assert allocate([SCATTER, MOUNTING], BENCH, 0.02).mountings == 5
    assert allocate([SCATTER, NOISE], BENCH, 0.01).dwell == 0.1
    noisy = allocate([SCATTER, BudgetLine("noise", 0.2, RepeatUnit.SECOND)], BENCH, 0.02)
    assert noisy.dwell == pytest.approx(math.sqrt(1.6) * 0.2 / 0.082, rel=0.02)


def test_what_is_certain_takes_one_set() -> None:
    for found in (
        allocate([BudgetLine("none", 0, RepeatUnit.SET)], BENCH, 0.01),
        allocate_time([VALIDATION], BENCH, 1e6),
    ):
        assert (found.mountings, found.sets, found.dwell) == (1, 1, 0.1)
    assert allocate([BudgetLine("none", 0, RepeatUnit.SET)], BENCH, 0.01).binds == ""


def test_a_tolerance_below_the_floor_names_the_line_and_the_floor() -> None:
    with pytest.raises(BelowFloor, match=r"validation leaves 0\.117") as caught:
        allocate([SCATTER, VALIDATION, BudgetLine("films", 0.003, RepeatUnit.NOTHING)], BENCH, 0.05)
    assert caught.value.line == "validation"
    assert caught.value.floor == pytest.approx(0.11704, abs=1e-5)
    assert allocate([SCATTER, VALIDATION], BENCH, 0.1175).u == pytest.approx(0.1175, rel=0.01)


def test_free_steps_and_hard_tolerances_end() -> None:
    free = Costs(0, 0, 0)
    assert allocate([SCATTER, MOUNTING, NOISE], free, 0.001).u <= 0.001 * (1 + 1e-9)
    assert allocate_time([SCATTER, MOUNTING, NOISE], free, 1e4).u < 0.001
    assert allocate([MOUNTING], Costs(0, 1e-3, 0), 1e-6).mountings == pytest.approx(1.6e9, rel=1e-3)


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (lambda: allocate([SCATTER], BENCH, 1e-8), "centuries"),
        (lambda: allocate([SCATTER], BENCH, 0), "tolerance 0"),
        (lambda: allocate([SCATTER], BENCH, math.nan), "tolerance nan"),
        (lambda: allocate([], BENCH, 0.05), "at least one line"),
        (lambda: allocate([SCATTER, SCATTER], BENCH, 0.05), "'gain scatter'"),
        (lambda: allocate([SCATTER], BENCH, 0.05, shortest=0), "shortest dwell of 0 s"),
        (lambda: allocate_time([SCATTER], BENCH, 98.6), "one set takes 98.7 s"),
        (lambda: allocate_time([SCATTER], BENCH, math.inf), "finite"),
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


def test_lines_of_one_name_make_no_budget() -> None:
    with pytest.raises(EstimateError, match="one name"):
        budget([SCATTER, SCATTER], 1, 1, 0.1)


def test_the_plan_is_the_same_whatever_the_order_of_lines() -> None:
    lines = [SCATTER, NOISE, MOUNTING]
    one, other = allocate(lines, BENCH, 0.03), allocate(lines[::-1], BENCH, 0.03)
    assert isinstance(one, Allocation)
    assert (one.mountings, one.sets, one.seconds) == (other.mountings, other.sets, other.seconds)
