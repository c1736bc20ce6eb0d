"""What `palpate model ratio`, `modulus`, `shear`, `validation` and `plot` answer, and what they refuse."""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from shutil import copyfile
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.instrument.findings.object_modulus import estimate, validation_of
from palpate.instrument.models import shear, surface, validation
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.parameters import (
    PHYSICAL,
    RoundParameters,
    SolidParameters,
    get_parameter_set,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.response import RatioAnswer, RatioQuestion, ask, response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, Sample
from palpate.procedures.showing import model_picture
from palpate.procedures.showing.model_picture import ModelPicture
from tests.procedures.conftest import Palpate, changed
from tests.settings import give_meshes

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
    assert (own["force_ratio"], given["force_ratio"]) == (
        pytest.approx(column(1e5, thickness=0.55e-3), rel=1e-12),
        pytest.approx(column(1e5, 33e3, 2e-3), rel=1e-12),
    )


def test_what_a_closed_form_leaves_out_is_told_where_it_is_priced_and_nowhere_else(palpate: Palpate) -> None:
    points = palpate(*changed(COLUMN, "--sensed-modulus", "24.2 kPa, 100 kPa, 10 kPa")).object["points"]
    known = palpate(*RATIO, "--model", "surface", "--sensed-modulus", "24.2 kPa, 100 kPa").object["points"]
    errors = [point["model_error"] for point in points]
    apart = [points[i]["force_ratio"] * errors[i] for i in (0, 1)]  # the same part of the price list's interval
    assert apart[0] == pytest.approx(apart[1]) and errors[2] is None
    for closed, exact in zip(points, known, strict=False):
        assert 0.5 * apart[0] < abs(closed["force_ratio"] - exact["force_ratio"]) <= apart[0]
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
    assert "single, model column" in said.out and "14.9 kPa" in said.out and f"{column(1e5):.7g}" in said.out
    quiet = palpate(*asked, "--quiet")
    assert (quiet.status, quiet.out, quiet.err) == (0, "", "")


# --- bad input -----------------------------------------------------------------------------------------


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


# --- `palpate model modulus` --------------------------------------------------------------------------


PRICED = ("model", "modulus", "--json", "--model", "column")
MODULUS = (*PRICED, "--compliant-poisson", "0.48")  # which the column does not look at
AREA_SHARE = 1.4**2 / (1.4**2 + 5**2 - 1.5**2)


def column_modulus(ratio: float) -> float:
    """E = E_c (T_s / T_c) (R - a) / (a (1 - R))."""
    return 24e3 * 3 / 3.88 * (ratio - AREA_SHARE) / (AREA_SHARE * (1 - ratio))


def test_each_ratio_gets_its_modulus_or_a_bound(palpate: Palpate) -> None:
    said = palpate(*MODULUS, "--force-ratio", "0.31,0.99, 0.081, 0.05", "--uncertainty", "0.005", "--design", "single")
    inside, hard, soft, outside = said.object["points"]
    assert (inside["modulus_Pa"], inside["scale_low_Pa"], inside["scale_high_Pa"]) == (
        pytest.approx(column_modulus(0.31), rel=1e-9),
        pytest.approx(column_modulus(0.31 - 1.959963985 * 0.005), rel=1e-6),
        pytest.approx(column_modulus(0.31 + 1.959963985 * 0.005), rel=1e-6),
    )
    assert (inside["sensitivity"], inside["kind"], inside["note"], inside["model"]) == (
        pytest.approx(0.31 * (1 - AREA_SHARE) / ((0.31 - AREA_SHARE) * 0.69), rel=1e-8),
        "interval",
        "",
        "column",
    )
    assert (hard["modulus_Pa"], hard["scale_high_Pa"], hard["kind"]) == (None, None, "at least")
    assert (hard["scale_low_Pa"], hard["note"]) == (
        pytest.approx(column_modulus(0.99 - 1.959963985 * 0.005), rel=1e-5),
        "1 % of the ratio is 100 % of the modulus here",
    )
    assert (soft["modulus_Pa"], soft["scale_low_Pa"], soft["kind"]) == (None, None, "at most")
    assert (soft["scale_high_Pa"], outside["kind"]) == (
        pytest.approx(column_modulus(0.081 + 1.959963985 * 0.005), rel=1e-6),
        "at most",
    )
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
    assert (point["modulus_Pa"], point["scale_low_Pa"], point["scale_high_Pa"]) == (
        pytest.approx(column_modulus(0.31), rel=1e-9),
        pytest.approx(column_modulus(0.31 - spread), rel=1e-6),
        pytest.approx(column_modulus(0.31 + spread), rel=1e-6),
    )


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
    assert (point["absolute_low_Pa"], point["absolute_high_Pa"]) == (
        pytest.approx(column_modulus(low), rel=1e-5),
        pytest.approx(column_modulus(high), rel=1e-5),
    )


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


def test_people_get_a_table_of_moduli(palpate: Palpate) -> None:
    asked = ("model", "modulus", "--model", "column", "--force-ratio", "0.31, 0.99", "--uncertainty", "0.001")
    said = palpate(*asked)
    assert (said.status, said.err) == (0, "")
    assert "single, model column: Young modulus" in said.out and f"{column_modulus(0.31) / 1e3:.2f} kPa" in said.out
    assert re.search("at least .*1 % of the ratio", said.out, re.DOTALL)
    assert "absolute       validation error 17 % of the ratio (6 degrees of freedom): rms distance from" in said.out
    assert "only a bound   palpate test modulus tells more of such an object" in said.out


def test_no_number_in_json_is_infinite(palpate: Palpate) -> None:
    points = palpate(*MODULUS, "--force-ratio", "0.0801, 0.5, 0.999999", "--uncertainty", "0.3").object["points"]
    assert all(math.isfinite(value) for point in points for value in point.values() if isinstance(value, float))
    assert [point["kind"] for point in points] == ["at most", "any", "at least"]


# --- what `ratio`, `modulus` and `plot` all refuse: nothing is solved or written ----------------------


COMMANDS = {
    "ratio": ("model", "ratio", "--sensed-modulus", "100 kPa"),
    "modulus": ("model", "modulus", "--force-ratio", "0.3"),
    "plot": ("model", "plot", "--sensed-modulus", "100 kPa", "--out", "new.png"),
}


def refused_by(palpate: Palpate, command: str, *wrong: str) -> str:
    """The one line of the error."""
    said = palpate(*COMMANDS[command], *wrong)
    assert (said.status, said.out, len(said.complaint.splitlines())) == (2, "", 1)
    assert not list(Path().iterdir())
    return said.complaint


@pytest.fixture
def surfaces(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of stored surfaces, still empty."""
    folder = tmp_path_factory.mktemp("surfaces")
    surface.read_surface.cache_clear()
    ratio_curve.cache_clear()
    monkeypatch.setattr(surface, "STORED", folder)
    yield folder
    surface.read_surface.cache_clear()
    ratio_curve.cache_clear()


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--sensed-thickness", "-3 mm", "--sensed-thickness: '-3 mm' is not above 0 and finite"),
        ("--sensed-thickness", "1e999 mm", "is not finite"),
        ("--sensed-poisson", "-1", "Poisson ratio -1 of sample 'sensed object' is not above -1 and at most 0.5"),
        ("--compliant-poisson", "0.50001", "Poisson ratio 0.50001 of neoprene of the compliant ring is outside"),
        ("--compliant-modulus", "0 Pa", "--compliant-modulus: '0 Pa' is not above 0 and finite"),
        ("--compliant-modulus", "1e999 Pa", "is not finite"),
        ("--plate-modulus", "-70 MPa", "--plate-modulus: '-70 MPa' is not above 0 and finite"),
        ("--interface", "glued", "unknown interface 'glued'"),
        ("--tolerance", "-1e-3", "is not above 0; give"),
        ("--tolerance", "1e999", "is no share; give"),
    ],
)
def test_a_value_outside_its_limits(palpate: Palpate, command: str, option: str, value: str, message: str) -> None:
    assert message in refused_by(palpate, command, "--model", "column", option, value)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_tolerance_that_no_model_meets_names_the_best_there_is(palpate: Palpate, command: str) -> None:
    complaint = refused_by(palpate, command, "--tolerance", "1e-9")
    assert [
        text
        for text in (
            "tolerance 1e-09: no model meets it for design 'single'",
            "the best is 'surface', ± 0.0",
            "; give --tolerance 0.0",
        )
        if text not in complaint
    ] == []


def shipped(design: str) -> list[Path]:
    """Files of the curves that come with palpate."""
    found = sorted(Path(surface.__file__).with_name("curves").glob(f"{design}.*"))
    assert found
    return found


@pytest.mark.parametrize("command", COMMANDS)
def test_a_surface_of_another_design_or_cut_off_in_its_file(palpate: Palpate, command: str, surfaces: Path) -> None:
    for one, other in zip(shipped("common_base"), shipped("single"), strict=True):
        copyfile(one, surfaces / other.name)
    complaint = refused_by(palpate, command, "--model", "surface")
    assert "it was written for something else, or by another version" in complaint and "build it again" in complaint
    surface.read_surface.cache_clear()
    ratio_curve.cache_clear()
    for path in shipped("single"):
        (surfaces / path.name).write_bytes(path.read_bytes()[:1000])
    complaint = refused_by(palpate, command, "--model", "surface")
    assert f"curve {surfaces}" in complaint and "not readable" in complaint and "build it again" in complaint


def test_a_surface_for_an_object_that_it_does_not_know(palpate: Palpate) -> None:
    complaint = refused_by(palpate, "ratio", "--model", "surface", "--sensed-thickness", "2 mm")
    assert "has no surface for design 'single' with these dimensions, materials and load" in complaint
    assert "ask model 'solid'" in complaint


# --- `palpate model shear` ----------------------------------------------------------------------------


@pytest.fixture
def felt(monkeypatch: pytest.MonkeyPatch) -> None:
    def of_meshes(design: Design, sample: Sample, refinement: int) -> dict[str, shear.FilmShear]:
        assert (design.name, sample.name) == ("common_base", "1")
        dragged = {"tooth": 1e-12, "object": 0.02 + 0.001 * refinement}
        return {
            "rigid_1": shear.FilmShear(0.2, 21.0, dragged, 24e-3),
            "total": shear.FilmShear(1.0, 0.0, dict.fromkeys(shear.DRAGGED, 0.0), 24e-3),
        }

    monkeypatch.setattr(shear, "shear", of_meshes)


@pytest.mark.usefixtures("felt")
def test_the_command_gives_forces_places_and_the_change_from_the_mesh_before(palpate: Palpate) -> None:
    found = palpate("model", "shear", "--json").object
    first, total = found["films"]
    assert first == {
        "film": "rigid_1", "pressed_N": 0.2, "change_N": pytest.approx(0.001), "tooth_N": 0.0,
        "tooth_off_centre_m": pytest.approx(0, abs=1e-12), "object_N": 0.021,
        "object_off_centre_m": pytest.approx(1e-3),
    }  # fmt: skip
    assert total["object_off_centre_m"] is None
    assert found["told"] == "off centre"
    shown = palpate("model", "shear")
    assert "+0.02100" in shown.out and "+1.000" in shown.out and "shear looks like a load off centre" in shown.out
    assert shown.err == "palpate: note: solving the finer mesh of common_base takes about 5 s\n"


def test_an_unknown_design_or_sample_and_several_rows_are_refused(palpate: Palpate) -> None:
    assert "design 'array' has 2 rows of teeth" in palpate("model", "shear", "--design", "array").complaint
    assert "unknown sample '9'" in palpate("model", "shear", "--sample", "9").complaint
    assert "did you mean 'single'" in palpate("model", "shear", "--design", "singel").complaint


# --- `palpate model validation` -----------------------------------------------------------------------


DOCUMENT = Path(__file__).parents[2] / "docs" / "validation.md"


def test_every_model_stands_beside_the_experiments_of_each_arrangement(palpate: Palpate) -> None:
    found = palpate("model", "validation", "--json").object
    assert (found.keys(), found["sign"]) == (
        {"sign", "models"},
        "model less measured mean, in percent of the measured mean",
    )
    assert {(m["design"], m["model"]) for m in found["models"]} == {
        (design, model) for design in ("single", "common_base", "different_base") for model in MODELS
    }
    by = {(m["design"], m["parameters"], m["model"]): m for m in found["models"]}
    assert by["single", "physical", "experiment"]["kind"] == "input"
    surface = by["single", "physical", "surface"]
    assert surface["samples_percent"].keys() == SAMPLES.keys()
    assert min(surface["samples_percent"].values()) > 19.5 and max(surface["samples_percent"].values()) < 36.2
    solid_ = by["single", "physical", "solid"]
    assert solid_["mean_percent"] == pytest.approx(surface["mean_percent"], abs=0.5)  # one model, two meshes


def test_people_read_the_distance_sample_by_sample_and_why_there_is_none(palpate: Palpate) -> None:
    said = palpate("model", "validation", "--design", "common_base").out
    assert [
        text
        for text in (
            "model less measured mean",
            "worst",
            "experiment, physical: input: the model is given the measured means",
            "axisymmetric, physical: none: design 'common_base' has 2 teeth",
        )
        if text not in said
    ] == []


def test_a_ratio_comes_with_the_distance_of_its_model_from_the_experiments(palpate: Palpate) -> None:
    ratio = ("model", "ratio", "--sensed-modulus", "48.3 kPa")
    (found,) = palpate(*ratio, "--json").object["validation"]
    assert (found["model"], found["kind"], round(found["rms_percent"])) == ("surface", "compared", 28)
    said = palpate(*ratio).out
    assert " 28 % " in said and "validation of surface (physical set, single): mean +27.1 %" in said
    assert "the set as it stands" not in said
    changed = palpate(*ratio, "--model", "column", "--sensed-thickness", "2 mm", "--compliant-modulus", "33 kPa").out
    assert "that of the set as it stands, without --sensed-thickness, --compliant-modulus" in changed
    inverse = palpate(
        "model", "modulus", "--force-ratio", "0.31", "--model", "column", "--sensed-thickness", "2 mm"
    ).out
    assert "that of the set as it stands, without --sensed-thickness" in inverse
    none = palpate(*ratio, "--design", "single_round", "--model", "column").out
    assert " none " in none and "nothing was measured with design 'single_round'" in none


# --- the document --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_figure_of_the_document_is_printed_by_a_command_that_it_names(palpate: Palpate) -> None:
    """Blocks begin with the command; their lines stand in its output, and the text's figures in the blocks."""
    parts = DOCUMENT.read_text(encoding="utf-8").split("```")
    printed = ""
    for block in parts[1::2]:
        command, *lines = [line.rstrip() for line in block.strip().splitlines()]
        assert command.startswith("$ palpate "), command
        output = {line.rstrip() for line in palpate(*command.split()[2:]).out.splitlines()}
        assert [line for line in lines if line and line not in output] == [], command
        printed += block
    text = re.sub(r"Table [A\d.]+", "", "".join(parts[0::2]))
    figures = re.findall(r"(?<![\w.])[-+−]?\d+\.\d+", text)
    assert [each for each in figures if each.replace("−", "-").lstrip("+") not in printed] == []


def test_what_is_solved_anew_replaces_what_is_kept(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validation, "solve", lambda *_: dict.fromkeys(SAMPLES, 0.5))
    monkeypatch.setattr(validation, "STORED", tmp_path / "validation.json")
    said = palpate("model", "validation", "--store", "--json")
    assert said.err.startswith("palpate: note: solving the stored finite elements anew takes about 50 s\n")
    found = said.object
    validation.stored.cache_clear()
    by = {(m["design"], m["parameters"], m["model"]): m for m in found["models"]}
    assert by["single", "physical", "solid"]["samples_percent"]["1"] == pytest.approx(100 * (0.5 / 0.314 - 1))
    kept = json.loads((tmp_path / "validation.json").read_text())["answers"]
    assert [(k["design"], k["parameters"], k["model"]) for k in kept] == list(validation.refining())


@pytest.mark.parametrize(
    ("command", "wrong", "message"),
    [
        (COLUMN, ("--sensed-modulus", "0 Pa"), "--sensed-modulus: '0 Pa' is not above 0"),
        (COLUMN, ("--sensed-modulus", "24 kPa, -1 kPa"), "--sensed-modulus: '-1 kPa' is not above 0"),
        (COLUMN, ("--sensed-modulus", "24"), "'24' has no unit where Pa belongs"),
        (COLUMN, ("--sensed-modulus", "24 kPa,"), "'' is not a quantity"),
        (COLUMN, ("--sensed-modulus", "1e999 Pa"), "is not finite"),
        (COLUMN, ("--sensed-thickness", "3 N"), "is in N where m belongs"),
        (
            COLUMN,
            ("--sensed-poisson", "0.51"),
            "Poisson ratio 0.51 of sample 'sensed object' is not above -1 and at most 0.5",
        ),
        (
            COLUMN,
            ("--compliant-poisson", "-1"),
            "Poisson ratio -1 of neoprene of the compliant ring is outside (-1, 0.5]",
        ),
        (COLUMN, ("--interface", "glued"), "unknown interface 'glued'; valid: bonded, capped, frictionless"),
        (COLUMN, ("--parameters", "fysical"), "did you mean 'physical'?"),
        (COLUMN, ("--parameters", "identified"), "unknown parameter set of model 'column' 'identified'"),
        (COLUMN, ("--design", "singel"), "did you mean 'single'?"),
        (COLUMN, ("--model", "colum"), "did you mean 'column'?"),
        (COLUMN, ("--tolerance", "1e-4"), "model 'column' has no error estimate"),
        (COLUMN, ("--model", "axisymmetric", "--tolerance", "5"), "--tolerance: '5' is 500 %, above the 50 %"),
        (
            COLUMN,
            ("--model", "axisymmetric", "--design", "common_base"),
            "design 'common_base' has 2 teeth, not one; take model 'solid'",
        ),
        (COLUMN, ("--model", "experiment", "--sensed-modulus", "1 MPa"), "is outside the measured"),
        (
            COLUMN,
            ("--model", "experiment", "--plate-modulus", "3 GPa"),
            "plate_modulus 3000000000.0: model 'experiment' always takes its own value",
        ),
        (
            COLUMN,
            ("--model", "beam_printed", "--sensed-thickness", "3 mm"),
            "model 'beam_printed' always takes its own value",
        ),
        (COLUMN, ("--at", "5 mm, 5 mm"), "load at (0.005, 0.005) m: model 'column' knows a uniform pressure only"),
        (
            COLUMN,
            ("--model", "solid", "--at", "5 mm, 10.1 mm"),
            "load at (0.005, 0.0101) m is off the object of 0.01 x 0.01 m; move it inside",
        ),
        (
            COLUMN,
            ("--model", "solid", "--at", "5 mm"),
            "--at: '5 mm' is not two lengths; write for example '6 mm, 6 mm'",
        ),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "0"), "force ratio 0 is not between 0 and 1"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "0.3, 1"), "force ratio 1 is not between 0 and 1"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "-0.1"), "force ratio -0.1 is not between 0 and 1"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "31 %, 120 %"), "force ratio 1.2 is not between 0 and 1"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "nan"), "'nan' is not a quantity"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", ""), "'' is not a quantity"),
        ((*PRICED, "--force-ratio", "0.3"), ("--force-ratio", "0.3,"), "'' is not a quantity"),
        ((*PRICED, "--force-ratio", "0.3"), ("--uncertainty", "-0.01"), "uncertainty -0.01 is below 0"),
        ((*PRICED, "--force-ratio", "0.3"), ("--uncertainty", "1e999"), "is not finite"),
        (
            (*PRICED, "--force-ratio", "0.3"),
            ("--model", "experiment", "--design", "array"),
            "nothing was measured with design 'array'",
        ),
    ],
)
def test_bad_input_is_one_error_and_nothing_else(
    palpate: Palpate, command: tuple[str, ...], wrong: tuple[str, ...], message: str
) -> None:
    said = palpate(*changed(command, *wrong))
    assert said.status == 2
    assert message in said.complaint
    assert len(said.complaint.splitlines()) == 1


