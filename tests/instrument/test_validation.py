"""The distance of each model from the experiments of the thesis, and what a match with them is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest

from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.models import price_list, validation
from palpate.instrument.models import response as registry
from palpate.instrument.models.evidence import GIVEN, REPEATS, Evidence, EvidencePart, of_experiment, of_model, ratio_by
from palpate.instrument.models.parameters import PHYSICAL, get_parameter_set
from palpate.instrument.models.response import response
from palpate.instrument.models.table import MODELS, Model, Response
from palpate.instrument.models.validation import validate, validate_all
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.sensor.sample import SAMPLES, Load
from palpate.instrument.thesis import COMMON_BASE_TABLES, SINGLE_TABLES

Found = validation.Validation


def test_the_distance_is_the_model_less_the_measurement_in_percent_of_the_measurement() -> None:
    found = validate("single", "physical", "column")
    for name, measured in {"1": 0.314, "2": 0.142, "6": 0.276}.items():
        ratio = response(get_design("single"), PHYSICAL.load(SAMPLES[name].modulus), "column").force_ratio
        assert found.percent[name] == pytest.approx(100 * (ratio - measured) / measured)
    assert found.percent["1"] > 0  # 0.379 against 0.314


def test_mean_keeps_the_sign_and_rms_and_worst_count_both_sides() -> None:
    found = Found("single", "physical", "column", "compared", percent={"1": 3.0, "2": -5.0})
    assert (found.mean, found.rms, found.worst, found.worst_sample) == (-1.0, 17**0.5, -5.0, "2")


def test_what_is_given_the_measurement_is_called_input_and_has_no_distance() -> None:
    for design in validation.measured_designs():
        found = validate(design, "physical", "experiment")
        assert (found.kind, found.percent, found.mean, found.rms, found.worst) == ("input", {}, None, None, None)


def test_a_design_without_experiments_says_so() -> None:
    unmeasured = [name for name, design in DESIGNS.items() if not design.thesis_force_ratio]
    assert set(unmeasured) >= {"single_round", "array"}
    for design in unmeasured:
        found = validate(design, "physical", "column")
        assert (found.kind, found.rms) == ("none", None) and design in found.why


def test_every_model_of_the_registry_is_judged_and_nothing_that_is_kept_is_stale() -> None:
    found = validate_all(list(DESIGNS))
    assert {each.model for each in found} == set(MODELS)
    for each in found:
        assert validation.RENEW not in each.why
        assert (each.kind == "compared") == (not each.why)
    refused = {(each.design, each.model) for each in found if each.kind == "none" and "teeth" in each.why}
    assert refused == {("common_base", "axisymmetric"), ("different_base", "axisymmetric")}


def test_a_new_model_is_judged_without_being_listed_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    def half(design: Design, loads: Sequence[Load], tolerance: float | None) -> list[Response]:
        return [replace(response(design, load, "column"), force_ratio=0.5) for load in loads]

    more = MappingProxyType({**MODELS, "half": Model(half)})
    monkeypatch.setattr(registry, "MODELS", more)
    monkeypatch.setattr(validation, "MODELS", more)
    found = {each.model: each for each in validate_all(["single"])}["half"]
    assert found.percent["1"] == pytest.approx(100 * (0.5 / 0.314 - 1))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "parameters", "model"),
    [
        ("single", "identified", "axisymmetric"), ("single", "physical", "solid"),
    ],
)  # fmt: skip
def test_a_kept_answer_is_the_models_own_now(design: str, parameters: str, model: str) -> None:
    """Only the softest sample is solved, as all of them take minutes."""
    chosen = get_parameter_set(parameters, model)
    sensor, load = chosen.design(get_design(design)), chosen.load(SAMPLES["2"].modulus)
    ratio = response(sensor, load, model, validation.TOLERANCE).force_ratio
    assert validation.kept(design, parameters, model)["2"] == pytest.approx(ratio, rel=1e-6)


def test_what_was_kept_for_other_code_is_not_taken_for_todays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(price_list, "CODE_VERSION", 10**6)
    found = validate("single", "physical", "solid")
    assert (found.kind, found.percent) == ("none", {})
    assert "palpate model validation --store" in found.why


def test_a_damaged_list_and_unknown_names_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownName, match="unknown model 'colum'"):
        validate("single", "physical", "colum")
    with pytest.raises(UnknownName, match="unknown parameter set 'fysical'"):
        validate("single", "fysical", "column")
    monkeypatch.setattr(validation, "STORED", tmp_path / "validation.json")
    validation.stored.cache_clear()
    try:
        short = (
            '{"design": "single", "parameters": "physical", "model": "solid", "fingerprint": "", "force_ratios": {}}'
        )
        for text in (None, "[", f'{{"format": 1, "answers": [{short}]}}', '{"format": 2, "answers": []}'):
            if text is not None:
                validation.STORED.write_text(text, encoding="utf-8")
            with pytest.raises(ConfigError, match="palpate model validation --store"):
                validate("single", "physical", "solid")
    finally:
        validation.stored.cache_clear()


# --- What a match with the thesis is worth follows from what went into ours ----------------------------

INPUT, FITTED, PREDICTED = Evidence
RATIO, FORCE, VOLTAGE = "force_ratio", "force_rigid_N", "voltage_pvdf2_V"
LOADS = ("force_total_N", "pvdf1_total_mV", "force2_total_left_N", "pvdf4_total_right_mV")
ALL = [(table,) for table in (*REPEATS, *REPEATS.values(), "A2.7")]
EXPERIMENTS = (*SINGLE_TABLES.values(), *COMMON_BASE_TABLES.values(), "5.5", "5.6", "5.7")


@pytest.mark.parametrize(
    ("ratio", "quantities", "expected"),
    [
        (
            ratio_by("experiment"),
            (RATIO, FORCE, "pvdf2_rigid_mV", "pvdf3_total_mV", "force_total_N", "meter_reading_mV"),
            INPUT,
        ),
        (ratio_by("axisymmetric", "identified"), (*LOADS, "meter_reading_mV"), INPUT),
        (ratio_by("solid", "physical"), (*LOADS, "meter_reading_mV"), INPUT),
        (ratio_by("axisymmetric", "identified"), (RATIO, FORCE, "pvdf2_rigid_mV", "pvdf2_mV", "force1_N"), PREDICTED),
        (ratio_by("solid", "physical"), (RATIO, FORCE, "pvdf2_rigid_mV", "pvdf2_mV", "force1_N"), PREDICTED),
    ],
)
def test_a_bench_hands_back_the_means_it_was_given_and_else_predicts_all_but_load_and_meter(
    ratio: EvidencePart, quantities: tuple[str, ...], expected: Evidence
) -> None:
    assert {of_experiment(each, ratio, table) for table in EXPERIMENTS for each in quantities} == {expected}


FITS = ("A2.3", "4.5", "A2.5", "4.3")
OTHERS = ("A2.2", "A2.4", "A2.6", "4.2", "4.4", "4.6", "A2.7")


@pytest.mark.parametrize(
    ("quantity", "ratio", "tables", "expected"),
    [
        (FORCE, ratio_by("axisymmetric", "identified"), [("A2.1",), ("4.1",)], FITTED),
        (FORCE, ratio_by("axisymmetric", "identified"), [(each,) for each in (*FITS, *OTHERS)], PREDICTED),
        (FORCE, ratio_by("solid", "identified"), [(each,) for each in ("A2.1", "4.1", *FITS)], FITTED),
        (FORCE, ratio_by("solid", "identified"), [(each,) for each in OTHERS], PREDICTED),
        (FORCE, ratio_by("solid", "physical"), ALL, PREDICTED),
        (VOLTAGE, ratio_by("solid", "identified"), ALL, PREDICTED),  # the material's, whatever the ratio
        (VOLTAGE, GIVEN, ALL, PREDICTED),
        ("single_vs_2D", ratio_by("beam"), [("5.8",)], FITTED),  # its lengths were chosen for this table
        ("single_vs_2D", ratio_by("beam_printed"), [("5.8",)], PREDICTED),
        ("single_vs_3D", ratio_by("axisymmetric", "identified"), [("5.8", "A2.1")], FITTED),
        ("different_base_vs_3D", ratio_by("solid", "identified"), [("5.8", "A2.5")], FITTED),
        (RATIO, ratio_by("beam"), [("A2.1",)], PREDICTED),
    ],
)
def test_a_model_is_fitted_to_the_tables_of_its_set_and_what_they_repeat_and_predicts_the_rest(
    quantity: str, ratio: EvidencePart, tables: list[tuple[str, ...]], expected: Evidence
) -> None:
    assert {of_model(quantity, ratio, *table) for table in tables} == {expected}


def test_every_model_of_the_registry_has_a_class_and_an_unknown_set_is_refused() -> None:
    assert {of_experiment(RATIO, ratio_by(model), "A2.9") for model in MODELS if model != "experiment"} == {PREDICTED}
    with pytest.raises(UnknownName, match="unknown parameter set 'fitted'"):
        ratio_by("solid", "fitted")
