"""What `palpate model modulus` answers, and what it refuses."""

from __future__ import annotations

import math
import re

import pytest
import scipy

from palpate.instrument.findings.object_modulus import estimate, validation_of
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES
from tests.procedures.conftest import Palpate, changed

PRICED = ("model", "modulus", "--json", "--model", "column")
MODULUS = (*PRICED, "--compliant-poisson", "0.48")  # which the column does not look at
AREA_SHARE = 1.4**2 / (1.4**2 + 5**2 - 1.5**2)


def column_modulus(ratio: float) -> float:
    """E = E_c (T_s / T_c) (R - a) / (a (1 - R))."""
    return 24e3 * 3 / 3.88 * (ratio - AREA_SHARE) / (AREA_SHARE * (1 - ratio))


def test_each_ratio_gets_its_modulus_or_a_bound(palpate: Palpate) -> None:
    said = palpate(*MODULUS, "--force-ratio", "0.31,0.99, 0.081, 0.05", "--uncertainty", "0.005", "--design", "single")
    inside, hard, soft, outside = said.object["points"]
    assert inside["modulus_Pa"] == pytest.approx(column_modulus(0.31), rel=1e-9)
    assert inside["scale_low_Pa"] == pytest.approx(column_modulus(0.31 - 1.959963985 * 0.005), rel=1e-6)
    assert inside["scale_high_Pa"] == pytest.approx(column_modulus(0.31 + 1.959963985 * 0.005), rel=1e-6)
    assert inside["sensitivity"] == pytest.approx(0.31 * (1 - AREA_SHARE) / ((0.31 - AREA_SHARE) * 0.69), rel=1e-8)
    assert (inside["kind"], inside["note"], inside["model"]) == ("interval", "", "column")
    assert (hard["modulus_Pa"], hard["scale_high_Pa"], hard["kind"]) == (None, None, "at least")
    assert hard["scale_low_Pa"] == pytest.approx(column_modulus(0.99 - 1.959963985 * 0.005), rel=1e-5)
    assert hard["note"] == "1 % of the ratio is 100 % of the modulus here"
    assert (soft["modulus_Pa"], soft["scale_low_Pa"], soft["kind"]) == (None, None, "at most")
    assert soft["scale_high_Pa"] == pytest.approx(column_modulus(0.081 + 1.959963985 * 0.005), rel=1e-6)
    assert outside["kind"] == "at most"
    assert outside["note"].startswith("the model's ratios are 0.0794")
    assert outside["sensitivity"] is None


def test_without_an_uncertainty_the_ratios_own_scatter_counts(palpate: Palpate) -> None:
    (point,) = palpate(*MODULUS, "--force-ratio", "0.3").object["points"]
    assert point["force_ratio_u"] == pytest.approx(get_design("single").ratio_scatter * 0.3)
    (exact,) = palpate(*MODULUS, "--force-ratio", "0.3", "--uncertainty", "0").object["points"]
    assert (
        exact["scale_high_Pa"] / exact["scale_low_Pa"] < 1 + 1e-9 < 1.1 < point["scale_high_Pa"] / point["scale_low_Pa"]
    )


def test_the_interval_holds_what_the_model_leaves_out_where_it_is_priced(palpate: Palpate) -> None:
    (point,) = palpate(*PRICED, "--force-ratio", "0.31", "--uncertainty", "0.005").object["points"]
    (of_ratio,) = palpate(
        "model", "ratio", "--json", "--model", "column", "--sensed-modulus", "60 kPa"
    ).object["points"]  # fmt: skip
    assert point["model_error"] == pytest.approx(of_ratio["model_error"] * of_ratio["force_ratio"])
    spread = 1.959963985 * 0.005 + point["model_error"]
    assert point["modulus_Pa"] == pytest.approx(column_modulus(0.31), rel=1e-9)
    assert point["scale_low_Pa"] == pytest.approx(column_modulus(0.31 - spread), rel=1e-6)
    assert point["scale_high_Pa"] == pytest.approx(column_modulus(0.31 + spread), rel=1e-6)