# --- What `palpate model plot` draws, where it goes, and what it refuses -------------------------------


PLOT = ("model", "plot", "--sensed-modulus", "100 kPa")
CLOSED = (*PLOT, "--model", "column")
ROUND = RatioQuestion("single", "axisymmetric", "identified", tolerance=1e-2)


@pytest.fixture
def few_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_picture, "CURVES", ("column", "axisymmetric", "experiment"))
    monkeypatch.setattr(model_picture, "CURVE_TOLERANCE", -1.0)  # finite elements are not solved for a line


@pytest.fixture(scope="module")
def picture() -> ModelPicture:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model_picture, "CURVES", ("column",))
        patch.setattr(model_picture, "SECTION_REFINEMENT", 1)
        return model_picture.solve(ROUND, [1e5, 1e6])


@pytest.fixture(scope="module")
def panels(picture: ModelPicture) -> list[Axes]:
    """The panels of the figure in their order: deformation, pressure, ratio."""
    saved: list[Figure] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: saved.append(figure))
        model_picture.draw(picture, Path("sensor.png"))
    (figure,) = saved
    figure.draw_without_rendering()
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def labels(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]  # type: ignore[union-attr]


# --- what is drawn --------------------------------------------------------------------------------------


def test_the_section_shows_every_body_on_both_sides_of_the_axis(picture: ModelPicture, panels: list[Axes]) -> None:
    from matplotlib.collections import QuadMesh

    deformed = panels[0]
    meshes = [item for item in deformed.collections if isinstance(item, QuadMesh)]
    bodies = picture.sections[0].bodies
    # The object reaches the axis, the ring does not.
    assert ({name: len(pieces) for name, pieces in bodies.items()}, len(meshes)) == ({"object": 1, "ring": 2}, 3)
    for pieces in bodies.values():
        assert min(piece.x.min() for piece in pieces) == -max(piece.x.max() for piece in pieces)
    largest = max(picture.sections[0].largest.values())
    assert max(float(np.max(mesh.get_array())) for mesh in meshes) == pytest.approx(1e6 * largest)  # type: ignore[arg-type]
    assert {text.get_text() for text in deformed.texts} == {"object", "ring"}
    assert f"100 kPa, displacements × {picture.scale:g}" in deformed.get_title()


