"""A load that is repeated is a load set of its own, with gains of its own, wherever load sets are kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.engine.dataset import as_dataset
from palpate.procedures.lab.chosen import choose
from palpate.procedures.measurements.films import FilmSeries
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.measurements.softness import SoftnessTest
from palpate.procedures.records.run import Run
from palpate.procedures.study.results import Results
from palpate.procedures.study.run import one_by_one
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.waveforms import load_sets
from tests.procedures.conftest import sweep_scene
from tests.procedures.studies import study_from

SAME = (3.0, 3.0, 4.0, 4.0)
QUIET = replace(
    read_scene("thesis_single"),
    effects={name: each for name, each in read_scene("thesis_single").effects.items() if name != "white_noise"},
)


def apart(ratios: list[float]) -> bool:
    """Whether all of them have other gains; two of one set would agree to a ten-thousandth."""
    return min(abs(a / b - 1) for n, a in enumerate(ratios) for b in ratios[:n]) > 1e-3


@pytest.mark.slow
def test_each_repetition_on_a_bench_is_a_point_with_gains_of_its_own(tmp_path: Path) -> None:
    result = sweep_scene(QUIET, tmp_path, samples=("2",), loads=SAME, dwell=0.5)
    assert [point.load_N for point in result.points] == list(SAME)
    assert apart([point.force_ratio for point in result.points])
    assert all(point.valid for point in result.points)
    (mean,), (budget,) = result.samples, result.budgets
    assert mean.valid_points == 4
    assert budget.u / budget.value == pytest.approx(0.041 / 2, rel=0.05)


def test_each_repetition_in_closed_form_has_gains_of_its_own() -> None:
    sets = list(load_sets(QUIET, get_sample("2"), SAME, 10.0, 0.5))
    assert [each.load for each in sets] == list(SAME)
    assert apart([float(np.divide(*np.ptp(each.voltage, axis=1))) for each in sets])


def test_steps_of_repeated_loads_are_told_apart_and_only_the_first_takes_long() -> None:
    target = choose(None, "thesis_single").target
    sweep = LoadSweep(("2",), SAME).plan(target).steps
    told = ["sample 2, 3 N", "sample 2, 3 N, set 2", "sample 2, 4 N", "sample 2, 4 N, set 2"]
    assert [step.what for step in sweep] == told
    assert len({step.seconds_expected for step in sweep[1:]}) == 1
    assert sweep[0].seconds_expected > sweep[1].seconds_expected
    softness = SoftnessTest((get_sample("2"),), SAME).plan(target).steps
    assert [step.what for step in softness][:2] == ["2, 3 N", "2, 3 N, set 2"]
    films = FilmSeries(loads=(2.0, 3.0, 4.0, 4.0)).plan(target).steps
    assert films[-1].what.endswith("4 N, set 2")


@pytest.mark.slow
def test_a_study_keeps_repetitions_apart_in_its_table_and_its_dataset() -> None:
    study = study_from('name = "s"\nloads = "4 N, 4 N"\ndwell = "0.5 s"\n[axes]\nseed = [1]\n')
    rows = StudyComputation.of(study, "s")(study.cell(0))
    results = Results(study, [one_by_one(lambda _: rows, study, range(1))])
    ratios = results.table().force_ratio.tolist()
    assert apart(ratios)
    pytest.importorskip("xarray")
    assert results.dataset().force_ratio.sel(load_N=4.0).values.ravel().tolist() == ratios


def test_a_run_exports_repetitions_as_points_of_their_own(tmp_path: Path) -> None:
    sweep_scene(QUIET, tmp_path, samples=("2",), loads=(4.0, 4.0), dwell=0.2)
    (folder,) = [path.parent for path in tmp_path.rglob("run.record")]
    assert Run.open(folder).table().load_N.tolist() == [4.0, 4.0]
    pytest.importorskip("xarray")
    dataset = as_dataset(Run.open(folder))
    assert dataset.load_N.values.tolist() == [4.0, 4.0]
    assert apart(dataset.force_ratio.values.tolist())
