"""Unknown objects get a modulus with an interval, or a bound, and an order that is known to a risk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate import RangeError, SoftnessTest, get_design, get_sample, unknown_object
from palpate.extend import Target
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.springs import ratio_of_modulus
from palpate.procedures.measurements.softness import (
    NotTold,
    Ranked,
    SoftnessPoint,
    SoftnessResult,
    default_model,
    evaluate,
    price_of,
    ranked_lines,
)
from tests.procedures.conftest import Palpate, resumed_digest

SINGLE = get_design("single")
REAL = Target(SINGLE, 10.0, nodes=1)
COLUMN = RatioQuestion(SINGLE.name, "column", settings={"sensed_thickness": 3e-3})
QUICK = ("--loads", "2 N, 3 N", "--dwell", "0.2 s")


def found(*ratios: tuple[str, float, float], flags: tuple[str, ...] = ()) -> SoftnessResult:
    """The result, by the column model, of objects whose two points have a given ratio and standard uncertainty."""
    points = [
        SoftnessPoint(name, load, load, 0.05, ratio, u, 0.6 * u, not flags, flags)
        for name, ratio, u in ratios
        for load in (2.0, 3.0)
    ]
    return evaluate(points, SINGLE, COLUMN)


def test_the_modulus_is_that_of_the_model_and_the_interval_covers_it() -> None:
    true = 60e3
    (each,) = found(("soft", ratio_of_modulus(SINGLE, true, 3e-3), 0.008)).objects
    assert each.modulus_Pa == pytest.approx(true, rel=1e-6)
    assert each.scale_low_Pa is not None and each.scale_high_Pa is not None
    assert each.scale_low_Pa < true < each.scale_high_Pa
    assert (each.force_ratio_u, each.kind) == (pytest.approx(0.008 / 2**0.5), "interval")


def test_a_ratio_above_0_97_gives_a_bound_alone_and_says_why() -> None:
    (each,) = found(("hard", 0.98, 0.002)).objects
    assert (each.modulus_Pa, each.scale_high_Pa, each.kind) == (None, None, "at least")
    assert each.scale_low_Pa is not None and each.scale_low_Pa > 1e6
    assert "1 % of the ratio is" in each.note


def test_objects_are_in_order_and_those_that_may_be_exchanged_are_named() -> None:
    result = found(("a", 0.2, 0.005), ("b", 0.3, 0.005), ("c", 0.202, 0.005))
    assert (result.softness_order, result.alike) == (["b", "c", "a"], [("c", "a")])


def test_a_saturated_film_is_said_and_gives_no_modulus() -> None:
    (each,) = found(("loud", 0.3, 0.005), flags=("clipped",)).objects
    assert each.saturated
    assert (each.valid_points, each.modulus_Pa, each.kind) == (0, None, None)


def test_without_a_validation_error_no_absolute_modulus_is_told() -> None:
    points = [SoftnessPoint("a", 2.0, 2.0, 0.05, 0.2, 0.008, 0.001, True, ())]
    result = evaluate(points, SINGLE, RatioQuestion(SINGLE.name, "experiment", settings={"sensed_thickness": 3e-3}))
    assert result.validation.u is None
    assert result.summary()["validation_line"]["u"] is None
    (each,) = result.objects
    assert each.scale_u is not None and each.scale_u > 0
    assert (each.absolute_u, each.absolute_low_Pa, each.absolute_high_Pa, each.absolute_kind) == (None,) * 4
    assert [budget.quantity for budget in result.budgets] == ["force ratio of a", "modulus of a, scale"]


def test_model_and_price_are_named() -> None:
    assert found(("a", 0.2, 0.005)).price.startswith("model 'column' (closed form): error of the ratio at most")
    assert "no price" in price_of(SINGLE, "experiment")
    assert default_model(SINGLE) == "experiment"


@pytest.mark.slow
def test_the_command_finds_the_modulus_of_an_unknown_object_and_gives_the_public_names(palpate: Palpate) -> None:
    result = palpate("softness", "--modulus", "45 kPa, 90 kPa", *QUICK, "--json").object
    assert result.keys() >= {"objects", "softness_order", "alike", "coverage", "answered_by", "price", "points", "plot"}
    assert result["softness_order"] == ["90 kPa", "45 kPa"]
    for each, true in zip(result["objects"], (45e3, 90e3), strict=True):
        assert each["scale_low_Pa"] < true < each["scale_high_Pa"]


def test_objects_of_several_thicknesses_are_refused() -> None:
    thick = replace(get_sample("2"), thickness=5e-3)
    with pytest.raises(RangeError, match="different thicknesses, each of which needs its own ratio curve"):
        SoftnessTest((get_sample("1"), thick)).check(REAL)


def test_several_unknown_objects_on_a_real_bench_have_names() -> None:
    one, other = unknown_object(SINGLE), unknown_object(SINGLE)
    with pytest.raises(RangeError, match="give at least one, and each only once"):
        SoftnessTest((one, other)).check(REAL)
    SoftnessTest((one, unknown_object(SINGLE, name="tissue"))).check(REAL)


# --- `softness --risk` --------------------------------------------------------------------------------


pytestmark = pytest.mark.usefixtures("own_store")

FAR, NEAR = ("1", "2"), ("3", "5")


def asked(*names: str, risk: float = 0.05, sets: int = 5) -> SoftnessTest:
    return SoftnessTest(tuple(map(get_sample, names)), dwell=0.2, risk=risk, sets=sets)


def test_the_plan_has_few_sets_of_objects_that_differ_and_many_of_those_that_are_alike() -> None:
    far, near = asked(*FAR).plan(REAL), asked(*NEAR).plan(REAL)
    assert far.predicted.details["planned"]["sets"] == {"1": 1, "2": 1}
    assert near.predicted.details["planned"]["sets"] == {"3": 4, "5": 4}
    assert far.predicted.details["planned"]["binds"] == "gain scatter"
    assert len(far.steps) == len(near.steps) == 10
    assert far.seconds < near.seconds < sum(step.seconds_expected for step in near.steps)


def test_nothing_is_expected_of_unknown_objects() -> None:
    both = unknown_object(SINGLE, name="a"), unknown_object(SINGLE, name="b")
    plan = SoftnessTest(both, risk=0.05).plan(REAL)
    assert plan.predicted.details["planned"]["sets"] == {"a": 5, "b": 5}


@pytest.mark.slow
def test_a_run_ends_as_soon_as_the_order_is_known_and_resumes_to_the_same(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        whole = palpate.run(asked(*FAR), bench, out=tmp_path / "whole")
    assert [point.object for point in whole.result.points] == ["1", "2"]
    ranked = whole.result.ranked
    assert ranked is not None
    assert (ranked.sets, ranked.not_told) == ({"1": 1, "2": 1}, ())
    assert ranked.achieved_risk is not None and ranked.achieved_risk < 0.001
    assert resumed_digest(asked(*FAR), "thesis_single", 1, tmp_path) == whole.run.digest()


def test_what_was_told_is_printed() -> None:
    ranked = Ranked(0.05, None, {"a": 2, "b": 2}, (NotTold(("a", "b"), 7, 200.0),), 0.04)
    told = "\n".join(ranked_lines(ranked))
    assert "5 % of a wrong pair was asked for; no pair is known to that risk" in told
    assert "a and b: 7 sets of each would, in 3 min 20 s: the same command for a,b with --sets 7" in told
    none = ranked_lines(replace(ranked, achieved_risk=0.01, not_told=(NotTold(("a", "b"), None, None),)))
    assert none[0].endswith("the other pairs are known to a risk of 1 %")
    assert none[2].endswith("no 100 sets would tell them apart")


@pytest.mark.slow
def test_the_command_says_which_objects_it_could_not_tell_and_what_would(palpate: Palpate) -> None:
    words = ("softness", "--modulus", "60 kPa, 60.5 kPa", "--risk", "5%", "--sets", "2", "--dwell", "0.2 s")
    found = palpate(*words, "--json").object
    (left,) = found["not_told"]
    assert (sorted(left["objects"]), found["alike"]) == (["60 kPa", "60.5 kPa"], [left["objects"]])
    assert left["sets"] is None or left["sets"] > 2
    assert (found["risk"], found["achieved_risk"], found["sets"]) == (0.05, None, {"60 kPa": 2, "60.5 kPa": 2})