def test_the_largest_displacement_stays_small_in_the_drawing(picture: ModelPicture) -> None:
    section = picture.sections[0]
    assert 0.04 < picture.scale * max(section.largest.values()) / section.height <= 0.12
    digits = picture.scale / 10 ** np.floor(np.log10(picture.scale))
    assert digits == pytest.approx(min((1, 2, 5), key=lambda step: abs(step - digits)))


def test_the_pressure_is_broken_over_the_gap_and_says_what_the_tooth_takes(
    picture: ModelPicture, panels: list[Axes]
) -> None:
    pressure = panels[1]
    assert pressure.get_yscale() == "log"
    assert "clipped" in pressure.get_title()
    for line, section in zip(pressure.get_lines(), picture.sections, strict=False):
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        gap = int(np.flatnonzero(np.isnan(x))[0])
        assert x[gap - 1] < 1e3 * section.teeth[0][1] < 1.5 <= x[gap + 2]
        assert np.nanmin(y) > 0
    taken = [f"tooth takes {100 * answer.response.force_ratio:.1f} %" for answer in picture.answers]
    assert [label.split(": ")[1] for label in labels(pressure)[:2]] == taken
    highest = max(float(section.pressure.max()) for section in picture.sections) / 1e3
    assert pressure.get_ylim()[1] < highest


