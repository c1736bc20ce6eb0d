"""What `palpate model ratio` answers, and what it refuses."""

from __future__ import annotations

import functools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import (
    RoundParameters,
    SolidParameters,
    get_parameter_set,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.response import RatioQuestion, ask
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.designs import get_design
from tests.procedures.conftest import Palpate, changed

RATIO = ("model", "ratio", "--json")
COLUMN = (*RATIO, "--model", "column", "--sensed-modulus", "100 kPa")
# Degree 8 with 7 layers, in displacement-pressure and in plain displacement form: they differ by 1e-9.
CASE_A_RATIO = 0.4245278
LATTICE = ("columns", "rows", "separate_bases")


def column(modulus: float, compliant: float = 24e3, thickness: float = 3e-3) -> float:
    """R = a (1 + λ) / (1 + a λ) for the thesis' radii."""
    share = 1.4**2 / (1.4**2 + 5**2 - 1.5**2)
    hardness = modulus * 3.88e-3 / (compliant * thickness)
    return share * (1 + hardness) / (1 + share * hardness)


@functools.cache
def coarsest(module: Any, parameters: RoundParameters | SolidParameters) -> object:
    return module.solve(parameters, 1 if module is axisymmetric else 0)


def solve_nothing(monkeypatch: pytest.MonkeyPatch, seen: list[tuple[RoundParameters | SolidParameters, float]]) -> None:
    """The finite-element models answer for one sensor of so many teeth; `seen` gets what they are asked."""
    for module in (axisymmetric, solid):

        def ladder(parameters: Any, module: Any = module) -> SimpleNamespace:
            def solve_at(moduli: Any, tolerance: float) -> list[tuple[object, float]]:
                seen.append((parameters, tolerance))
                teeth = {name: getattr(parameters, name) for name in LATTICE if hasattr(parameters, name)}
                found = coarsest(module, type(parameters)(support="rigid", interface="frictionless", **teeth))
                return [(found, 1e-9)] * len(moduli)

            return SimpleNamespace(solve_at=solve_at)

        monkeypatch.setattr(module, "ladder", ladder)


# --- answers -------------------------------------------------------------------------------------------


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


def test_what_a_closed_form_leaves_out_is_told_where_it_is_priced_and_nowhere_else(palpate: Palpate) -> None:
    points = palpate(*changed(COLUMN, "--sensed-modulus", "24.2 kPa, 100 kPa, 10 kPa")).object["points"]
    known = palpate(*RATIO, "--model", "surface", "--sensed-modulus", "24.2 kPa, 100 kPa").object["points"]
    errors = [point["model_error"] for point in points]
    apart = [points[i]["force_ratio"] * errors[i] for i in (0, 1)]  # the same part of the price list's interval
    assert apart[0] == pytest.approx(apart[1]) and errors[2] is None
    for column, surface in zip(points, known, strict=False):
        assert 0.5 * apart[0] < abs(column["force_ratio"] - surface["force_ratio"]) <= apart[0]
    for other in (("--compliant-modulus", "33 kPa"), ("--parameters", "thesis")):
        (point,) = palpate(*COLUMN, *other).object["points"]
        assert point["model_error"] is None
    assert (
        f"± {100 * errors[1]:.2g} %"
        in palpate("model", "ratio", "--model", "column", "--sensed-modulus", "100 kPa").out
    )


def test_the_experiment_gives_the_measured_mean(palpate: Palpate) -> None:
    asked = (*RATIO, "--model", "experiment", "--design", "common_base", "--sensed-modulus", "41368.54 Pa")
    (point,) = palpate(*asked).object["points"]
    assert point["force_ratio"] == pytest.approx(0.164, rel=1e-12)
    assert point["model_error"] is None  # it answers to no model


def test_every_option_reaches_the_finite_element_models(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {
        "sensed_thickness": 2e-3, "sensed_poisson": 0.45, "compliant_modulus": 33e3, "compliant_poisson": 0.48,
        "plate_modulus": 3e9, "interface": "frictionless",
    }  # fmt: skip
    seen: list[tuple[RoundParameters | SolidParameters, float]] = []
    solve_nothing(monkeypatch, seen)
    for parameters in ("thesis", "physical", "identified"):
        for design, model, of in (
            ("single_round", "axisymmetric", round_parameters),
            ("common_base", "solid", solid_parameters),
        ):
            list(ask(RatioQuestion(design, model, parameters, settings, 1e-5), [2e5]))
            own = get_parameter_set(parameters, model)
            expected = replace(of(own.design(get_design(design)), own.load(2e5)), **settings)  # type: ignore[operator]
            assert seen.pop() == (expected, 1e-5)


def test_the_identified_set_of_the_solid_model_is_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[RoundParameters | SolidParameters, float]] = []
    solve_nothing(monkeypatch, seen)
    list(ask(RatioQuestion("common_base", "solid", "identified"), [1e5]))
    list(ask(RatioQuestion("common_base", "solid", "thesis"), [1e5]))
    list(ask(RatioQuestion("single", "axisymmetric", "identified"), [1e5]))
    assert [asked.sensed_thickness for asked, _ in seen] == [3.6e-3, 0.55e-3, 2.01e-3]
    assert [asked.support for asked, _ in seen] == ["rigid", "elastic", "rigid"]


def test_square_plates_are_discs_to_the_axisymmetric_model(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[RoundParameters | SolidParameters, float]] = []
    solve_nothing(monkeypatch, seen)
    for design in ("single", "single_round"):
        list(ask(RatioQuestion(design, "axisymmetric"), [1e5]))
    assert [asked for asked, _ in seen] == [RoundParameters(), RoundParameters()]


def test_a_force_in_one_point_is_the_solid_models(palpate: Palpate, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[RoundParameters | SolidParameters, float]] = []
    solve_nothing(monkeypatch, seen)
    said = palpate(*RATIO, "--design", "common_base", "--sensed-modulus", "100 kPa", "--at", "7.5 mm, 6 mm").object
    ((asked, _),) = seen
    assert isinstance(asked, SolidParameters) and asked.load_at == pytest.approx((7.5e-3, 6e-3))
    assert said["at_m"] == list(asked.load_at) and said["points"][0]["model"] == "solid"


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
        (("--sensed-modulus", "0 Pa"), "--sensed-modulus: '0 Pa' is not above 0"),
        (("--sensed-modulus", "24 kPa, -1 kPa"), "--sensed-modulus: '-1 kPa' is not above 0"),
        (("--sensed-modulus", "24"), "'24' has no unit where Pa belongs"),
        (("--sensed-modulus", "24 kPa,"), "'' is not a quantity"),
        (("--sensed-modulus", "1e999 Pa"), "is not finite"),
        (("--sensed-thickness", "3 N"), "is in N where m belongs"),
        (("--sensed-thickness", "0 mm"), "--sensed-thickness: '0 mm' is not above 0"),
        (("--sensed-poisson", "0.51"), "Poisson ratio 0.51 of sample 'sensed object' is not above -1 and at most 0.5"),
        (("--compliant-poisson", "-1"), "Poisson ratio -1 of neoprene of the compliant ring is outside (-1, 0.5]"),
        (("--compliant-modulus", "-24 kPa"), "--compliant-modulus: '-24 kPa' is not above 0"),
        (("--plate-modulus", "0 GPa"), "--plate-modulus: '0 GPa' is not above 0"),
        (("--interface", "glued"), "unknown interface 'glued'; valid: bonded, capped, frictionless"),
        (("--parameters", "fysical"), "did you mean 'physical'?"),
        (("--parameters", "identified"), "unknown parameter set of model 'column' 'identified'"),
        (("--design", "singel"), "did you mean 'single'?"),
        (("--model", "colum"), "did you mean 'column'?"),
        (("--tolerance", "1e-4"), "model 'column' has no error estimate"),
        (("--model", "axisymmetric", "--tolerance", "5"), "--tolerance: '5' is 500 %, above the 50 %"),
        (("--model", "axisymmetric", "--tolerance", "0"), "--tolerance: '0' is not above 0"),
        (
            ("--model", "axisymmetric", "--design", "common_base"),
            "design 'common_base' has 2 teeth, not one; take model 'solid'",
        ),
        (("--model", "solid", "--tolerance", "-1"), "--tolerance: '-1' is not above 0"),
        (("--model", "experiment", "--sensed-modulus", "1 MPa"), "is outside the measured"),
        (
            ("--model", "experiment", "--plate-modulus", "3 GPa"),
            "plate_modulus 3000000000.0: model 'experiment' always takes its own value",
        ),
        (("--model", "beam_printed", "--sensed-thickness", "3 mm"), "model 'beam_printed' always takes its own value"),
        (("--at", "5 mm, 5 mm"), "load at (0.005, 0.005) m: model 'column' knows a uniform pressure only"),
        (
            ("--model", "solid", "--at", "5 mm, 10.1 mm"),
            "load at (0.005, 0.0101) m is off the object of 0.01 x 0.01 m; move it inside",
        ),
        (("--model", "solid", "--at", "5 mm"), "--at: '5 mm' is not two lengths; write for example '6 mm, 6 mm'"),
    ],
)
def test_bad_input_is_one_error_and_nothing_else(palpate: Palpate, wrong: tuple[str, ...], message: str) -> None:
    said = palpate(*changed(COLUMN, *wrong))
    assert said.status == 2
    assert message in said.complaint
    assert len(said.complaint.splitlines()) == 1


