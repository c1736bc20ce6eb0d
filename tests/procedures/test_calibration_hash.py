"""A calibration that was edited by hand is refused until somebody accepts it."""

from __future__ import annotations

import hashlib
import json
import re
from contextlib import suppress
from dataclasses import replace
from datetime import date
from pathlib import Path

import pytest
import tomli_w

from palpate.instrument.calibration.calibration import ANY
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.films import MountingScatterCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.calibration.model_calibration import ModelCalibration
from palpate.instrument.errors import ConfigError
from palpate.instrument.models.response import RatioQuestion
from palpate.procedures.lab.calibrations import mountings_of, path_of, probable_references
from palpate.procedures.records.run import Run
from palpate.simulators.planning.settle import read_scene
from tests.procedures.conftest import Palpate

SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s")
SCENE = read_scene("thesis_single").identity
LOAD_CELL = Path(f"runs/calibrations/load_cell-SIM-SI-0001-scene-{SCENE}.toml")


@pytest.fixture
def stored(palpate: Palpate) -> Path:
    """The calibration of the simulated bench's load cell, as if it had been measured there."""
    LOAD_CELL.parent.mkdir(parents=True)
    own = {"device": "SIM-SI-0001", "scene": SCENE, "simulated": True, "source": "by weights"}
    write_calibration(LOAD_CELL, THESIS_LOAD_CELL.model_copy(update=own))
    return LOAD_CELL


def edit(path: Path, old: str, new: str) -> None:
    text, count = re.subn(old, new, path.read_text(encoding="utf-8"))
    assert count == 1
    path.write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("sensitivity_mV_per_N = 10\\.306", "sensitivity_mV_per_N = 13.3", ""),
        (r'sha256 = "\w+"\n', "", ": its sha256 is gone; restore it"),
    ],
)
def test_an_edited_calibration_or_one_without_its_hash_is_refused_with_the_way_to_do_it_and_accepted(
    palpate: Palpate, stored: Path, old: str, new: str, told: str
) -> None:
    edit(stored, old, new)
    said = palpate(*SWEEP).refusal
    assert f"{stored}: was changed after it was written{told}" in said
    assert said.endswith(f"accept it: palpate calibrate accept {stored}")
    assert [path.name for path in Path("runs").iterdir()] == ["calibrations"]
    assert palpate("calibrate", "accept", str(stored)).status == 0
    assert read_calibration(stored, LoadCellCalibration).sensitivity_mV_per_N == (13.3 if new else 10.306)


def test_an_edit_that_is_accepted_is_used_and_told_by_every_run(palpate: Palpate, stored: Path) -> None:
    edit(stored, "greatest_N = 7.25", "greatest_N = 7.15")
    accepted = palpate("calibrate", "accept", str(stored), "--json").object["accepted"]
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", accepted)
    outcome = palpate(*SWEEP, "--json").object
    assert outcome["calibration"] == f"by weights (edited by hand, accepted on {accepted})"
    told = {"sha256": read_calibration(stored, LoadCellCalibration).sha256(), "accepted": accepted}
    assert outcome["calibration_files"] == {"load_cell": told, "films": None}
    header = Run.open(Path(outcome["run"])).header
    assert header["calibration_files"] == outcome["calibration_files"]
    assert palpate("calibrate", "accept", str(stored)).out == f"{stored}: is as it was written, nothing to accept\n"


@pytest.mark.slow
def test_films_that_were_edited_are_refused_and_accepted_too(palpate: Palpate) -> None:
    path = Path(palpate("calibrate", "films", "--dwell", "0.2 s", "--json").object["film_calibration_file"])
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"sensitivity_mV_per_N = \d+", "sensitivity_mV_per_N = 9", text, count=1), encoding="utf-8")
    assert f"{path}: was changed after it was written" in palpate(*SWEEP).complaint
    assert "edited by hand" in palpate("calibrate", "accept", str(path)).out
    outcome = palpate(*SWEEP, "--json").object
    assert "edited by hand, accepted on" in outcome["film_calibration"]
    assert outcome["calibration_files"]["films"]["accepted"]


