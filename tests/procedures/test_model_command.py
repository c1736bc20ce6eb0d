"""What `palpate model ratio` answers, and what it refuses."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest

from instrument.designs import get_design
from instrument.models import axisymmetric, experiment, solid
from instrument.models.parameters import get_parameters
from instrument.models.ratio import DESIGN_MODELS, TOLERANCES, Question, ask
from instrument.sample import get_sample
from tests.procedures.conftest import Palpate

RATIO = ("model", "ratio", "--json")
COLUMN = (*RATIO, "--model", "column", "--sensed-modulus", "100 kPa")
# Degree 8 with 7 layers, in displacement-pressure and in plain displacement form: they differ by 1e-9.
CASE_A_RATIO = 0.4245278


def column(modulus: float, compliant: float = 24e3, thickness: float = 3e-3) -> float:
    """R = a (1 + λ) / (1 + a λ) for the thesis' radii."""
    share = 1.4**2 / (1.4**2 + 5**2 - 1.5**2)
    hardness = modulus * 3.88e-3 / (compliant * thickness)
    return share * (1 + hardness) / (1 + share * hardness)


# --- answers -------------------------------------------------------------------------------------------


def test_case_a_is_met_within_its_own_error_estimate(palpate: Palpate) -> None:
    (point,) = palpate(
        *RATIO, "--design", "single_round", "--parameters", "physical", "--sensed-modulus", "100 kPa",
        "--compliant-modulus", "24 kPa", "--model", "axisymmetric", "--tolerance", "1e-4",
    ).object["points"]  # fmt: skip
    assert abs(point["force_ratio"] - CASE_A_RATIO) <= point["error_estimate"] <= 1e-4
    assert point["model"] == "axisymmetric"
    assert point["seconds"] > 0


def test_the_column_is_its_closed_form_at_every_modulus_of_a_list(palpate: Palpate) -> None:
    said = palpate(*RATIO, "--model", "column", "--sensed-modulus", "14.9 kPa, 24 kPa,0.1 MPa, 140 GPa")
    points = said.object["points"]
    assert [point["sensed_modulus_Pa"] for point in points] == pytest.approx([14.9e3, 24e3, 1e5, 140e9], rel=1e-14)
    for point in points:
        assert point["force_ratio"] == pytest.approx(column(point["sensed_modulus_Pa"]), rel=1e-12)
        assert point["error_estimate"] is None


@pytest.mark.parametrize("design", ["single", "single_round", "common_base"])
def test_an_option_overrides_the_parameter_set(palpate: Palpate, design: str) -> None:
    wide = (*COLUMN, "--design", design, "--parameters", "thesis")
    (own,) = palpate(*wide).object["points"]
    (given,) = palpate(*wide, "--sensed-thickness", "2 mm", "--compliant-modulus", "33 kPa").object["points"]
    assert own["force_ratio"] == pytest.approx(column(1e5, thickness=0.55e-3), rel=1e-12)
    assert given["force_ratio"] == pytest.approx(column(1e5, 33e3, 2e-3), rel=1e-12)


def test_the_experiment_gives_the_measured_mean(palpate: Palpate) -> None:
    asked = (*RATIO, "--model", "experiment", "--design", "common_base", "--sensed-modulus", "41368.54 Pa")
    (point,) = palpate(*asked).object["points"]
    assert point["force_ratio"] == pytest.approx(0.164, rel=1e-12)


def test_every_option_reaches_the_finite_element_models(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {
        "sensed_thickness": 2e-3, "sensed_poisson": 0.45, "compliant_modulus": 33e3, "compliant_poisson": 0.48,
        "plate_modulus": 3e9, "interface": "frictionless",
    }  # fmt: skip
    seen: list[object] = []
    for module in (axisymmetric, solid):
        monkeypatch.setattr(module, "force_ratio", lambda *asked: seen.append(asked) or (0.5, 1e-9))
    expected: list[object] = []
    for parameters in ("thesis", "physical", "identified"):
        ask(Question("single_round", "axisymmetric", parameters, settings, 1e-5), [2e5])
        disc = replace(get_parameters(parameters), sensed_modulus=2e5, **settings)  # type: ignore[arg-type]
        expected.append((disc, 1e-5))
        ask(Question("common_base", "solid", parameters, settings), [2e5])
        pair = get_design("common_base")
        block = solid.identified(pair) if parameters == "identified" else solid.of_design(pair)
        expected.append((replace(block, sensed_modulus=2e5, **settings), TOLERANCES["solid"]))  # type: ignore[arg-type]
    assert seen == expected


def test_the_identified_set_of_the_solid_model_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solid, "force_ratio", lambda parameters, _: (parameters.sensed_thickness, 0.0))
    (answer,) = ask(Question("common_base", "solid", "identified"), [1e5])
    assert answer.force_ratio == 3.6e-3
    (answer,) = ask(Question("common_base", "solid", "thesis"), [1e5])
    assert answer.force_ratio == 0.55e-3