def test_the_ratio_panel_holds_the_models_the_thesis_and_what_was_asked(
    picture: ModelPicture, panels: list[Axes]
) -> None:
    ratio = panels[2]
    assert labels(ratio) == [
        "column, physical parameters", "thesis, finite elements (A2.1)",
        "thesis, measured means", "axisymmetric, as asked",
    ]  # fmt: skip
    asked = ratio.get_lines()[-1]
    assert list(np.asarray(asked.get_xdata())) == pytest.approx([100, 1000])
    assert list(np.asarray(asked.get_ydata())) == [answer.response.force_ratio for answer in picture.answers]


def test_the_data_are_those_of_the_picture(picture: ModelPicture) -> None:
    data = picture.data()
    assert [point["sensed_modulus_Pa"] for point in data["points"]] == [1e5, 1e6]
    assert (set(data["deformation"]["largest_displacement_m"]), len(data["pressure"])) == ({"object", "ring"}, 2)
    assert len(data["pressure"][0]["x_m"]) == len(data["pressure"][0]["pressure_Pa"]) > 20
    assert len(data["curves"]["column, physical parameters"]["force_ratio"]) == 200
    assert len(data["thesis"]["thesis, finite elements (A2.1)"]["force_ratio"]) == 48
    assert all(0 < ratio < 1 for ratio in data["thesis"]["thesis, finite elements (A2.1)"]["force_ratio"][:40])


