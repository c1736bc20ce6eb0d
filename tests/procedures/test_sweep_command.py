"""`palpate sweep loads`: sensors of several teeth, dwell by tolerance, plans, pauses."""

from __future__ import annotations

import os
import pty
from pathlib import Path
from statistics import fmean

import pytest

from palpate import open_bench, plan
from palpate.drivers.bench import Bench
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.lab import Lab
from palpate.procedures.lab.operator import Keyboard
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.records.record import Recorder
from palpate.procedures.records.run import Run
from palpate.procedures.steps.checks import parse_loads
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, OFF, Benches, Palpate, outputs
from tests.shares import first_of

SMALL = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N", "--dwell", "0.2 s", "--json")


# --- several teeth -------------------------------------------------------------------------------------


@pytest.mark.parametrize("design", first_of(["common_base", "different_base"]))
def test_an_array_gives_the_thesis_means_and_each_tooth(palpate: Palpate, design: str) -> None:
    found = palpate(*SMALL, "--scene", f"thesis_{design}").object
    assert found["softness_order"] == ["1", "2"]
    for mean in found["samples"]:
        assert mean["thesis_force_ratio"] == get_design(design).thesis_force_ratio[mean["sample"]]
        assert mean["force_ratio"] == pytest.approx(mean["thesis_force_ratio"], abs=3 * mean["force_ratio_u"])
    for point in found["points"]:
        teeth = point["teeth"]
        bases = 1 if design == "common_base" else 2
        assert [tooth["tooth"] for tooth in teeth] == [1, 2]
        assert point["force_rigid_N"] == pytest.approx(sum(tooth["force_N"] for tooth in teeth))
        assert point["force_ratio"] == pytest.approx(sum(tooth["force_ratio"] for tooth in teeth) / bases)
    (first, _) = Run.open(Path(found["run"])).points()
    assert first["teeth"] == found["points"][0]["teeth"]


@pytest.mark.slow
def test_the_nodes_of_an_array_are_recorded_together(palpate: Palpate) -> None:
    found = palpate(*SMALL, "--scene", "array_16").object
    waveforms = [w for w in Run.open(Path(found["run"])).waveforms() if w.point_id == 1]
    assert [w.name for w in waveforms] == [film.name for film in get_design("array_16").films]
    assert {(w.rate, w.samples.size) for w in waveforms} == {(250.0, 50)}
    assert [len(s["teeth"]) for s in found["samples"]] == [16, 16]


# --- refused before anything starts ----------------------------------------------------------------------


# --- dwell by tolerance ----------------------------------------------------------------------------------


def test_a_tolerance_chooses_the_dwell_by_the_points_own_noise(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "loud.toml"
    scene.write_text(
        'name = "loud"\npurpose = "noise"\ndesign = "single"\n[effects.white_noise]\ndensity = "40 µV/√Hz"\n'
    )
    loads = "1.5 N, 3.6 N, 3.7 N, 3.8 N, 3.9 N, 4 N"  # a short dwell tells its own noise to a seventh only
    arguments = ("sweep", "loads", "--samples", "2", "--loads", loads, "--tolerance", "12 %", "--json")
    small, *large = palpate(*arguments, "--scene", str(scene)).object["points"]
    assert small["dwell_s"] > 4 * large[-1]["dwell_s"]
    for point in (small, *large):
        assert point["dwell_s"] == pytest.approx(round(point["dwell_s"], 1))
        assert 0.041 < point["relative_u_predicted"] <= 0.06
        assert point["relative_u"] == pytest.approx(point["force_ratio_u"] / point["force_ratio"])
    for points in ([small], large):
        found, predicted = (fmean(point[key] for point in points) for key in ("relative_u", "relative_u_predicted"))
        assert found == pytest.approx(predicted, rel=0.15)


# --- plans -----------------------------------------------------------------------------------------------


def test_a_dry_run_prints_the_plan_and_sends_nothing(palpate: Palpate, benches: Benches) -> None:
    found = palpate("sweep", "loads", "--dry-run", "--json").object
    assert [(p["sample"], p["load_N"]) for p in found["points"]] == [
        (sample, load) for sample in "123456" for load in parse_loads("1.5 N:4 N:0.5 N")
    ]
    assert (found["dry_run"], benches, list(Path().iterdir())) == (True, [], [])
    assert "36 points, about 10 min" in palpate("sweep", "loads", "--dry-run").out


# --- pauses ----------------------------------------------------------------------------------------------


class Once:
    """Asks for a pause before the second point, and looks at the outputs meanwhile."""

    def __init__(self, sim: SimulatedBench) -> None:
        self._sim = sim
        self._points = 0
        self.seen: list[tuple[bool, bool, float]] = []

    def asked(self) -> bool:
        self._points += 1
        return self._points == 2

    def wait(self) -> None:
        self.seen.append(outputs(self._sim))
        self._sim.clock.wait(600.0)


def test_a_pause_switches_off_and_the_load_is_set_anew(sim: SimulatedBench, bench: Bench, tmp_path: Path) -> None:
    lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
    pause = Once(sim)
    with Recorder.create(tmp_path / "run", HEADER) as record:
        result = conduct(LoadSweep(("1",), (2.0, 3.0), 0.2), lab, record, pause=pause)
        record.finish("complete", result.summary())
    assert pause.seen == [OFF]
    assert [(p.load_N, p.valid) for p in result.points] == [(2.0, True), (3.0, True)]
    assert result.points[1].load_measured_N == pytest.approx(3.0, abs=0.12)
    assert [event["kind"] for event in Run.open(tmp_path / "run").events()] == ["paused", "resumed"]


def test_the_key_p_asks_for_a_pause_and_ends_it(capsys: pytest.CaptureFixture[str]) -> None:
    mine, terminal = pty.openpty()
    try:
        os.set_blocking(mine, False)
        keyboard = Keyboard(terminal)
        assert not keyboard.asked()
        os.write(mine, b"x\n")
        assert not keyboard.asked()
        os.write(mine, b"xp\n")
        assert keyboard.asked()
        assert not keyboard.asked()
        os.write(mine, b"P\n")
        keyboard.wait()
        assert "press p to go on" in capsys.readouterr().err
    finally:
        os.close(mine)
        os.close(terminal)


def test_without_loads_each_sensor_has_those_of_its_tables_by_command_and_in_python(palpate: Palpate) -> None:
    """Tables A2.9 to A2.14 end at 4 N, Tables A2.15 to A2.20 at 4.5 N: their printed means are of six and of seven."""
    for scene, sets in (("thesis_single", 6), ("thesis_common_base", 7), ("thesis_different_base", 6)):
        planned = palpate("sweep", "loads", "--scene", scene, "--samples", "1", "--dry-run", "--json").object["points"]
        assert [each["load_N"] for each in planned] == [1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5][:sets]
    with open_bench(scene="thesis_common_base") as bench:
        assert len(plan(LoadSweep(samples=("1",)), bench).steps) == 7
        assert len(plan(LoadSweep(samples=("1",), loads=(2.0, 3.0)), bench).steps) == 2


def test_the_loads_that_a_sensor_filled_in_are_in_the_record(palpate: Palpate) -> None:
    palpate("sweep", "loads", "--scene", "thesis_common_base", "--samples", "1", "--dwell", "0.2 s", "--out", "run")
    run = Run.open(Path("run"))
    assert run.header["settings"]["loads"] == [1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5]
    assert [point["valid"] for point in run.points()] == [True] * 7
