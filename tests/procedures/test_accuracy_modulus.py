"""palpate accuracy modulus: the least uncertainty of a modulus against bench time, and what it consists of."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models.ratio import RatioQuestion
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.accuracy.modulus.front import ModulusFront, PlanningCase
from palpate.procedures.accuracy.modulus.report import plot_modulus_front, print_modulus_front
from palpate.procedures.lab.chosen import choose
from palpate.procedures.measurements.object_modulus.procedure import LOADS, ObjectModulus
from palpate.procedures.measurements.object_modulus.prospect import Wanted, best_of, costs_of
from palpate.procedures.measurements.softness.procedure import unknown_object
from tests.procedures.conftest import Palpate

DESIGN = get_design("single")
HARD = 500e3  # Pa


def front_of(modulus: float, mounted: float | None = None, model: str = "surface") -> ModulusFront:
    question = RatioQuestion("single", model, settings={"sensed_thickness": 3e-3})
    return ModulusFront.of(
        PlanningCase(DESIGN, question, LOADS, Wanted(None, None, True, 10.0, None, mounted)), modulus
    )


@pytest.fixture(scope="module")
def front() -> ModulusFront:
    return front_of(48e3)


@pytest.fixture(scope="module")
def unvalidated() -> ModulusFront:
    return front_of(50e3, 0.01, model="experiment")


def test_more_time_never_makes_the_modulus_worse(front: ModulusFront) -> None:
    times = [point.plan.allocation.seconds for point in front.points]
    known = [point.plan.scale_u or math.nan for point in front.points]
    assert times == sorted(times)
    assert known == sorted(known, reverse=True)
    assert known[-1] < known[0] / 10


def test_the_absolute_uncertainty_is_flat_at_the_models_error(front: ModulusFront) -> None:
    assert front.model_u == pytest.approx(0.49, abs=0.02)
    assert all(point.plan.absolute_u == pytest.approx(front.model_u, rel=0.02) for point in front.points)
    absolute = [target for target in front.targets if target.absolute]
    assert [target.plan for target in absolute] == [None] * 5
    assert all("palpate calibrate model" in target.why for target in absolute)


@pytest.mark.usefixtures("own_store")
def test_each_plan_is_the_one_that_measure_modulus_makes(front: ModulusFront) -> None:
    bench = choose(None, "thesis_single").target
    for target in front.targets[:5]:
        asked = ObjectModulus(
            unknown_object(DESIGN, 3e-3, 48e3), target.tolerance, relative_to_model=True, model="surface",
            mounting_scatter=None, mountings=None,
        )  # fmt: skip
        if target.tolerance < 0.05:  # it asks for the scatter of mountings there
            asked = replace(asked, mounting_scatter=0.0)
        assert target.plan is not None
        assert asked.course_on(bench).prospect.allocation == target.plan.allocation


def test_a_time_that_holds_only_the_smallest_load_is_planned_with_it(front: ModulusFront) -> None:
    time = costs_of(min(LOADS), 10.0).seconds(1, 1, 0.1) + 0.01
    assert best_of(DESIGN, front.found, Wanted(None, time, True, 10.0, None, None), LOADS).load == min(LOADS)
    with pytest.raises(RangeError, match="too short"):
        best_of(DESIGN, front.found, Wanted(None, time - 0.1, True, 10.0, None, None), LOADS)


def test_shares_add_up_and_the_largest_ones_are_those_of_scatter_and_model(front: ModulusFront) -> None:
    for point in front.points:
        assert point.absolute_shares is not None
        for shares in (point.scale_shares, point.absolute_shares):
            assert math.fsum(shares.values()) == pytest.approx(1)
        assert max(point.scale_shares, key=lambda name: point.scale_shares[name]) == "gain scatter"
        assert point.absolute_shares["validation"] > 0.9


def test_a_scatter_of_mountings_bends_the_front_and_buys_mountings() -> None:
    found = front_of(HARD, 0.01)
    assert found.mounting_u == pytest.approx(0.01 * (found.found.sensitivity or 0))
    two = next(target for target in found.targets if target.tolerance == 0.02)
    assert two.plan is not None
    assert two.plan.allocation.mountings > 3


def test_an_unknown_validation_error_is_not_known_and_never_the_scale(unvalidated: ModulusFront) -> None:
    assert unvalidated.model_u is None
    assert {point.plan.absolute_u for point in unvalidated.points} == {None}
    assert all(point.absolute_shares is None for point in unvalidated.points)
    assert all("not known" in target.why for target in unvalidated.targets if target.absolute)


@pytest.mark.slow
def test_the_picture_is_drawn_of_both_kinds(front: ModulusFront, unvalidated: ModulusFront, tmp_path: Path) -> None:
    for number, drawn in enumerate((front, unvalidated)):
        path = plot_modulus_front(drawn, True, tmp_path / str(number))
        assert path.name == "modulus.png"
        assert path.read_bytes().startswith(b"\x89PNG")


def test_the_command_shows_the_numbers_that_json_has(palpate: Palpate) -> None:
    told = palpate("accuracy", "modulus", "--modulus", "48 kPa").out
    found = palpate("accuracy", "modulus", "--modulus", "48 kPa", "--json").object
    assert found["simulated"] is True
    (one,) = (each for each in found["targets"] if each["tolerance"] == 0.01 and not each["absolute"])
    assert f"{one['plan']['sets']} sets" in told
    assert f"{100 * one['plan']['scale_u']:.2g} %" in told
    assert "palpate test modulus" in told
    (row,) = (line for line in told.splitlines() if line.strip().startswith("1 %"))
    (scale,) = (line for line in told.splitlines() if "1 % on the scale" in line)
    assert scale.split("about ")[1].split(":")[0] in row  # both are mean times


@pytest.mark.slow
@pytest.mark.parametrize("scatter", [0.05, 0.5])
def test_the_tables_fit_80_columns_however_many_mountings_there_are(
    scatter: float, capsys: pytest.CaptureFixture[str]
) -> None:
    found = front_of(48e3, scatter)
    print_modulus_front(found, True, None)
    said = capsys.readouterr().out
    assert max(len(line.rstrip()) for line in said.split("1 min 21 s of each time")[0].splitlines()) <= 80
    assert "2 x 10 sets: two mountings of ten load sets each" in said
    reasons = [target.why for target in found.targets if target.plan is None and not target.absolute]
    assert "none, as told below" not in said or reasons[-1] in said


def test_the_seconds_of_a_target_are_the_mean_time_that_the_table_tells(front: ModulusFront) -> None:
    target = front.targets[4]
    assert target.plan is not None and target.after is not None
    told = target.summary()["plan"]
    assert told["seconds"] == target.plan.times.mean > told["as_known_s"] == target.plan.allocation.seconds
    costs = costs_of(target.plan.load, 10.0)
    assert target.after == pytest.approx(told["seconds"] - costs.start - costs.mounting)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--modulus", "50 MPa"), "no more than a bound"),
        (("--sample", "4", "--modulus", "5 kPa"), "not both"),
        (("--mounting-scatter", "70 %"), "--mounting-scatter"),
        (("--load", "400 N"), "400 N"),
        (("--model", "none"), "unknown model"),
        (("--scene", "none"), "unknown scene"),
    ],
)
def test_what_has_no_front_is_refused(palpate: Palpate, options: tuple[str, ...], why: str) -> None:
    said = palpate("accuracy", "modulus", *options)
    assert said.status == 2
    assert why in said.err
