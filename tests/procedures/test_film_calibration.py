"""The films are calibrated against the load cell, and later sweeps use and name the calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate import FilmSeries, Run, get_design, read_calibration
from palpate.extend import Bench, DeviceError, FilmCalibration, Lab, Recorder, read_scene
from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.procedures.engine.conduct import conduct
from palpate.procedures.measurements import work as dynamic_load
from palpate.procedures.steps.flags import UNSETTLED
from palpate.simulators.bench import SimulatedBench
from tests.procedures.conftest import HEADER, IDEAL_CALIBRATION, Palpate, scene_of
from tests.procedures.test_load_cell import CREATED

CALIBRATE = ("calibrate", "films", "--loads", "1 N, 2 N, 3 N", "--extrapolate", "--dwell", "0.2 s", "--json")
ONE_POINT = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.2 s", "--json")
SERIES = FilmSeries((2.0, 3.0, 4.0), dwell=0.2)
PAIR = """
name = "pair"
purpose = "Two teeth on one base that hear each other; a film that glue holds."
design = "common_base"

[effects.crosstalk]
[effects.glue_clamping]
factor = 0.5
[effects.adc]
"""


def test_crosstalk_and_clamping_of_a_scene_are_found(tmp_path: Path) -> None:
    with (
        SimulatedBench(scene_of(PAIR, tmp_path)) as sim,
        Bench(sim.description, sim.clock, sim.operator) as bench,
        Recorder.create(tmp_path / "run", HEADER) as record,
    ):
        lab = Lab(bench, get_design("common_base"), IDEAL_CALIBRATION, run="run", started=CREATED)
        result = conduct(SERIES, lab, record)
    found = result.calibration
    assert ([film.clamping for film in found.films], np.array(found.crosstalk)) == (
        pytest.approx([0.5, 0.5, 1.0], rel=2e-3),
        pytest.approx(np.array([[1, 0.052], [0.052, 1]]), abs=5e-4),
    )
    assert (found.device, found.expires) == (bench.device("sensor_node_1").serial, "2026-03-14")
    stored = Run.open(tmp_path / "run").points()
    assert [(p["tooth"], p["load_N"]) for p in stored] == [(t, n) for t in (1, 2) for n in (2.0, 3.0, 4.0)]
    assert all(len(p["voltages_V"]) == 3 and p["valid"] and not p["extrapolated"] for p in stored)


def test_a_point_that_stays_flagged_ends_the_calibration_with_what_was_taken(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measure = dynamic_load.measure
    taken = []

    def flagged(*arguments: object, **named: object) -> object:
        point = measure(*arguments, **named)  # type: ignore[arg-type]
        taken.append(point)
        if len(taken) == 2:
            object.__setattr__(point, "flags", (UNSETTLED,))
        return point

    monkeypatch.setattr(dynamic_load, "measure", flagged)
    with (
        Recorder.create(tmp_path / "run", HEADER) as record,
        pytest.raises(
            DeviceError, match=r"10 Hz, 3 N: .* not valid, .* unsettled: the films still drift .* wait longer"
        ),
    ):
        conduct(SERIES, Lab(bench, get_design("single"), THESIS_LOAD_CELL), record)
    assert [p["valid"] for p in Run.open(tmp_path / "run").points()] == [True, False]


@pytest.mark.slow
def test_a_sweep_uses_and_names_the_stored_film_calibration_alone_for_its_design(palpate: Palpate) -> None:
    before = palpate(*ONE_POINT).object
    assert before["film_calibration"] is None
    made = palpate(*CALIBRATE, "--budget").object
    path = Path(made["film_calibration_file"])
    found = read_calibration(path, FilmCalibration)
    assert found.simulated
    assert made["simulated"] is True
    assert [p["extrapolated"] for p in made["points"]] == [True, False, False]
    assert made["films"][1]["sensitivity_mV_per_N"] == found.films[1].sensitivity_mV_per_N
    assert [b["components"][0]["kind"] for b in made["budgets"]] == ["A", "A"]

    after = palpate(*ONE_POINT).object
    assert after["film_calibration"] == Path(made["run"]).name == found.source
    assert Run.open(Path(after["run"])).header["film_calibration"]["source"] == found.source  # type: ignore[index]
    (point,) = after["points"]
    assert point["force_total_N"] == pytest.approx(
        point["voltage_total_V"] / (1e-3 * found.films[1].sensitivity_mV_per_N)
    )
    scene = read_scene("thesis_single").identity
    assert path.name == f"films-20260101-single-scene-{scene}.toml"  # of this design and scene alone

    write_calibration(path, found.model_copy(update={"expires": "2024-02-29"}))
    said = palpate(*ONE_POINT)
    assert said.status == 2
    assert f"{path}: was made on a simulated bench" in said.complaint
    assert "expired on 2024-02-29; run palpate calibrate films" in said.complaint
