"""`palpate accuracy validation`, and what it says of the sign that changes between one sensor and a pair."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from palpate.instrument.models import validation
from palpate.instrument.models.foundation import springs
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import SAMPLES, get_sample
from palpate.instrument.thesis import Cell
from palpate.procedures.accuracy import readings, stiffening, what_if
from palpate.procedures.reproduce.solutions import Solutions
from tests.procedures.conftest import Palpate, silent

DOCUMENT = Path(__file__).parents[2] / "docs" / "validation.md"


@pytest.fixture(scope="module")
def effects() -> dict[str, what_if.Effect]:
    """All that is kept, by name."""
    return {e.what_if.name: e for e in what_if.effects(Solutions.shipped(what_if.STORED), silent)}


def test_every_model_stands_beside_the_experiments_of_each_arrangement(palpate: Palpate) -> None:
    found = palpate("accuracy", "validation", "--what-if", "--json").object
    assert found.keys() == {
        "sign", "models", "what_if", "measured_pair_over_single", "stiffening", "gains", "readings",
    }  # fmt: skip
    assert [each["design"] for each in found["gains"]] == ["single", "common_base", "different_base"]
    assert all(math.isfinite(each["left_rms_percent"]) for each in found["gains"])
    assert (len(found["what_if"]), len(found["readings"])) == (len(what_if.WHAT_IFS), 3)
    assert found["sign"] == "model less measured mean, in percent of the measured mean"
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
    said = palpate("accuracy", "validation", "--design", "common_base").out
    assert "model less measured mean" in said and "worst" in said
    assert "experiment, physical: input: the model is given the measured means" in said
    assert "axisymmetric, physical: none: design 'common_base' has 2 teeth" in said


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--design", "singel"), "unknown design with experiments 'singel' (did you mean 'single'?)"),
        (("--design", "array"), "unknown design with experiments 'array'"),
        (("--design", "single", "--what-if"), "--design: not with --what-if or --store"),
    ],
)
def test_what_has_no_answer_is_refused(palpate: Palpate, options: tuple[str, ...], part: str) -> None:
    said = palpate("accuracy", "validation", *options)
    assert said.status == 2 and part in said.err and said.out == ""


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


def test_prices_come_with_the_distance_of_each_model_from_the_experiments(palpate: Palpate) -> None:
    found = palpate("accuracy", "models", "--json").object
    priced = {(price["design"], price["model"]) for price in found["prices"]}
    assert {(each["design"], each["model"]) for each in found["validation"]} == priced
    said = palpate("accuracy", "models", "--design", "single").out
    assert re.search(r"surface +\d+ poles of solid .* 28 % ", said) and re.search(r"experiment .* input ", said)


# --- what if -------------------------------------------------------------------------------------------


def test_every_cause_is_kept_and_nothing_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solid, "solve", lambda *_: pytest.fail("solved"))
    found = what_if.effects(Solutions.shipped(what_if.STORED), silent)
    assert [effect.what_if.name for effect in found] == [each.name for each in what_if.WHAT_IFS]


@pytest.mark.slow
def test_a_kept_effect_is_the_models_own_now(effects: dict[str, what_if.Effect]) -> None:
    (slides,) = (each for each in what_if.WHAT_IFS if each.name == "object slides on tooth and ring")
    asked = what_if.asked("single", slides, get_sample("2"))
    ratio = solid.solve(asked, what_if.MESH).force_ratio
    assert effects[slides.name].by_design["single"].percent["2"] == pytest.approx(100 * (ratio / 0.142 - 1))


def test_the_coarsest_mesh_stands_for_the_model(effects: dict[str, what_if.Effect]) -> None:
    for design, found in effects["as the thesis describes it"].by_design.items():
        fine = validation.validate(design, "physical", "surface")
        assert found.mean == pytest.approx(fine.mean, abs=1.2) and found.rms == pytest.approx(fine.rms, abs=1.2)


def test_what_lies_below_the_ring_moves_nothing_and_the_flat_probe_moves_both_alike(
    effects: dict[str, what_if.Effect],
) -> None:
    """The model's contrast between pair and single sensor is 0.77, the measured one 0.92."""
    plain = effects["as the thesis describes it"]
    for name in ("plates of 3 GPa", "tooth, films and plates rigid", "films 100 times as soft"):
        for design, found in effects[name].by_design.items():
            assert found.mean == pytest.approx(plain.by_design[design].mean, abs=0.1)
    measured = what_if.mean_of(what_if.measured_contrasts())
    assert plain.contrast < 0.8 < 0.9 < measured < effects["rigid flat probe, not a uniform pressure"].contrast < 1
    assert abs(effects["object slides on tooth and ring"].contrast - plain.contrast) < 0.02


def test_the_pairs_readings_are_the_single_sensors_times_constants() -> None:
    base, first, second = readings.copied()
    assert (base.cells, base.same, second.cells, second.same) == (36, 36, 36, 36)
    assert (first.cells, first.same) == (36, 30)  # sample 1: just half of them
    assert "1.44 (sample 2), 1.40 (sample 1)" in base.how and "0.95, 1.13, 0.99, 1.15, 1.03, 0.95" in second.how


def test_readings_of_their_own_are_not_called_copies() -> None:
    def cells(*printed: str) -> list[Cell]:
        return [Cell(text, float(text)) for text in printed]

    one, half = cells("100", "145", "184"), [0.5, 0.5, 0.5]
    assert readings._agreeing(one, cells("50.003", "70.117", "92.5"), half) == 0
    assert readings._agreeing(one, cells("50.001", "72.50", "92"), half) == 3


def test_springs_that_stiffen_are_linear_under_a_small_load_and_raise_the_ratio_under_a_large_one() -> None:
    design, sample = get_design("single"), get_sample("3")
    linear = springs.force_ratio(design, sample)
    small, medium, large = (stiffening.force_ratio(design, sample, force) for force in (1e-4, 1.5, 4.0))
    assert small == pytest.approx(linear, rel=1e-3)
    assert linear < medium < large < 1
    # The stress alone counts: twice the force on rubber twice as stiff.
    assert stiffening.force_ratio(design, sample, 8.0, 2.0) == pytest.approx(large, rel=1e-6)


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
    assert len(figures) > 10
    assert [each for each in figures if each.replace("−", "-").lstrip("+") not in printed] == []


def test_what_is_solved_anew_replaces_what_is_kept(
    palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(validation, "solve", lambda *_: dict.fromkeys(SAMPLES, 0.5))
    monkeypatch.setattr(solid, "solve", lambda *_: SimpleNamespace(force_ratio=0.25))
    monkeypatch.setattr(validation, "STORED", tmp_path / "validation.json")
    monkeypatch.setattr(what_if, "STORED", tmp_path / "what_if.json")
    said = palpate("accuracy", "validation", "--store", "--what-if", "--json")
    assert said.err.startswith("palpate: note: solving the stored finite elements anew takes about 11 s\n")
    found = said.object
    validation.stored.cache_clear()
    by = {(m["design"], m["parameters"], m["model"]): m for m in found["models"]}
    assert by["single", "physical", "solid"]["samples_percent"]["1"] == pytest.approx(100 * (0.5 / 0.314 - 1))
    assert found["what_if"][0]["pair_over_single"] == dict.fromkeys(SAMPLES, 1.0)
    solved = json.loads((tmp_path / "what_if.json").read_text())
    assert [0.25] in solved.values() and len(solved) > 100
    kept = json.loads((tmp_path / "validation.json").read_text())["answers"]
    assert [(k["design"], k["parameters"], k["model"]) for k in kept] == list(validation.refining())