def test_the_solid_model_shows_both_teeth_of_a_pair(monkeypatch: pytest.MonkeyPatch, few_curves: None) -> None:
    smallest = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
    give_meshes(monkeypatch, smallest)
    monkeypatch.setattr(model_picture, "SOLID_REFINEMENT", 0)
    saved: list[Figure] = []
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda figure, *_, **__: saved.append(figure))
    sensor, load = get_design("common_base"), PHYSICAL.load(1e6)
    section = model_picture.SECTIONS["solid"](sensor, load)
    answer = RatioAnswer(1e6, response(sensor, load, "column"), 0.0)
    question = RatioQuestion("common_base", "solid")
    model_picture.draw(ModelPicture(question, [answer], [section], {}, {}), Path("sensor.png"))
    deformed, pressure, *_ = (axes for axes in saved[0].axes if axes.get_label() != "<colorbar>")

    assert {name: len(pieces) for name, pieces in section.bodies.items()} == {
        "lower plate": 1, "base film": 1, "upper plate": 1, "tooth film": 2, "tooth": 2, "ring": 4, "object": 1,
    }  # fmt: skip
    assert np.array(section.teeth) == pytest.approx(np.array([[4.6e-3, 7.4e-3], [16.6e-3, 19.4e-3]]))
    # Symmetric about the middle, and harder on the teeth than beside them.
    assert (section.x + section.x[::-1], section.pressure) == (
        pytest.approx(np.full(len(section.x), 24e-3)),
        pytest.approx(section.pressure[::-1]),
    )
    on_teeth = np.abs(section.x % 12e-3 - 6e-3) < 1.4e-3
    assert section.pressure[on_teeth].min() > section.mean > np.median(section.pressure[~on_teeth])
    assert (deformed.get_xlabel(), pressure.get_xlim()) == ("place along the sensor (mm)", (0, 24))
    assert "teeth take" in labels(pressure)[0]
    # Nothing is drawn across what the object does not touch: gaps around the teeth, and between the rings.
    x = np.asarray(pressure.get_lines()[0].get_xdata())
    for start, end in ((4.5, 4.6), (7.4, 7.5), (11.0, 13.0), (16.5, 16.6), (19.4, 19.5)):
        after = int(np.flatnonzero(x >= end)[0])
        assert np.isnan(x[after - 1]) and not ((x > start) & (x < end)).any()


