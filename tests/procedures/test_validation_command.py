"""`palpate model validation`, and the page that shows what it prints."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from palpate.instrument.models import validation
from palpate.instrument.models.table import MODELS
from palpate.instrument.sensor.sample import SAMPLES
from tests.procedures.conftest import Palpate

DOCUMENT = Path(__file__).parents[2] / "docs" / "validation.md"


def test_every_model_stands_beside_the_experiments_of_each_arrangement(palpate: Palpate) -> None:
    found = palpate("model", "validation", "--json").object
    assert found.keys() == {"sign", "models"}
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
    said = palpate("model", "validation", "--design", "common_base").out
    assert "model less measured mean" in said and "worst" in said
    assert "experiment, physical: input: the model is given the measured means" in said
    assert "axisymmetric, physical: none: design 'common_base' has 2 teeth" in said


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--design", "singel"), "unknown design with experiments 'singel' (did you mean 'single'?)"),
        (("--design", "array"), "unknown design with experiments 'array'"),
        (("--design", "single", "--store"), "--design: not with --store"),
    ],
)
def test_what_has_no_answer_is_refused(palpate: Palpate, options: tuple[str, ...], part: str) -> None:
    said = palpate("model", "validation", *options)
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
