"""`palpate sweep loads`, `position`, `frequency` and `temperature`: what each finds, plans, pauses and refusals."""

from __future__ import annotations

import math
import os
import pty
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any
from unittest.mock import Mock

import numpy as np
import pytest

from palpate import LoadSweep, Run, get_design, open_bench, plan
from palpate.extend import Bench, Lab, Recorder
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.signals.frequency_response import high_pass
from palpate.instrument.thesis import read_table
from palpate.procedures.commands import procedures
from palpate.procedures.commands.options import BenchChoice
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.lab.operator import Keyboard
from palpate.procedures.measurements.frequency import (
    FilmFrequencyResponse,
    FrequencyPoint,
    dwell_at,
    evaluate,
    parse_frequencies,
)
from palpate.procedures.steps.checks import parse_loads
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, IDEAL_SCENE, OFF, Benches, Palpate, outputs
from tests.shares import first_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = ("sweep", "loads", "--samples", "1,2", "--loads", "2 N", "--dwell", "0.2 s", "--json")


# --- several teeth -------------------------------------------------------------------------------------


@pytest.mark.parametrize("design", first_of(["common_base", "different_base"]))
def test_an_array_gives_the_thesis_means_and_each_tooth(palpate: Palpate, design: str) -> None:
    found = palpate(*SMALL, "--scene", f"thesis_{design}").object
    assert found["softness_order"] == ["1", "2"]
    for mean in found["samples"]:
        assert (mean["thesis_force_ratio"], mean["force_ratio"]) == (
            get_design(design).thesis_force_ratio[mean["sample"]],
            pytest.approx(mean["thesis_force_ratio"], abs=3 * mean["force_ratio_u"]),
        )
    for point in found["points"]:
        teeth = point["teeth"]
        bases = 1 if design == "common_base" else 2
        assert ([tooth["tooth"] for tooth in teeth], point["force_rigid_N"]) == (
            [1, 2],
            pytest.approx(sum(tooth["force_N"] for tooth in teeth)),
        )
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


def test_a_pause_switches_off_and_the_load_is_set_anew(sim: SimulatedBench, bench: Bench, tmp_path: Path) -> None:
    lab = Lab(bench, get_design("single"), THESIS_LOAD_CELL)
    seen: list[tuple[bool, bool, float]] = []
    pause = Mock(asked=Mock(side_effect=[False, True]))  # before the second point
    pause.wait.side_effect = lambda: (seen.append(outputs(sim)), sim.clock.wait(600.0))
    with Recorder.create(tmp_path / "run", HEADER) as record:
        result = conduct(LoadSweep(("1",), (2.0, 3.0), 0.2), lab, record, pause=pause)
        record.finish("complete", result.summary())
    assert (seen, [(p.load_N, p.valid) for p in result.points]) == ([OFF], [(2.0, True), (3.0, True)])
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


def test_without_loads_each_sensor_has_those_of_its_tables_by_command_in_python_and_in_the_record(
    palpate: Palpate,
) -> None:
    """Tables A2.9 to A2.14 end at 4 N, Tables A2.15 to A2.20 at 4.5 N: their printed means are of six and of seven."""
    for scene, sets in (("thesis_single", 6), ("thesis_common_base", 7), ("thesis_different_base", 6)):
        planned = palpate("sweep", "loads", "--scene", scene, "--samples", "1", "--dry-run", "--json").object["points"]
        assert [each["load_N"] for each in planned] == [1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5][:sets]
    palpate("sweep", "loads", "--scene", "thesis_common_base", "--samples", "1", "--dwell", "0.1 s", "--out", "run")
    run = Run.open(Path("run"))
    assert run.header["settings"]["loads"] == [1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5]
    assert [point["valid"] for point in run.points()] == [True] * 7
    with open_bench(scene="thesis_common_base") as bench:
        assert len(plan(LoadSweep(samples=("1",)), bench).steps) == 7
        assert len(plan(LoadSweep(samples=("1",), loads=(2.0, 3.0)), bench).steps) == 2


# --- `palpate sweep position` -------------------------------------------------------------------------


POSITION = ("sweep", "position")


def test_a_load_between_the_teeth_is_found_with_its_size(palpate: Palpate) -> None:
    found = palpate(*POSITION, "--positions", "10 mm, 12 mm", "--dwell", "0.5 s", "--json").object
    assert (found["design"], found["scene"]) == ("common_base", "thesis_common_base")
    table = read_table("A2.7")
    for point, place in zip(found["points"], (10.0, 12.0), strict=True):
        assert point["valid"]
        assert point["found_mm"] == pytest.approx(place, abs=3 * point["found_u"])
        assert point["found_u"] < 0.5
        assert (point["found_force_N"], point["share_left"], point["share_right"]) == (
            pytest.approx(2.0, abs=3 * point["found_force_u"]),
            pytest.approx(point["model_share_left"], abs=3 * point["share_left_u"]),
            pytest.approx(point["model_share_right"], abs=3 * point["share_right_u"]),
        )
        (row,) = (i for i, x in enumerate(table.keys()) if x == place)
        assert point["thesis_share_left"] == table.values("force_pvdf3_N")[row]
    assert found["position_rms_mm"] < 0.5
    assert "Table A2.7" in found["thesis_doubt"]