def test_json_is_one_object_and_nothing_else(palpate: Palpate) -> None:
    said = palpate(*COLUMN, "--quiet")
    assert (said.err, said.out) == ("", json.dumps(said.object, indent=2) + "\n")
    assert list(said.object) == ["design", "parameters", "points"]
    (point,) = said.object["points"]
    assert list(point) == ["sensed_modulus_Pa", "force_ratio", "error_estimate", "model", "seconds"]


def test_people_get_a_table_and_quiet_says_nothing(palpate: Palpate) -> None:
    asked = ("model", "ratio", "--model", "column", "--sensed-modulus", "14.9 kPa, 100 kPa")
    said = palpate(*asked)
    assert (said.status, said.err) == (0, "")
    assert "single, model column" in said.out
    assert "14.9 kPa" in said.out
    assert f"{column(1e5):.7g}" in said.out
    quiet = palpate(*asked, "--quiet")
    assert (quiet.status, quiet.out, quiet.err) == (0, "", "")


# --- bad input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--sensed-modulus", "0 Pa"), "sensed_modulus 0 Pa is not above 0"),
        (("--sensed-modulus", "24 kPa, -1 kPa"), "sensed_modulus -1000 Pa is not above 0"),
        (("--sensed-modulus", "24"), "'24' has no unit where Pa belongs"),
        (("--sensed-modulus", "24 kPa,"), "'' is not a quantity"),
        (("--sensed-modulus", "1e999 Pa"), "is not finite"),
        (("--sensed-thickness", "3 N"), "is in N where m belongs"),
        (("--sensed-thickness", "0 mm"), "sensed_thickness 0 m is not above 0"),
        (("--sensed-poisson", "0.51"), "sensed_poisson 0.51 is outside (-1, 0.5]"),
        (("--compliant-poisson", "-1"), "compliant_poisson -1 is outside (-1, 0.5]"),
        (("--compliant-modulus", "-24 kPa"), "compliant_modulus -24000 Pa is not above 0"),
        (("--plate-modulus", "0 GPa"), "plate_modulus 0 Pa is not above 0"),
        (("--interface", "glued"), "unknown interface 'glued'; valid: bonded, frictionless"),
        (("--parameters", "fysical"), "did you mean 'physical'?"),
        (("--parameters", "identified"), "unknown parameter set of model 'column' 'identified'"),
        (("--design", "singel"), "did you mean 'single'?"),
        (("--model", "colum"), "did you mean 'column'?"),
        (("--tolerance", "1e-4"), "model 'column' has no error estimate"),
        (("--model", "axisymmetric", "--tolerance", "0"), "tolerance 0 is not above 0"),
        (("--model", "axisymmetric", "--design", "common_base"), "unknown model of design 'common_base'"),
        (("--model", "solid", "--design", "single_round"), "valid: axisymmetric, column"),
        (("--model", "solid", "--tolerance", "-1"), "tolerance -1 is not above 0"),
        (("--model", "experiment", "--sensed-modulus", "1 MPa"), "is outside the measured"),
        (
            ("--model", "experiment", "--plate-modulus", "3 GPa"),
            "plate_modulus 3000000000.0: model 'experiment' has its own",
        ),
        (("--model", "beam_printed", "--sensed-thickness", "3 mm"), "model 'beam_printed' has its own"),
    ],
)
def test_bad_input_is_one_error_and_nothing_else(palpate: Palpate, wrong: tuple[str, ...], message: str) -> None:
    said = palpate(*COLUMN, *wrong)
    assert said.status == 2
    assert message in said.complaint
    assert len(said.complaint.splitlines()) == 1


def test_a_tolerance_that_the_model_cannot_meet_is_refused_with_the_best_there_is(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(axisymmetric, "REFINEMENTS", (1, 2))
    cheap = ("--parameters", "identified", "--model", "axisymmetric", "--tolerance", "1e-13")
    said = palpate(*RATIO, *cheap, "--sensed-modulus", "100 kPa")
    assert said.status == 2
    assert "model 'axisymmetric' cannot answer to 1e-13: its best here is" in said.complaint


def test_a_question_without_a_modulus_is_refused(palpate: Palpate) -> None:
    said = palpate("model", "ratio")
    assert (said.status, said.out) == (2, "")
    assert "Missing option '--sensed-modulus'" in said.err


def test_every_model_that_a_design_has_can_be_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (axisymmetric, solid):
        monkeypatch.setattr(module, "force_ratio", lambda *_: (0.5, 1e-9))
    for design, models in DESIGN_MODELS.items():
        for model in models:
            (answer,) = ask(Question(design, model), [5e4])
            assert 0 < answer.force_ratio < 1
            assert (answer.error_estimate is None) == (model not in TOLERANCES)
            assert math.isfinite(answer.seconds)


def test_a_design_that_was_never_measured_has_no_experiment() -> None:
    with pytest.raises(ValueError, match="nothing was measured with design 'array'"):
        experiment.force_ratio(get_design("array"), get_sample("2"))
