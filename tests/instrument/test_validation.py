"""The distance of each model from the experiments of the thesis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest

from palpate.instrument.errors import ConfigError, UnknownName
from palpate.instrument.models import price_list, validation
from palpate.instrument.models import response as registry
from palpate.instrument.models.parameters import PHYSICAL, get_parameter_set
from palpate.instrument.models.response import response
from palpate.instrument.models.table import MODELS, Model, Response
from palpate.instrument.models.validation import validate, validate_all
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.sensor.sample import SAMPLES, Load

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