def test_an_interval_that_the_models_error_carries_to_a_greater_one_holds_that(palpate: Palpate) -> None:
    """Up to 24.13 kPa the column is off by less than above."""
    (point,) = palpate(*PRICED, "--force-ratio", "0.148", "--uncertainty", "0").object["points"]
    (below,) = palpate("model", "ratio", "--json", "--model", "column", "--sensed-modulus", "20 kPa").object["points"]
    error = below["model_error"] * below["force_ratio"]
    assert column_modulus(0.148) < 24131 < column_modulus(0.148 + error)
    assert point["model_error"] > error
    assert point["scale_high_Pa"] == pytest.approx(column_modulus(0.148 + point["model_error"]), rel=1e-6)


def test_an_interval_that_begins_beyond_the_price_list_gets_no_error_of_the_model(palpate: Palpate) -> None:
    (point,) = palpate(*PRICED, "--force-ratio", "0.13", "--uncertainty", "0.005").object["points"]
    assert point["scale_low_Pa"] < 14.9e3 < point["scale_high_Pa"]
    assert point["scale_high_Pa"] == pytest.approx(column_modulus(0.13 + 1.959963985 * 0.005), rel=1e-6)
    assert point["model_error"] is None


@pytest.mark.parametrize("model", ["auto", "surface", "column", "beam_exact"])
def test_the_absolute_interval_of_each_mean_of_the_thesis_holds_the_samples_modulus(
    palpate: Palpate, model: str
) -> None:
    means = get_design("single").thesis_force_ratio
    asked = ("model", "modulus", "--json", "--model", model, "--force-ratio", ",".join(map(str, means.values())))
    said = palpate(*asked).object
    line = said["validation_line"]
    assert (line["constant"], line["degrees_of_freedom"]) == (0.0, 6)
    for name, point in zip(means, said["points"], strict=True):
        low, high = point["absolute_low_Pa"] or 0.0, point["absolute_high_Pa"] or math.inf
        assert low < SAMPLES[name].modulus < high
        if point["modulus_Pa"] is not None:
            apart = point["absolute_u"] ** 2 - point["scale_u"] ** 2
            assert math.sqrt(apart) == pytest.approx(point["sensitivity"] * line["u"], rel=1e-9)


def test_the_absolute_interval_has_the_degrees_of_freedom_of_ratio_and_validation_together() -> None:
    question = RatioQuestion("single", "column")
    (point,), line = estimate(question, [0.31], 0.062, 3), validation_of(question, "column")
    assert line.u is not None
    together = math.hypot(0.2, line.u)
    known = together**4 / (0.2**4 / 3 + line.u**4 / 6)  # Welch and Satterthwaite
    reach = math.exp(together * scipy.stats.t.ppf(0.975, known))
    low, high = 0.31 / reach - point["curve_error"], 0.31 * reach + point["curve_error"]
    assert point["absolute_low_Pa"] == pytest.approx(column_modulus(low), rel=1e-5)
    assert point["absolute_high_Pa"] == pytest.approx(column_modulus(high), rel=1e-5)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (("--model", "experiment"), "the thesis' measurement itself, and moduli of its samples are known by catalogue"),
        (("--design", "single_round", "--model", "column"), "nothing was measured with design 'single_round'"),
        (("--model", "column", "--sensed-thickness", "5 mm"), "no experiment with other values of sensed_thickness"),
    ],
)
def test_where_no_validation_error_is_known_the_absolute_uncertainty_is_not_known(
    palpate: Palpate, asked: tuple[str, ...], why: str
) -> None:
    said = palpate("model", "modulus", "--json", "--force-ratio", "0.2", *asked).object
    (point,), line = said["points"], said["validation_line"]
    assert (line["u"], line["degrees_of_freedom"]) == (None, None)
    assert why in line["source"]
    assert {name: value for name, value in point.items() if name.startswith("absolute") and value is not None} == {}
    assert point["scale_u"] > 0
    told = palpate("model", "modulus", "--force-ratio", "0.2", *asked).out
    assert re.search(r"not known +not known", told)
    assert f"absolute       {line['source']}" in told