def test_the_model_is_drawn_between_the_positions_and_places_by_how_far_they_are_off(
    palpate: Palpate, figures: list[Figure]
) -> None:
    printed = palpate(*POSITION, "--positions", "6 mm, 10 mm", "--dwell", "0.1 s").out
    assert "0.998" in printed  # the thesis' shares have as many digits as ours
    assert "e-05" not in printed
    left, right = figures[0].axes
    (model,) = (line for line in left.lines if line.get_label() == "left, model")
    shares = np.asarray(model.get_ydata())
    assert shares[59:62] == pytest.approx(0.769, abs=1e-3)  # above the tooth, at 6 mm
    (found,) = right.containers
    assert list(found[0].get_xdata()) == [6.0, 10.0]
    assert np.abs(found[0].get_ydata()).max() < 2


# --- `palpate sweep frequency` ------------------------------------------------------------------------


FREQUENCY = ("sweep", "frequency")


@pytest.mark.slow
def test_the_corner_of_each_film_is_that_of_its_charge_amplifier(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "slow.toml"
    scene.write_text(IDEAL_SCENE + '[effects.charge_amplifier]\ntime_constant = "0.5 s"\n[effects.load_cell]\n')
    arguments = ("--scene", str(scene), "--frequencies", "0.2 Hz, 0.5 Hz, 30 Hz", "--dwell", "0.1 s", "--json")
    found = palpate(*FREQUENCY, *arguments, "--budget").object
    of_rigid, above, *_ = found["budgets"]
    assert [each["quantity"] for each in (of_rigid, above)] == ["corner of film rigid", "gain of film rigid"]
    assert (of_rigid["u"], above["u"]) == (found["corners"][0]["corner_u"], found["corners"][0]["gain_u"])
    assert [part["name"] for part in above["components"]] == ["points of the sweep", "load cell"]
    for corner in found["corners"]:
        assert (corner["corner_Hz"], corner["corner_Hz"]) == (
            pytest.approx(1 / math.pi, abs=2 * corner["corner_u"]),
            pytest.approx(1 / math.pi, rel=0.03),
        )
    assert [(p["frequency_Hz"], p["tactile"], p["valid"]) for p in found["points"]] == [
        (0.2, True, True), (0.5, True, True), (30.0, False, True),
    ]  # fmt: skip
    for point in found["points"]:
        rigid, total = point["films"]
        assert abs(rigid["phase_deg"]) < 0.2  # both amplifiers are alike
        assert (total["phase_deg"], total["phase_u"]) == (0, 0)
    assert found["points"][2]["films"][1]["gain_V_per_N"] == pytest.approx(68.6e-3, rel=0.02)
    assert len(Run.open(Path(found["run"])).points()) == 3


@pytest.mark.slow
def test_stated_uncertainties_hold_where_all_points_share_the_load_cell_s_error() -> None:
    """The load cell's curve is made to err by much: that is no scatter of the gains, and does not move the corner."""
    random, design, frequency = np.random.default_rng(7), get_design("single"), np.geomspace(0.1, 100, 13)
    calibration = THESIS_LOAD_CELL.model_copy(update={"sensitivity_u": 0.05 * THESIS_LOAD_CELL.sensitivity_mV_per_N})
    load, load_u = calibration.load(calibration.reading(2.0))
    curve_u, exact = calibration.curve_u(load) / load, np.exp(high_pass(frequency, 0.0, 0.159))
    z = []
    for _ in range(40):
        shared = curve_u * random.standard_normal()
        own = math.sqrt((load_u / load) ** 2 - curve_u**2) * random.standard_normal(13)
        points = []
        for f, gain, error in zip(frequency.tolist(), exact.tolist(), own.tolist(), strict=True):
            films = [
                FilmFrequencyResponse(
                    film.name,
                    gain * (1 + shared + error + film.scatter * random.standard_normal()),
                    gain * math.hypot(film.scatter, load_u / load),
                    phase_deg=0.0,
                    phase_u=0.0,
                )
                for film in design.films
            ]
            points.append(FrequencyPoint(f, False, load, load_u, 1.0, tuple(films), True, 1.0, 0.0, 1, ()))
        corners = evaluate(points, design, calibration).corners.values()
        z += [[(c.gain - 1) / c.gain_u, (c.corner_Hz - 0.159) / c.corner_u] for c in corners if c is not None]
    assert (len(z), np.std(z, axis=0)) == (80, pytest.approx([1, 1], rel=0.2))


def test_frequencies_are_even_in_the_logarithm_and_whole_millihertz() -> None:
    assert (parse_frequencies("0.1 Hz:100 Hz:4"), parse_frequencies("1 Hz:2 Hz:3")) == (
        (0.1, 1.0, 10.0, 100.0),
        (1.0, 1.414, 2.0),
    )
    assert parse_frequencies("1 Hz, 3 Hz, 5 Hz") == (1.0, 3.0, 5.0)


def test_a_dwell_is_of_whole_cycles_three_at_least() -> None:
    assert (dwell_at(0.1, 1.0), dwell_at(10.0, 1.0)) == (pytest.approx(30.0), pytest.approx(1.0))
    assert dwell_at(17.783, 1.0) * 17.783 == pytest.approx(18)


# --- `palpate sweep temperature` ----------------------------------------------------------------------


TEMPERATURE = ("sweep", "temperature")
WARM = (
    IDEAL_SCENE
    + """[effects.charge_amplifier]
[effects.load_cell]
[effects.pyroelectric]
drift = "1 mK/s"
settling = "200 s"
[effects.white_noise]
density = "0.3 µV/√Hz"
"""
)  # the noise dithers the sixteen bits of the bus


def off_by(points: list[dict[str, Any]], settling: float) -> float:
    """The farthest that an offset of a valid point is from what a charge amplifier of 1 s makes of the films' warming,
    in its standard uncertainties."""
    away = []
    for point in (each for each in points if each["valid"]):
        after = point["offset_after_s"]
        left = (math.exp(-after / settling) - math.exp(-after)) / (settling - 1)
        for film, newtons in zip(point["films"], (9.2, 150.0), strict=True):
            away.append(abs(film["offset_N"] - newtons * point["step_K"] * left) / film["offset_u"])
    assert away
    return max(away)


@pytest.mark.slow
def test_offsets_are_those_of_the_films_and_the_ratio_is_spared(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "warm.toml"
    scene.write_text(WARM)
    arguments = (
        "--seed",
        "3",  # the drive's phase, on which the error of a lock-in depends
        "--temperatures",
        "0 K, 10 K, 5 K",
        "--load",
        "4 N",
        "--dwell",
        "2 s",
        "--scene",
        str(scene),
        "--json",
        "--budget",
    )
    found = palpate(*TEMPERATURE, *arguments).object
    assert [(p["temperature_K"], p["step_K"], p["valid"]) for p in found["points"]] == [
        (0, 0, True), (10, 10, True), (5, -5, True),
    ]  # fmt: skip
    assert off_by(found["points"], settling=200.0) < 2
    for offset, newtons in zip(found["offsets"], (9.2, 150.0), strict=True):
        assert math.exp(-12 / 200) < offset["offset_N_per_K"] / (newtons / 200) < 1
        assert 0.03 < offset["offset_u"] / offset["offset_N_per_K"] < 0.04  # the gain of a film is all rows' own
    told = [(f"offset of film {each['film']}", each["offset_N_per_K"], each["offset_u"]) for each in found["offsets"]]
    told.append(("change of the force ratio with a trend", found["ratio_per_K"], found["ratio_per_K_u"]))
    assert [(b["quantity"], b["value"], pytest.approx(b["u"], rel=1e-12)) for b in found["budgets"]] == told
    for budget, kinds in zip(found["budgets"], ("AB", "AB", "B"), strict=True):  # the gain is no reading's own
        assert "".join(component["kind"] for component in budget["components"]) == kinds
    assert [row["degrees_of_freedom"] for row in found["budgets"][0]["components"]] == [1, None]
    ratios = [p["force_ratio"] for p in found["points"]]
    assert max(ratios) / min(ratios) - 1 < 1e-3
    scatter = float(np.std(ratios, ddof=1) / np.mean(ratios))  # of noise and of the bus' bits, wherever dwells begin
    assert abs(found["largest_error_lock_in"]) > 2 * scatter
    assert abs(found["ratio_per_K"]) < found["ratio_per_K_u"]


def test_a_dry_run_counts_the_soak(palpate: Palpate, benches: Benches) -> None:
    found = palpate(*TEMPERATURE, "--soak", "10 min", "--dry-run", "--json").object
    assert (found["expected_seconds"], benches) == (pytest.approx(4 * 600 + 4 * 10 + 110, rel=0.05), [])


def test_films_that_warm_up_are_simulated_where_no_scene_is_named(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen: list[BenchChoice] = []
    monkeypatch.setattr(procedures, "measure", lambda _asked, choice, *_rest: chosen.append(choice))
    palpate(*TEMPERATURE)
    palpate(*TEMPERATURE, "--scene", "ideal")
    palpate(*TEMPERATURE, "--bench", "lab.toml")
    assert [(choice.scene, choice.bench) for choice in chosen] == [
        ("humid_body", None), ("ideal", None), (None, Path("lab.toml")),
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "settling"), [("humid_body", 850.0), ("everything", 300.0), ("long_drift", 1e5)])
def test_every_scene_whose_films_warm_up_gives_what_each_change_adds_and_no_other_drift(
    palpate: Palpate, scene: str, settling: float
) -> None:
    """An amplifier's offset by damp is 1.6 N of the tooth's film, where 5 K add 0.05 N."""
    changes = ("--temperatures", "0.5 K, -4.5 K, 10.5 K, 10.5 K", "--soak", "1 min", "--dwell", "0.4 s")
    points = palpate(*TEMPERATURE, *changes, "--scene", scene, "--json").object["points"]
    assert [point["step_K"] for point in points] == [0.5, -5, 15, 0]
    assert off_by(points, settling) < 2
    assert sum(point["valid"] for point in points) >= 3
