"""Closed forms and the experiment as models, and the thesis' three-dimensional tables in two numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models import springs
from palpate.instrument.models.evidence import Evidence, of_model, ratio_by
from palpate.instrument.models.parameters import THESIS
from palpate.instrument.models.response import RatioQuestion, ask, response
from palpate.instrument.models.springs import HIGHEST, LINES, LOWEST, OddsLine
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, Load, Sample, get_sample
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.criterion import distance, fitted_line

SINGLE = get_design("single")
AREA_SHARE = 1.4**2 / (1.4**2 + 5.0**2 - 1.5**2)


def rubber(modulus: float, thickness: float = 3e-3) -> Sample:
    return replace(get_sample("2"), name="trial", modulus=modulus, thickness=thickness)


def ratio(sensed: Sample, model: str) -> float:
    return response(SINGLE, Load(force=3.0, sensed=sensed), model).force_ratio


def test_the_column_takes_an_array_of_moduli() -> None:
    moduli = np.array([[1.49e4, 3e4, 1e6], [1e7, 140e6, 140e9]])
    expected = [[springs.ratio_of_modulus(SINGLE, float(m), 3e-3) for m in row] for row in moduli]
    np.testing.assert_array_equal(springs.ratio_of_modulus(SINGLE, moduli, 3e-3), expected)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_the_column_refuses_an_array_with_one_bad_modulus(bad: float) -> None:
    with pytest.raises(RangeError, match="modulus"):
        springs.ratio_of_modulus(SINGLE, np.array([1e4, bad]), 3e-3)
    with pytest.raises(RangeError, match="thickness"):
        springs.ratio_of_modulus(SINGLE, 1e4, bad)


@pytest.mark.parametrize(("modulus", "thickness"), [(24131.65, 3e-3), (112609.9, 3e-3), (7.5e6, 0.55e-3)])
def test_the_stack_is_the_tooth_column_beside_the_ring_column(modulus: float, thickness: float) -> None:
    object_per_area, ring_per_area = modulus / thickness, 24e3 / 3.88e-3
    tooth = 1.4e-3**2 * math.pi * object_per_area
    ring = (5e-3**2 - 1.5e-3**2) * math.pi / (1 / object_per_area + 1 / ring_per_area)
    answer = response(SINGLE, Load(force=3.0, sensed=rubber(modulus, thickness)), "column")
    assert (answer.stiffness, answer.force_ratio) == pytest.approx((tooth + ring, tooth / (tooth + ring)), rel=1e-12)


def test_the_experiment_has_no_step_at_a_sample() -> None:
    for name, measured in SINGLE.thesis_force_ratio.items():
        towards_the_others = 1e-9 if name != "1" else -1e-9  # the hardest
        beside = rubber(get_sample(name).modulus * (1 + towards_the_others))
        assert ratio(beside, "experiment") == pytest.approx(measured, rel=1e-7)


def test_the_experiment_rises_with_the_modulus_between_the_samples() -> None:
    moduli = np.geomspace(24131.65, 112609.9, 500)[1:-1]
    assert np.all(np.diff([ratio(rubber(m), "experiment") for m in moduli]) > 0)


@pytest.mark.parametrize(
    ("modulus", "thickness", "message"),
    [
        (24131.0, 3e-3, r"outside the measured 24.13165 kPa to 112.6099 kPa"),
        (112610.0, 3e-3, r"outside the measured 24.13165 kPa to 112.6099 kPa"),
        (30e3, 4.7e-3, r"thickness 4.7 mm .* measured 3 mm"),
    ],
)
def test_the_experiment_does_not_extrapolate(modulus: float, thickness: float, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        ratio(rubber(modulus, thickness), "experiment")


@pytest.mark.parametrize("model", sorted(MODELS.keys() - {"axisymmetric", "solid"}))
def test_every_model_puts_the_samples_in_the_order_of_the_thesis(model: str) -> None:
    order = sorted(SAMPLES, key=lambda name: -ratio(get_sample(name), model))
    assert tuple(order) == SINGLE.thesis_softness_order


@pytest.mark.parametrize("model", sorted(MODELS.keys() - {"axisymmetric", "solid"}))
def test_forces_are_proportional_to_the_load_and_in_their_ratio(model: str) -> None:
    one, four = (response(SINGLE, Load(force=force, sensed=get_sample("3")), model) for force in (1.0, 4.0))
    assert four.force_total == pytest.approx(4.0, rel=1e-11)  # a sum of poles rounds
    assert four.force_rigid == pytest.approx(4 * one.force_rigid, rel=1e-14)
    assert four.force_rigid / four.force_total == pytest.approx(four.force_ratio, rel=1e-14)
    assert four.stiffness == one.stiffness > 0


@pytest.mark.parametrize("force", [0.0, -1.0, math.nan, math.inf])
def test_a_load_is_positive_and_finite(force: float) -> None:
    with pytest.raises(RangeError, match=r"load .* N is not above 0"):
        Load(force=force, sensed=get_sample("1"))


# --- The thesis' three-dimensional tables in two numbers, held against the tables, the column, and a capped sensor

# Fitted to the first ring's table, held against the second's.
TABLES = {"single": ("A2.1", "A2.2"), "common_base": ("A2.3", "A2.4"), "different_base": ("A2.5", "A2.6")}


def object_of(modulus: float, thickness: float = 3e-3) -> Sample:
    return replace(get_sample("1"), modulus=modulus, thickness=thickness)


@pytest.mark.parametrize("design", TABLES)
def test_the_stored_numbers_are_those_of_a_fit_to_the_softer_ring_and_predict_the_stiffer_one(design: str) -> None:
    line, (fitted, predicted) = LINES[design], TABLES[design]
    own = fitted_line(read_table("A2.3" if design == "different_base" else fitted))  # A2.5 is its copy
    assert (line.start, line.slope) == pytest.approx((own.start, own.slope), abs=6e-6)
    worst = [distance(line, read_table(number)) for number in (fitted, predicted)]
    assert max(worst) <= line.residual < 1.06 * max(worst)
    model = ratio_by("column_fitted")
    assert of_model("force_ratio", model, fitted) is Evidence.FITTED
    assert of_model("force_ratio", model, predicted) is Evidence.PREDICTED


@pytest.mark.parametrize("line", LINES.values())
def test_the_inverse_gives_the_modulus_back_from_the_softest_object_to_the_hardest(line: OddsLine) -> None:
    for modulus in (0.0, 1e-9, LOWEST, 1.0, 1e3, HIGHEST):
        back = line.modulus_ratio(line.force_ratio(modulus))
        assert back == pytest.approx(modulus, rel=1e-9 if modulus else 0, abs=1e-14)
    assert line.force_ratio(0.0) == pytest.approx(line.start / (1 + line.start), rel=1e-15)
    assert 1 - line.force_ratio(1e14) == pytest.approx(1e-14 / line.slope, rel=0.01)
    assert line.force_ratio(1e308) == 1.0
    for ratio in (line.force_ratio(0.0) * 0.999, 1.0, float("nan")):
        with pytest.raises(RangeError, match="no object has it"):
            line.modulus_ratio(ratio)


def test_it_answers_with_its_residual_and_on_any_ring() -> None:
    for ring in (24e3, 33e3):
        (answer,) = ask(RatioQuestion("single", "column_fitted", settings={"compliant_modulus": ring}), [95.4e3])
        relative = LINES["single"].residual / answer.response.force_ratio
        assert answer.response.error_estimate == pytest.approx(relative)
        assert answer.response.force_ratio == LINES["single"].force_ratio(95.4e3 / ring)
    assert answer.response.force_ratio == pytest.approx(0.2727, abs=1e-4)  # Table A2.2
    pair = response(get_design("common_base"), Load(2.0, object_of(95.4e3)), "column_fitted")
    assert pair.tooth_forces == pytest.approx((0.2058, 0.2058), abs=2e-4)  # Table A2.3, twice the load


@pytest.mark.parametrize(
    ("design", "sensed", "message"),
    [
        (get_design("single_round"), object_of(1e5), "has no table in the thesis that model 'column_fitted' could"),
        (get_design("array"), object_of(1e5), "take model 'column', or one of single, common_base"),
        (replace(SINGLE, tooth=replace(SINGLE.tooth, radius=1.3e-3)), object_of(1e5), "with its dimensions, has no"),
        (SINGLE, object_of(1e4), "is 0.417 times the ring's: the tables behind model 'column_fitted' have 0.452 to"),
        (SINGLE, object_of(1e12), "have 0.452 to 5.83e"),
        (SINGLE, object_of(1e5, thickness=4.7e-3), "have one thickness"),
        (SINGLE, THESIS.load(1e5).sensed, "thickness 0.00055 m of sample 'sensed object'"),
    ],
)
def test_what_has_no_table_is_refused(design: Design, sensed: Sample, message: str) -> None:
    with pytest.raises(RangeError, match=message):
        springs.fitted_force_ratio(design, sensed)


def test_what_it_has_no_place_for_is_refused_by_name() -> None:
    for name, value in (("sensed_thickness", 3e-3), ("interface", "bonded"), ("plate_modulus", 3e9)):
        with pytest.raises(RangeError, match=f"{name} .*: model 'column_fitted' always takes its own"):
            RatioQuestion("single", "column_fitted", settings={name: value})
    with pytest.raises(UnknownName, match="identified"):
        RatioQuestion("single", "column_fitted", "identified")


def test_the_samples_of_the_thesis_are_all_within_its_tables() -> None:
    for design in TABLES:
        ratios = [
            springs.fitted_force_ratio(get_design(design), get_sample(name)) for name in ("2", "5", "3", "4", "6", "1")
        ]
        assert np.all(np.diff(ratios) > 0)