def test_a_setting_that_the_parameter_set_has_itself_changes_nothing(palpate: Palpate) -> None:
    own = palpate(*PRICED, "--force-ratio", "0.31").object
    given = palpate(*PRICED, "--force-ratio", "0.31", "--sensed-thickness", "3 mm").object
    assert given["validation_line"] == own["validation_line"]
    assert given["points"][0]["absolute_u"] is not None


def test_settings_reach_the_model(palpate: Palpate) -> None:
    wide = (*MODULUS, "--force-ratio", "0.3", "--uncertainty", "0")
    (own,) = palpate(*wide).object["points"]
    (given,) = palpate(*wide, "--compliant-modulus", "48 kPa", "--sensed-thickness", "6 mm").object["points"]
    assert given["modulus_Pa"] == pytest.approx(4 * own["modulus_Pa"], rel=1e-9)


def test_the_ratio_of_the_ratio_command_leads_back_to_its_modulus(palpate: Palpate) -> None:
    asked = ("--model", "surface", "--design", "single_round")
    (there,) = palpate("model", "ratio", "--json", *asked, "--sensed-modulus", "43 kPa").object["points"]
    ratio = f"{there['force_ratio']:.15f}"
    (back,) = palpate("model", "modulus", "--json", *asked, "--force-ratio", ratio).object["points"]
    assert back["modulus_Pa"] == pytest.approx(43e3, rel=1e-6)


def test_people_get_a_table(palpate: Palpate) -> None:
    asked = ("model", "modulus", "--model", "column", "--force-ratio", "0.31, 0.99", "--uncertainty", "0.001")
    said = palpate(*asked)
    assert (said.status, said.err) == (0, "")
    assert "single, model column: Young modulus" in said.out
    assert f"{column_modulus(0.31) / 1e3:.2f} kPa" in said.out
    assert re.search("at least .*1 % of the ratio", said.out, re.DOTALL)
    assert "absolute       validation error 17 % of the ratio (6 degrees of freedom): rms distance from" in said.out
    assert "only a bound   palpate test modulus tells more of such an object" in said.out


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--force-ratio", "0"), "force ratio 0 is not between 0 and 1"),
        (("--force-ratio", "0.3, 1"), "force ratio 1 is not between 0 and 1"),
        (("--force-ratio", "-0.1"), "force ratio -0.1 is not between 0 and 1"),
        (("--force-ratio", "31 %, 120 %"), "force ratio 1.2 is not between 0 and 1"),
        (("--force-ratio", "nan"), "'nan' is not a quantity"),
        (("--force-ratio", ""), "'' is not a quantity"),
        (("--force-ratio", "0.3,"), "'' is not a quantity"),
        (("--uncertainty", "-0.01"), "uncertainty -0.01 is below 0"),
        (("--uncertainty", "1e999"), "is not finite"),
        (("--model", "colum"), "did you mean 'column'?"),
        (("--design", "singel"), "did you mean 'single'?"),
        (("--parameters", "identified"), "unknown parameter set of model 'column' 'identified'"),
        (("--tolerance", "1e-4"), "model 'column' has no error estimate"),
        (("--sensed-thickness", "0 mm"), "'0 mm' is not above 0 and finite; give a positive one"),
        (("--model", "axisymmetric", "--design", "common_base"), "has 2 teeth, not one; take model 'solid'"),
        (("--model", "experiment", "--design", "array"), "nothing was measured with design 'array'"),
    ],
)
def test_bad_input_is_one_error_and_nothing_else(palpate: Palpate, wrong: tuple[str, ...], message: str) -> None:
    said = palpate(*changed((*PRICED, "--force-ratio", "0.3"), *wrong))
    assert said.status == 2
    assert message in said.complaint
    assert len(said.complaint.splitlines()) == 1


def test_no_number_in_json_is_infinite(palpate: Palpate) -> None:
    points = palpate(*MODULUS, "--force-ratio", "0.0801, 0.5, 0.999999", "--uncertainty", "0.3").object["points"]
    assert all(math.isfinite(value) for point in points for value in point.values() if isinstance(value, float))
    assert [point["kind"] for point in points] == ["at most", "any", "at least"]