def test_what_is_no_calibration_is_not_accepted(palpate: Palpate, stored: Path) -> None:
    edit(stored, "zero_mV = ", "zero = ")
    assert "zero: unknown key" in palpate("calibrate", "accept", str(stored)).refusal
    assert "cannot be read" in palpate("calibrate", "accept", "absent.toml").complaint


def test_no_digit_of_a_calibration_changes_unnoticed(stored: Path) -> None:
    text, whole = stored.read_text(encoding="utf-8"), read_calibration(stored)
    digits = [match.start() for match in re.finditer(r"\d", text)]
    assert len(digits) > 150
    for at in digits[::7]:
        stored.write_text(f"{text[:at]}{(int(text[at]) + 1) % 10}{text[at + 1 :]}", encoding="utf-8")
        with suppress(ConfigError):
            assert read_calibration(stored) == whole


@pytest.mark.parametrize("since", ["1", "2026-11-21"])  # a bare date is no JSON
def test_a_file_of_another_version_is_told_apart_from_one_that_was_edited(
    palpate: Palpate, stored: Path, since: str
) -> None:
    of_another = THESIS_LOAD_CELL.model_dump(exclude_none=True) | {"since": 1}
    content = json.dumps(of_another, sort_keys=True, separators=(",", ":")).encode()
    stored.write_text(tomli_w.dumps({"sha256": hashlib.sha256(content).hexdigest(), **of_another}), encoding="utf-8")
    edit(stored, "since = 1\n", f"since = {since}\n")
    complaint = palpate(*SWEEP).complaint
    assert "since: unknown key" in complaint
    assert ("another version of palpate wrote it" in complaint and "remove it, and measure anew" in complaint) == (
        since == "1"
    )


def test_an_edited_scatter_of_mountings_is_refused_with_the_way_to_do_it_and_told_once_accepted(
    palpate: Palpate,
) -> None:
    scatter = MountingScatterCalibration(
        means_u=0.02, degrees_of_freedom=4, sets_u=0.001, sets_freedom=45, design="single", device="20260101",
        simulated=True, source="by hand", scene=SCENE, created="now",
        expires="2999-01-01",
    )  # fmt: skip
    real = replace(scatter.owner, scene=None, simulated=False)
    path, elsewhere = (path_of(MountingScatterCalibration, owner) for owner in (scatter.owner, real))
    path.parent.mkdir(parents=True)
    write_calibration(path, scatter)
    edit(path, "means_u = 0.02", "means_u = 0.0001")
    elsewhere.write_text("damaged", encoding="utf-8")
    measure = ("measure", "modulus", "--sample", "4", "--tolerance", "5 %", "--relative-to-model", "--seed", "1")
    for rehearsal in (("--dry-run",), ()):
        assert f"{path}: was changed after it was written" in palpate(*measure, *rehearsal).refusal
    edit(path, "means_u = 0.0001", "means_u = 0.015")
    assert palpate("calibrate", "accept", str(path)).status == 0
    told = palpate(*measure, "--dry-run").out
    assert "scatter by 1.5 % of the ratio, at most 3.6 % (95 %): by hand (edited by hand, accepted on 2" in told
    today = date(2026, 11, 21)
    assert mountings_of(replace(real, device=ANY), today) is None  # it may be of another sensor than that will answer
    with pytest.raises(ConfigError, match="is not TOML"):
        mountings_of(real, today)
    question = RatioQuestion("single", "surface")
    elsewhere = path_of(ModelCalibration, replace(scatter.owner, of=("single", "surface", question.parameters, "3 mm")))
    elsewhere.write_text("damaged", encoding="utf-8")
    assert probable_references(question, None, date(2026, 11, 21)) is None  # a simulated sensor is no real one
    with pytest.raises(ConfigError, match="is not TOML"):
        probable_references(question, scatter.scene, date(2026, 11, 21))
