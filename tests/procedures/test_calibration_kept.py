"""A calibration is kept, refused when it was edited, and used on the bench of its own scene alone."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import random
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any
from unittest.mock import DEFAULT, Mock

import pytest
import tomli_w

import palpate as package
from palpate import ConfigError, Run
from palpate.extend import ModelCalibration, Scene, read_scene
from palpate.instrument.calibration.calibration import ANY
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.films import MountingScatterCalibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, LoadCellCalibration
from palpate.instrument.models.response import RatioQuestion
from palpate.procedures.lab.calibrations import mountings_of, path_of, probable_references
from palpate.simulators.bench import SimulatedBench
from tests.kills import CALIBRATION_FAULTS, COMMANDS, ERRORS, in_process, served
from tests.procedures.conftest import Palpate, scene_of
from tests.runs import rehash
from tests.shares import first_of

CELL = ("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N", "--quiet")
MOUNTINGS = (*COMMANDS["mountings"], "--quiet")
STORE = Path("runs/calibrations")
Strike = Callable[[int, BaseException], None]


@pytest.fixture
def strike(monkeypatch: pytest.MonkeyPatch) -> Strike:
    """Has an error raised where the n-th file is put into its place. The record of a run is the first."""

    def at(count: int, error: BaseException) -> None:
        replace = Mock(side_effect=[*[DEFAULT] * (count - 1), error, *[DEFAULT] * 99], wraps=os.replace)
        monkeypatch.setattr(os, "replace", replace)

    return at


@pytest.mark.parametrize(("at", "there"), first_of([(6, 4), (2, 0)]))
def test_a_run_that_is_stopped_before_its_calibration_is_stored_is_not_complete_and_resuming_stores_it(
    palpate: Palpate, strike: Strike, at: int, there: int
) -> None:
    strike(at, KeyboardInterrupt())
    assert palpate(*CELL, "--out", "day").status == 130
    files = {"certificate.md", "certificate.html", "certificate.xml", "calibration.toml"}
    assert (len(files & {path.name for path in Path("day").iterdir()}), any(STORE.glob("*"))) == (there, False)
    assert (Run.open(Path("day")).status, palpate("runs", "resume", "day", "--quiet").status) == ("stopped", 0)
    assert Run.open(Path("day")).status == "complete"
    (stored,) = STORE.iterdir()
    assert stored.read_bytes() == Path("day/calibration.toml").read_bytes()
    assert read_calibration(stored).source == "day"


@pytest.mark.parametrize("code", first_of([errno.ENOSPC, errno.EROFS, errno.EACCES]))
def test_a_store_that_cannot_be_written_to_is_told_with_the_remedy_which_works(
    palpate: Palpate, strike: Strike, code: int
) -> None:
    strike(6, OSError(code, os.strerror(code)))
    said = palpate(*CELL, "--out", "day").complaint
    for each in ("the calibration is kept in ", os.strerror(code), "and later runs do not use it"):
        assert each in said
    run = Run.open(Path("day"))
    assert (run.status, [event["kind"] for event in run.events()]) == ("complete", ["measured", "unstored"])
    remedy = said.splitlines()[0].partition("then run palpate ")[2].split()
    told = palpate(*remedy, "--json").object
    (stored,) = STORE.iterdir()
    assert (told["calibration_file"], told["installed"]) == (str(stored), True)
    assert "was installed already" in palpate(*remedy).out
    assert "is complete; there is nothing to resume" in palpate("runs", "resume", "day").complaint


def test_a_complete_run_whose_calibration_is_not_stored_is_resumed_to_store_it(palpate: Palpate) -> None:
    day = Path("day")
    assert palpate(*CELL, "--out", "day").status == 0
    digest = Run.open(day).digest()
    for gone in ((), ("calibration.toml", "certificate.md")):
        for name in gone:
            (day / name).unlink()
        shutil.rmtree("runs")
        assert palpate("runs", "resume", "day", "--quiet").status == 0
        (stored,) = STORE.iterdir()
        assert stored.read_bytes() == (day / "calibration.toml").read_bytes()
        assert (day / "certificate.md").exists()
        assert (Run.open(day).digest(), Run.open(day).status) == (digest, "complete")
    rehash(day, status="running")  # as if it had been killed just before its last row
    assert (palpate("runs", "resume", "day", "--quiet").status, Run.open(day).status) == (0, "complete")


def test_an_older_calibration_does_not_replace_a_newer_one(palpate: Palpate) -> None:
    assert palpate(*CELL, "--out", "old").status == 0
    rehash(Path("old"), status="stopped", header=lambda header: header.update(started="2001-02-03T04:05:06+00:00"))
    assert palpate(*CELL, "--out", "new").status == 0
    (stored,) = STORE.iterdir()
    said = palpate("runs", "resume", "old", "--quiet").complaint
    assert f"{stored} is newer, of new; remove it if this one shall be used" in said
    assert (read_calibration(stored).source, Run.open(Path("old")).status) == ("new", "complete")


def test_what_has_no_calibration_to_install_says_why(palpate: Palpate) -> None:
    assert palpate("sweep", "loads", "--samples", "1", "--loads", "2 N", "--out", "day", "--quiet").status == 0
    assert "day: has no calibration, since its procedure makes none" in palpate("runs", "install", "day").complaint


@pytest.mark.usefixtures("own_store")
def test_a_calibration_of_a_real_bench_that_was_measured_is_kept_by_resuming_it(
    lab: str, sim: SimulatedBench, strike: Strike, tmp_path: Path
) -> None:
    series = package.LoadCellSeries(loads=(1.5, 4.0, 7.0))
    strike(4, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt), package.open_bench(bench=lab, operator=sim.operator) as bench:
        package.run(series, bench, out="day")
    before = Run.open(Path("day")).points()
    done = package.resume("day", bench=lab, accept_change=False)
    assert (done.run.points(), done.run.status) == (before, "complete")
    assert read_calibration(Path(done.outcome["calibration_file"])).source == "day"


@pytest.mark.slow
def test_a_scatter_of_mountings_that_could_not_be_stored_is_stored_by_resuming(
    palpate: Palpate, strike: Strike
) -> None:
    strike(3, OSError(errno.ENOSPC, "full"))
    said = palpate(*MOUNTINGS, "--out", "day")
    assert (said.status, Run.open(Path("day")).status) == (1, "complete")
    assert palpate("runs", "resume", "day", "--quiet").status == 0
    (stored,) = STORE.iterdir()
    assert read_calibration(stored).source == "day"
    assert "is complete; there is nothing to resume" in palpate("runs", "resume", "day").complaint


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("rounds", [in_process, served])
def test_no_kill_and_no_failed_write_loses_a_calibration_or_leaves_it_unused_unsaid(
    rounds: Any, tmp_path: Path
) -> None:
    chance = random.Random(7)
    with rounds(tmp_path, "load cell") as played:
        last = played.moments
        blows = [(n, "SIGKILL") for n in range(last["SIGKILL"] - 30, last["SIGKILL"], 10)]
        blows += [(last["ENOSPC"] - 3 * n, code) for n, code in enumerate(ERRORS)]
        for number, how in blows:
            found = played.play(number, how, chance)
            assert not sum(found[what] for what in CALIBRATION_FAULTS), (number, how, found)


# --- edited by hand ------------------------------------------------------------------------------------


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
    assert round(read_calibration(stored, LoadCellCalibration).sensitivity_mV_per_N, 1) == (13.3 if new else 10.3)


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


# --- whose it is ---------------------------------------------------------------------------------------


PLAIN = """
name = "plain"
purpose = "An exact bench."
design = "single"
model = "column"
[effects]
adc = "on"
"""
ODD = PLAIN + '[effects.load_cell]\nsensitivity = "10 mV/N"\n'
SWEPT = (*SWEEP, "--json")
FILMS = ("calibrate", "films", "--loads", "2 N, 3 N, 4 N", "--dwell", "0.2 s", "--quiet")


@pytest.fixture
def scenes(palpate: Palpate) -> None:
    for name, text in (("plain", PLAIN), ("odd", ODD)):
        Path(f"{name}.toml").write_text(text, encoding="utf-8")


def of_run(outcome: dict[str, object]) -> tuple[str, object, object]:
    """Digest of a run, and its calibrations."""
    digest = Run.open(Path(str(outcome["run"]))).digest()
    return digest, outcome["calibration"], outcome["film_calibration"]


@pytest.mark.slow
@pytest.mark.usefixtures("scenes")
def test_what_is_calibrated_on_a_simulated_bench_changes_no_run_of_another_scene_or_seed(palpate: Palpate) -> None:
    before = of_run(palpate(*SWEPT, "--scene", "plain.toml", "--seed", "3").object)
    for calibrate in (CELL, FILMS):
        for other in (("--scene", "odd.toml"), ("--scene", "plain.toml", "--seed", "4")):
            assert palpate(*calibrate, *other).status == 0
    assert of_run(palpate(*SWEPT, "--scene", "plain.toml", "--seed", "3").object) == before
    assert before[1:] == ("thesis Table 5.1", None)


CHANGES: list[Callable[[Scene], Scene]] = [
    lambda scene: scene.with_seed(2),
    lambda scene: replace(scene, model="column"),
    lambda scene: replace(scene, rig=scene.rig.model_copy(update={"coil_resistance": 3.6})),
    lambda scene: replace(scene, effects={}),
    lambda scene: replace(scene, design=replace(scene.design, name="other")),
    lambda scene: replace(scene, nodes=2),
]


def test_each_part_of_a_scene_makes_another_bench_of_it_and_names_and_units_do_not(tmp_path: Path) -> None:
    scene = read_scene("thesis_single")
    assert len({scene.identity, *(change(scene).identity for change in CHANGES)}) == 1 + len(CHANGES)
    spelled = ODD.replace('"plain"', '"other"').replace("10 mV/N", "0.01 V/N")
    assert scene_of(spelled, tmp_path).identity == scene_of(ODD, tmp_path).identity


@pytest.mark.usefixtures("own_store")
def test_a_client_of_a_served_bench_stores_for_its_scene_alone(lab: str, sim: SimulatedBench) -> None:
    cell = package.LoadCellSeries(loads=(1.5, 4.0, 7.0))
    sweep = package.LoadSweep(samples=("1",), loads=(2.0,), dwell=0.2)
    with package.open_bench(bench=lab, operator=sim.operator) as bench:
        made = package.run(cell, bench)
    assert read_calibration(Path(made.outcome["calibration_file"])).scene == sim.scene.identity
    other = Path("other.toml")
    other.write_text(Path(lab).read_text().replace(sim.scene.identity, "0123456789abcdef"), encoding="utf-8")
    for file, used in ((lab, made.folder.name), (str(other), "thesis Table 5.1")):
        with package.open_bench(bench=file, operator=sim.operator) as bench:
            assert package.run(sweep, bench).outcome["calibration"] == used


def test_a_run_tells_that_its_calibration_was_made_later_or_is_another_than_it_began_with(palpate: Palpate) -> None:
    path = Path(palpate(*CELL[:-1], "--json").object["calibration_file"])
    later = read_calibration(path).model_copy(update={"created": "2999-01-01T00:00:00+00:00"})
    write_calibration(path, later)
    assert "(made after the run began, on 2999-01-01T00:00:00+00:00)" in palpate(*SWEPT[:-1], "--out", "day").out
    rehash(Path("day"), status="stopped", header=lambda header: header["calibration"].update(source="another"))
    assert "; the run began with another)" in palpate("runs", "resume", "day", "--accept-change").out


def test_the_thesis_calibration_is_not_taken_for_another_gage_factor(lab: str, palpate: Palpate) -> None:
    text = Path(lab).read_text(encoding="utf-8").replace("gage_factor = 8.98", "gage_factor = 4.49")
    Path(lab).write_text(text, encoding="utf-8")
    said = palpate(*SWEPT, "--bench", lab, "--assume-mounted").refusal
    assert "at gage factor 8.98, this bench's is 4.49; set gage_factor" in said


def test_a_scripts_calibration_holds_for_later_runs_on_the_open_bench(tmp_path: Path, own_store: None) -> None:
    with package.open_bench(scene="ideal") as bench:
        made = package.run(package.LoadCellSeries(loads=(1.5, 4.0, 7.0)), bench, out=tmp_path / "cell")
        swept = package.run(package.LoadSweep(samples=("1",), loads=(2.0,)), bench, out=tmp_path / "sweep")
    assert swept.outcome["calibration"] == made.folder.name == "cell"
