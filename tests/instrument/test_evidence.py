"""What a match with the thesis is worth follows from what went into ours."""

from __future__ import annotations

import pytest

from palpate.instrument.errors import UnknownName
from palpate.instrument.models.evidence import GIVEN, REPEATS, Evidence, of_experiment, of_model, ratio_by
from palpate.instrument.models.table import MODELS
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES

INPUT, FITTED, PREDICTED = Evidence
RATIO, FORCE, VOLTAGE = "force_ratio", "force_rigid_N", "voltage_pvdf2_V"
EXPERIMENTS = (*SINGLE_TABLES.values(), *COMMON_BASE_TABLES.values(), "5.5", "5.6", "5.7")


def test_a_bench_that_was_given_the_thesis_means_hands_them_back() -> None:
    for table in EXPERIMENTS:
        for quantity in (RATIO, FORCE, "pvdf2_rigid_mV", "pvdf3_total_mV", "force_total_N", "meter_reading_mV"):
            assert of_experiment(quantity, ratio_by("experiment"), table) is INPUT


@pytest.mark.parametrize(("model", "parameters"), [("axisymmetric", "identified"), ("solid", "physical")])
def test_what_a_bench_without_the_means_gives_is_predicted_but_for_load_and_meter(model: str, parameters: str) -> None:
    ratio = ratio_by(model, parameters)
    given = ("meter_reading_mV", "force_total_N", "pvdf1_total_mV", "force2_total_left_N", "pvdf4_total_right_mV")
    tested = (RATIO, FORCE, "pvdf2_rigid_mV", "pvdf2_mV", "force1_N")
    for table in EXPERIMENTS:
        assert {of_experiment(quantity, ratio, table) for quantity in given} == {INPUT}
        assert {of_experiment(quantity, ratio, table) for quantity in tested} == {PREDICTED}


def test_a_set_is_fitted_to_its_tables_and_what_they_repeat_and_predicts_the_rest() -> None:
    one, both = ratio_by("axisymmetric", "identified"), ratio_by("solid", "identified")
    expected = {
        "A2.1": (FITTED, FITTED), "4.1": (FITTED, FITTED),
        **dict.fromkeys(("A2.3", "4.5", "A2.5", "4.3"), (PREDICTED, FITTED)),
        **dict.fromkeys(("A2.2", "A2.4", "A2.6", "4.2", "4.4", "4.6", "A2.7"), (PREDICTED, PREDICTED)),
    }  # fmt: skip
    assert {table: (of_model(FORCE, one, table), of_model(FORCE, both, table)) for table in expected} == expected
    assert set(REPEATS) < set(expected)


def test_physical_parameters_predict_everywhere_and_a_voltage_is_the_material_s_whatever_the_ratio() -> None:
    for table in (*REPEATS, *REPEATS.values(), "A2.7"):
        assert of_model(FORCE, ratio_by("solid", "physical"), table) is PREDICTED
        assert of_model(VOLTAGE, ratio_by("solid", "identified"), table) is PREDICTED
        assert of_model(VOLTAGE, GIVEN, table) is PREDICTED


def test_the_lengths_of_the_corrected_beam_were_chosen_for_table_5_8() -> None:
    assert of_model("single_vs_2D", ratio_by("beam"), "5.8") is FITTED
    assert of_model("single_vs_2D", ratio_by("beam_printed"), "5.8") is PREDICTED
    assert of_model("single_vs_3D", ratio_by("axisymmetric", "identified"), "5.8", "A2.1") is FITTED
    assert of_model("different_base_vs_3D", ratio_by("solid", "identified"), "5.8", "A2.5") is FITTED
    assert of_model(RATIO, ratio_by("beam"), "A2.1") is PREDICTED


def test_every_model_of_the_registry_has_a_class_and_an_unknown_set_is_refused() -> None:
    assert {of_experiment(RATIO, ratio_by(model), "A2.9") for model in MODELS if model != "experiment"} == {PREDICTED}
    with pytest.raises(UnknownName, match="unknown parameter set 'fitted'"):
        ratio_by("solid", "fitted")