def test_a_model_that_does_not_know_the_sensor_has_no_curve(few_curves: None) -> None:
    drawn = model_picture.solve(RatioQuestion("array", "column"), [1e5])
    assert (set(drawn.curves), drawn.thesis, drawn.sections) == ({"column"}, {}, [])


# --- where it goes --------------------------------------------------------------------------------------


def test_a_model_without_a_section_gets_the_ratio_alone(palpate: Palpate, few_curves: None) -> None:
    said = palpate(*CLOSED, "--out", "sensor.png", "--json")
    assert said.object["file"] == str(Path("sensor.png").absolute())
    assert Path("sensor.png").exists()
    assert said.object["deformation"] is None
    assert (said.object["pressure"], set(said.object["curves"])) == ([], {"column", "experiment"})


def test_without_a_name_each_picture_is_a_new_file_of_the_store(palpate: Palpate, few_curves: None) -> None:
    said = palpate(*CLOSED, "--design", "common_base")
    file = Path(said.out.strip())
    assert (said.status, said.err) == (0, "")
    assert file.is_file()
    assert file.parent == Path("runs/plots").absolute()
    assert file.name.endswith("-common_base-column.png")
    assert palpate("runs", "list", "--json").object == {"runs": []}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("--out", "missing/sensor.png"), "missing/sensor.png: there is no folder missing; make it"),
        (("--out", "sensor.txt"), "sensor.txt does not end in .png or .svg"),
        (("--out", "taken.png"), "taken.png exists and is not overwritten"),
        (("--sensed-modulus", "0 Pa"), "--sensed-modulus: '0 Pa' is not above 0 and finite"),
        (("--sensed-modulus", "24 kPa,"), "'' is not a quantity"),
        (("--design", "singel"), "did you mean 'single'?"),
        (("--model", "colum"), "did you mean 'column'?"),
        (("--model", "axisymmetric", "--design", "common_base"), "has 2 teeth, not one; take model 'solid'"),
    ],
)
def test_bad_input_is_one_error_and_leaves_no_file(palpate: Palpate, wrong: tuple[str, ...], message: str) -> None:
    Path("taken.png").touch()
    said = palpate(*changed((*CLOSED, "--out", "new.png"), *wrong))
    assert said.status == 2
    assert message in said.complaint
    assert (len(said.complaint.splitlines()), [file.name for file in Path().iterdir()]) == (1, ["taken.png"])


def test_an_empty_name_is_refused(palpate: Palpate) -> None:
    said = palpate(*CLOSED, "--out", "")
    assert (said.status, said.out) == (2, "")
    assert "the name is empty" in said.err
