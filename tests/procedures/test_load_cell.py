"""The load cell is calibrated with dead weights, and later sweeps use and name the calibration."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from scipy.stats import chi2

from drivers.bench import Bench
from instrument.calibration import THESIS_LOAD_CELL, read_calibration, write_calibration
from instrument.errors import DeviceError
from procedures import load_cell
from procedures.load_cell import LoadCellResult
from procedures.record import Recorder
from procedures.run import Run
from simulators.bench import SimulatedBench
from simulators.scene import Scene
from tests.procedures.conftest import HEADER, IDEAL_SCENE, Palpate, scene_of, silent

CREATED = "2025-03-14T15:09:26+00:00"
FILE = Path("runs") / "calibrations" / "load_cell-SIM-SI-0001.toml"
ONE_POINT = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s", "--json")
RESULT = {
    "simulated", "run", "seed", "bench_seconds", "wall_seconds", "sensitivity_mV_per_N", "sensitivity_u", "zero_mV",
    "linearity", "reversibility", "resolution", "points",
}  # fmt: skip


def calibrate(scene: Scene, folder: Path) -> LoadCellResult:
    with (
        SimulatedBench(scene) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
        Recorder.create(folder, HEADER) as record,
    ):
        return load_cell.run(bench, record, silent, CREATED)


@pytest.fixture(scope="module")
def calibrated(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> list[LoadCellResult]:
    """Results of five seeds."""
    folder = tmp_path_factory.mktemp("calibrations")
    return [calibrate(scene.with_seed(seed), folder / str(seed)) for seed in (1, 2, 3, 4, 5)]


# --- the figures ---------------------------------------------------------------------------------------


def test_the_sensitivity_is_that_of_table_5_1(calibrated: list[LoadCellResult]) -> None:
    for result in calibrated:
        summary = result.summary()
        assert summary["sensitivity_mV_per_N"] == pytest.approx(10.3, abs=0.1)
        assert summary["zero_mV"] == pytest.approx(1.81, abs=0.5)


def test_the_stated_uncertainties_cover_what_the_scene_holds(calibrated: list[LoadCellResult]) -> None:
    # The stated ones stand for steps of a whole millivolt, which the display's own noise smooths: the results
    # lie nearer to the truth than stated, never farther.
    for value, u, true in (
        ("sensitivity_mV_per_N", "sensitivity_u", 10.306),
        ("zero_mV", "zero_u", 1.81),
    ):
        results = [r.summary() for r in calibrated]
        assert sum(((r[value] - true) / r[u]) ** 2 for r in results) < chi2.ppf(0.999, len(results))
        assert sum(((r[value] - true) / r[u]) ** 2 for r in results) > 0.01
    assert all(r.summary()["sensitivity_u"] == pytest.approx(0.056, rel=0.1) for r in calibrated)


def test_linearity_and_reversibility_are_fractions_of_the_span(calibrated: list[LoadCellResult]) -> None:
    for result in calibrated:
        summary, c = result.summary(), result.calibration
        span = c.sensitivity_mV_per_N * (0.740 - 0.140) * 9.80665
        mean = {
            p["load_gf"]: [q["reading_mV"] for q in result.points if q["load_gf"] == p["load_gf"]]
            for p in result.points
        }
        deviations = [sum(y) / 2 - c.reading(1e-3 * gf * 9.80665) for gf, y in mean.items()]
        assert summary["linearity"] == pytest.approx(max(map(abs, deviations)) / span)
        assert summary["reversibility"] == pytest.approx(max(abs(up - down) for up, down in mean.values()) / span)
        assert 0 < summary["linearity"] < 0.01
        assert 0 < summary["reversibility"] < 0.02
        assert summary["resolution"] == 1.0
        assert summary["resolution_N"] == pytest.approx(0.097, abs=0.001)


def test_weights_go_up_and_down_as_in_table_5_1_and_every_reading_is_kept(
    scene: Scene, calibrated: list[LoadCellResult], tmp_path: Path
) -> None:
    up = [140.0, 240.0, 340.0, 440.0, 540.0, 640.0, 740.0]
    points = calibrated[0].points
    assert [(p["direction"], p["load_gf"]) for p in points] == [
        *(("loading", gf) for gf in up), *(("unloading", gf) for gf in up[::-1]),
    ]  # fmt: skip
    assert all(len(p["readings_mV"]) == 10 for p in points)
    assert all(p["reading_mV"] == pytest.approx(sum(p["readings_mV"]) / 10) for p in points)
    again = calibrate(scene, tmp_path / "run")
    stored = [{k: v for k, v in p.items() if k not in ("id", "bench_ns")} for p in Run.open(tmp_path / "run").points()]
    assert stored == again.points == points


def test_without_imperfections_the_line_is_exact(tmp_path: Path) -> None:
    summary = calibrate(scene_of(IDEAL_SCENE, tmp_path), tmp_path / "run").summary()
    assert summary["sensitivity_mV_per_N"] == pytest.approx(10.306, rel=1e-5)
    assert summary["zero_mV"] == pytest.approx(0, abs=1e-4)
    assert summary["resolution"] == 1e-4
    assert summary["linearity"] < 1e-5


@pytest.mark.parametrize(("bit", "message"), [(1, "overload"), (2, "bridge open"), (None, "not stable")])
def test_a_reading_that_is_not_valid_ends_the_calibration(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, bit: int | None, message: str
) -> None:
    read = sim.indicator.read
    status = 0.0 if bit is None else float(1 | 1 << bit)

    def sick(name: str) -> float:
        return status if name == "status" and sim.rig._weight > 3 else read(name)

    monkeypatch.setattr(sim.indicator, "read", sick)
    with Recorder.create(tmp_path / "run", HEADER) as record, pytest.raises(DeviceError, match=message):
        load_cell.run(bench, record, silent, CREATED)
    assert [p["load_gf"] for p in Run.open(tmp_path / "run").points()] == [140.0, 240.0]


# --- from the command line to the next sweep -----------------------------------------------------------


def test_the_command_gives_the_public_names_and_stores_the_calibration(palpate: Palpate) -> None:
    result = palpate("calibrate", "load-cell", "--json").object
    assert result.keys() >= RESULT
    assert result["calibration_file"] == str(FILE)
    stored = tomllib.loads(FILE.read_text(encoding="utf-8"))
    assert stored["sensitivity_mV_per_N"] == result["sensitivity_mV_per_N"]
    assert (stored["device"], stored["simulated"]) == ("SIM-SI-0001", True)
    assert stored["source"] == Path(result["run"]).name
    assert (Path(result["run"]) / "calibration.toml").read_bytes() == FILE.read_bytes()


def test_a_sweep_without_a_calibration_uses_and_names_the_thesis_own(palpate: Palpate) -> None:
    result = palpate(*ONE_POINT).object
    assert result["calibration"] == "thesis Table 5.1"
    (point,) = result["points"]
    assert point["load_measured_N"] == THESIS_LOAD_CELL.load(point["indicator_mV"])[0]


def test_the_next_sweep_uses_and_names_the_stored_calibration(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(IDEAL_SCENE, encoding="utf-8")
    before = palpate(*ONE_POINT, "--scene", str(scene)).object
    made = palpate("calibrate", "load-cell", "--scene", str(scene), "--json").object
    after = palpate(*ONE_POINT, "--scene", str(scene)).object
    assert after["calibration"] == Path(made["run"]).name
    assert Run.open(Path(after["run"])).header["calibration"]["source"] == Path(made["run"]).name
    (point,) = after["points"]
    assert point["load_measured_N"] == pytest.approx(read_calibration(FILE).load(point["indicator_mV"])[0])
    assert point["force_total_N"] == pytest.approx(point["load_measured_N"], rel=1e-3)
    # the thesis' zero of 1.81 mV is not this bench's, whose load was too large by so much
    assert before["points"][0]["force_total_N"] - before["points"][0]["load_measured_N"] == pytest.approx(
        0.176, abs=0.005
    )


def test_a_store_of_ones_own_is_used(palpate: Palpate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PALPATE_STORE", str(tmp_path / "elsewhere"))
    palpate("calibrate", "load-cell", "--quiet")
    assert (tmp_path / "elsewhere" / "calibrations" / FILE.name).exists()
    assert palpate(*ONE_POINT).object["calibration"].endswith("-calibrate-load-cell")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"simulated": False}, "made on hardware"),
        ({"device": "SI-0042"}, "with device SI-0042, not for this bench's SIM-SI-0001"),
    ],
)
def test_a_calibration_of_another_device_or_of_hardware_is_refused(
    palpate: Palpate, changed: dict[str, Any], message: str
) -> None:
    FILE.parent.mkdir(parents=True)
    own = {"device": "SIM-SI-0001", "simulated": True}
    write_calibration(FILE, THESIS_LOAD_CELL.model_copy(update={**own, **changed}))
    said = palpate(*ONE_POINT)
    assert said.status == 2
    assert message in said.complaint
    assert [path.name for path in Path("runs").iterdir()] == ["calibrations"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensitivity_mV_per_N = 10.3\nzero_mv = 1.8", "zero_mv: unknown key (did you mean 'zero_mV'?)"),
        ("sensitivity = ", "is not TOML"),
        ("sensitivity_mV_per_N = nan", "sensitivity_mV_per_N"),
    ],
)
def test_a_damaged_calibration_is_one_clear_error(palpate: Palpate, text: str, message: str) -> None:
    FILE.parent.mkdir(parents=True)
    FILE.write_text(text, encoding="utf-8")
    said = palpate(*ONE_POINT)
    assert said.status == 2
    assert str(FILE) in said.complaint
    assert message in said.complaint
    assert [path.name for path in Path("runs").iterdir()] == ["calibrations"]


def test_a_calibration_that_cannot_be_stored_is_still_in_its_run(palpate: Palpate) -> None:
    Path("runs").mkdir()
    (Path("runs") / "calibrations").touch()
    said = palpate("calibrate", "load-cell", "--out", "day")
    assert said.status == 1
    assert "calibrations" in said.complaint
    assert read_calibration(Path("day") / "calibration.toml").device == "SIM-SI-0001"
    assert Run.open(Path("day")).status == "complete"