def test_a_tolerance_that_the_model_cannot_meet_is_refused_with_the_best_there_is(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(axisymmetric, "REFINEMENTS", (1, 2))
    cheap = ("--parameters", "identified", "--model", "axisymmetric", "--tolerance", "1e-10")
    said = palpate(*RATIO, *cheap, "--sensed-modulus", "100 kPa")
    assert said.status == 2
    assert "model 'axisymmetric' cannot meet tolerance 1e-10: its least error here is" in said.complaint


def test_help_names_both_moduli_that_plexiglas_is_said_to_have(palpate: Palpate) -> None:
    said = " ".join(palpate("model", "ratio", "--help").out.split())
    assert "(default: 70 MPa, plexiglas as the thesis has it; plexiglas, PMMA, has 3 GPa)" in said
    assert get_design("single").plate.material.modulus == 70e6


def test_case_a_is_met_within_its_own_error_estimate(palpate: Palpate) -> None:
    (point,) = palpate(
        *RATIO, "--design", "single_round", "--parameters", "physical", "--sensed-modulus", "100 kPa",
        "--compliant-modulus", "24 kPa", "--model", "axisymmetric", "--tolerance", "1e-4",
    ).object["points"]  # fmt: skip
    assert abs(point["force_ratio"] - CASE_A_RATIO) <= point["error_estimate"] <= 1e-4
    assert point["model"] == "axisymmetric"
    assert point["seconds"] > 0
