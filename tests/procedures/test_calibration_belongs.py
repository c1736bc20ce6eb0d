"""A calibration is used on the bench of its own scene and on no other, and a run tells what speaks against its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import palpate as package
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.procedures.records.run import Run
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.scenes.scene import Scene
from tests.procedures.conftest import Palpate, scene_of
from tests.runs import rehash

PLAIN = """
name = "plain"
purpose = "An exact bench."
design = "single"
model = "column"
[effects]
adc = "on"
"""
ODD = PLAIN + '[effects.load_cell]\nsensitivity = "10 mV/N"\n'
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s", "--json")
LOAD_CELL = ("calibrate", "load-cell", "--loads", "1.5 N, 4 N, 7 N", "--quiet")
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
    before = of_run(palpate(*SWEEP, "--scene", "plain.toml", "--seed", "3").object)
    for calibrate in (LOAD_CELL, FILMS):
        for other in (("--scene", "odd.toml"), ("--scene", "plain.toml", "--seed", "4")):
            assert palpate(*calibrate, *other).status == 0
    assert of_run(palpate(*SWEEP, "--scene", "plain.toml", "--seed", "3").object) == before
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
    spelled = ODD.replace('"plain"', '"other"').replace("10 mV/N", "0.01 V/N") + 'zero_offset = "0 mV"\n'
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
    path = Path(palpate(*LOAD_CELL[:-1], "--json").object["calibration_file"])
    later = read_calibration(path).model_copy(update={"created": "2999-01-01T00:00:00+00:00"})
    write_calibration(path, later)
    assert "(made after the run began, on 2999-01-01T00:00:00+00:00)" in palpate(*SWEEP[:-1], "--out", "day").out
    rehash(Path("day"), status="stopped", header=lambda header: header["calibration"].update(source="another"))
    assert "; the run began with another)" in palpate("runs", "resume", "day", "--accept-change").out


def test_the_thesis_calibration_is_not_taken_for_another_gage_factor(lab: str, palpate: Palpate) -> None:
    text = Path(lab).read_text(encoding="utf-8").replace("gage_factor = 8.98", "gage_factor = 4.49")
    Path(lab).write_text(text, encoding="utf-8")
    said = palpate(*SWEEP, "--bench", lab, "--assume-mounted").refusal
    assert "at gage factor 8.98, this bench's is 4.49; set gage_factor" in said


def test_a_scripts_calibration_holds_for_later_runs_on_the_open_bench(tmp_path: Path, own_store: None) -> None:
    with package.open_bench(scene="ideal") as bench:
        made = package.run(package.LoadCellSeries(loads=(1.5, 4.0, 7.0)), bench, out=tmp_path / "cell")
        swept = package.run(package.LoadSweep(samples=("1",), loads=(2.0,)), bench, out=tmp_path / "sweep")
    assert swept.outcome["calibration"] == made.folder.name == "cell"
