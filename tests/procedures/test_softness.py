"""Unknown objects get a modulus with an interval, or a bound, and an order."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from palpate.instrument.errors import RangeError
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.springs import ratio_of_modulus
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.softness import (
    SoftnessPoint,
    SoftnessResult,
    SoftnessTest,
    default_model,
    evaluate,
    price_of,
    unknown_object,
)
from tests.procedures.conftest import Benches, Palpate, refused

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
    assert each.force_ratio_u == pytest.approx(0.008 / 2**0.5)
    assert each.kind == "interval"


def test_a_ratio_above_0_97_gives_a_bound_alone_and_says_why() -> None:
    (each,) = found(("hard", 0.98, 0.002)).objects
    assert (each.modulus_Pa, each.scale_high_Pa, each.kind) == (None, None, "at least")
    assert each.scale_low_Pa is not None and each.scale_low_Pa > 1e6
    assert "1 % of the ratio is" in each.note


def test_objects_are_in_order_and_those_that_may_be_exchanged_are_named() -> None:
    result = found(("a", 0.2, 0.005), ("b", 0.3, 0.005), ("c", 0.202, 0.005))
    assert result.softness_order == ["b", "c", "a"]
    assert result.alike == [("c", "a")]


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


def test_the_budget_of_ratio_and_modulus_adds_up_to_their_uncertainty() -> None:
    result = found(("soft", ratio_of_modulus(SINGLE, 60e3, 3e-3), 0.002))
    (each,), (ratio, modulus, absolute) = result.objects, result.budgets
    assert ratio.u == pytest.approx(each.force_ratio_u)
    shares = {row["name"]: row["share"] for row in ratio.rows() if row["share"]}
    assert shares == pytest.approx({"noise": 0.36, "gain scatter": 0.64})
    assert each.scale_low_Pa is not None and each.scale_high_Pa is not None
    measured = 1.96 * math.hypot(*(part.contribution for part in modulus.components[:-1]))
    known = modulus.components[-1].sensitivity * each.curve_error
    assert each.model_error is not None and each.curve_error >= each.model_error
    assert (modulus.u / modulus.value, absolute.u / absolute.value) == pytest.approx((each.scale_u, each.absolute_u))
    assert max(absolute.rows(), key=lambda row: row["share"])["name"] == "validation"
    assert measured + known == pytest.approx((each.scale_high_Pa - each.scale_low_Pa) / 2, rel=0.05)


@pytest.mark.slow
def test_the_command_finds_the_modulus_of_an_unknown_object_and_gives_the_public_names(palpate: Palpate) -> None:
    result = palpate("softness", "--modulus", "45 kPa, 90 kPa", *QUICK, "--json").object
    assert result.keys() >= {"objects", "softness_order", "alike", "coverage", "answered_by", "price", "points", "plot"}
    assert result["softness_order"] == ["90 kPa", "45 kPa"]
    for each, true in zip(result["objects"], (45e3, 90e3), strict=True):
        assert each["scale_low_Pa"] < true < each["scale_high_Pa"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "--samples or --modulus is missing: name the objects that the simulated bench touches"),
        (("--samples", "1", "--modulus", "1 kPa"), "either samples or moduli of unknown objects, not both"),
        (("--samples", "8"), "unknown sample '8'"),
        (("--samples", "1", "--model", "colum"), "unknown model 'colum'"),
        (("--samples", "1", "--loads", "30 N"), "above the bench's force limit of 10 N"),
        (("--samples", "1", "--dwell", "0 s"), "dwell 0 s is not above 0"),
        (("--samples", "1", "--thickness", "3 mm", "--modulus", "1 kPa"), "not both"),
        (("--modulus", "1 kPa", "--thickness", "0 mm"), "--thickness: '0 mm' is not above 0"),
        (("--modulus", "50 kPa, 50 kPa"), "give at least one, and each only once"),
    ],
)
def test_what_cannot_be_measured_is_one_error_before_anything_moves(
    palpate: Palpate, benches: Benches, arguments: tuple[str, ...], message: str
) -> None:
    assert message in refused(palpate("softness", *arguments), benches)


def test_objects_of_several_thicknesses_are_refused() -> None:
    thick = replace(get_sample("2"), thickness=5e-3)
    with pytest.raises(RangeError, match="different thicknesses, each of which needs its own ratio curve"):
        SoftnessTest((get_sample("1"), thick)).check(REAL)


def test_several_unknown_objects_on_a_real_bench_have_names() -> None:
    one, other = unknown_object(SINGLE), unknown_object(SINGLE)
    with pytest.raises(RangeError, match="give at least one, and each only once"):
        SoftnessTest((one, other)).check(REAL)
    SoftnessTest((one, unknown_object(SINGLE, name="tissue"))).check(REAL)
