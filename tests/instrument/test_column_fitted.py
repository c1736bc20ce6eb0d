"""The thesis' three-dimensional tables in two numbers, held against the tables, the column, and a capped sensor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models import springs
from palpate.instrument.models.evidence import Evidence, of_model, ratio_by
from palpate.instrument.models.parameters import THESIS
from palpate.instrument.models.response import RatioQuestion, ask, response
from palpate.instrument.models.springs import HIGHEST, LINES, LOWEST, OddsLine
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Load, Sample, get_sample
from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.criterion import distance, fitted_line, odds_sentence

SINGLE = get_design("single")
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


def test_the_sentence_says_fitted_or_predicted_and_what_the_experiments_would_be() -> None:
    fitted = odds_sentence(read_table("A2.1"), "single")
    assert "fitted to this ring, to 9.8e-05" in fitted
    assert "objects 0.62 to 0.92 times as hard as the samples" in fitted
    predicted = odds_sentence(read_table("A2.2"), "single")
    assert predicted.endswith("fitted on the other ring, a prediction on this one, to 9.7e-05")


def test_the_column_has_the_same_law_with_numbers_from_its_areas_and_heights() -> None:
    start = SINGLE.tooth.area / SINGLE.ring.area
    line = OddsLine(start, start * SINGLE.ring.height / 3e-3, 0.0)
    for modulus in (14.9e3, 1e5, 1e8):
        ratio = springs.force_ratio(SINGLE, object_of(modulus))
        assert line.force_ratio(modulus / SINGLE.ring.material.modulus) == pytest.approx(ratio, rel=1e-12)


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
