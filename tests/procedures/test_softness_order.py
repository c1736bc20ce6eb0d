"""`softness --risk`: each object gets as many load sets as the order needs, and what is not known is said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.softness import NotTold, Ranked, SoftnessTest, ranked_lines, unknown_object
from tests.procedures.conftest import Benches, Palpate, refused, resumed_digest

pytestmark = pytest.mark.usefixtures("own_store")

SINGLE = get_design("single")
REAL = Target(SINGLE, 10.0, nodes=1)
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
    assert sorted(left["objects"]) == ["60 kPa", "60.5 kPa"]
    assert found["alike"] == [left["objects"]]
    assert left["sets"] is None or left["sets"] > 2
    assert (found["risk"], found["achieved_risk"], found["sets"]) == (0.05, None, {"60 kPa": 2, "60.5 kPa": 2})


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--samples", "1", "--risk", "5%"), "one object has no order; name two or more"),
        (("--samples", "1,2", "--risk", "1e-7"), "--risk 1e-07 is outside 1e-06 to 0.5"),
        (("--samples", "1,2", "--risk", "5%", "--sets", "0"), "--sets 0 is outside 1 to 100"),
        (("--samples", "1,2", "--sets", "3"), "--sets is for --risk"),
        (("--samples", "3,5", "--risk", "0.1%", "--sets", "2"), "gain scatter leaves a risk of 2 % that 3 and 5"),
        (("--samples", "3,5", "--risk", "0.1%", "--sets", "2"), "best now  --risk '2.1 %'\n  or        --sets 12"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(
    palpate: Palpate, benches: Benches, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused(palpate("softness", *arguments), benches)
