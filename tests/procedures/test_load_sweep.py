"""The load-set sweep measures what the scene holds, and says how well."""

from __future__ import annotations

import csv
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate import (
    FilmSeries,
    Load,
    LoadSweep,
    RangeError,
    Run,
    SoftnessTest,
    as_dataset,
    get_design,
    get_sample,
    response,
)
from palpate.extend import Bench, Scene, read_scene
from palpate.instrument.errors import UnreachableError
from palpate.instrument.sensor.sample import SAMPLES
from palpate.instrument.signals.estimate import fit_sine
from palpate.procedures.lab.chosen import choose
from palpate.procedures.measurements.loads import LoadPoint, evaluate
from palpate.procedures.steps.checks import parse_loads
from palpate.procedures.study.results import Results
from palpate.procedures.study.run import one_by_one
from palpate.procedures.virtual.study_cell import StudyComputation
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.planning.settle import with_model
from tests.chance import amplitude_ratio, plausible
from tests.procedures.conftest import IDEAL_CALIBRATION, IDEAL_SCENE, scene_of, sweep, sweep_scene
from tests.procedures.studies import study_from
from tests.shares import first_of

LOADS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
MORE_LOADS = (1.6, 2.4, 3.2, 3.9)  # many to a sample: mounting one takes as long as measuring five
REPEATABILITY = 0.041  # of the force ratio, thesis Tables A2.9 to A2.14
TABLES = Path(__file__).parents[1] / "data" / "thesis"
POINT = {
    "sample", "load_N", "indicator_mV", "voltage_rigid_V", "voltage_total_V", "force_rigid_N", "force_total_N",
    "force_rigid_u", "force_total_u", "force_ratio", "force_ratio_u", "valid",
}  # fmt: skip
SWEEP = {
    "simulated", "run", "design", "seed", "bench_seconds", "wall_seconds", "points", "samples", "softness_order",
}  # fmt: skip
SAMPLE = {"sample", "force_ratio", "force_ratio_u", "thesis_force_ratio"}


def printed_averages() -> dict[str, float]:
    with (TABLES / "experiments_printed_averages_A2_9_to_A2_20.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["arrangement"] == "single"]
    return {row["sample"]: float(row["average_force_ratio"]) for row in rows}


def modelled(sample: str, model: str) -> float:
    return response(get_design("single"), Load(force=1.0, sensed=SAMPLES[sample]), model).force_ratio


# --- the default sweep ---------------------------------------------------------------------------------


def test_the_default_sweep_has_every_load_set_of_the_thesis_under_the_public_names(
    default_sweep: dict[str, Any],
) -> None:
    assert default_sweep.keys() >= SWEEP
    assert default_sweep["simulated"] is True
    assert (default_sweep["design"], default_sweep["seed"]) == ("single", 1)
    assert default_sweep["bench_seconds"] > 36 * 6 > default_sweep["wall_seconds"] > 0
    assert Path(default_sweep["plot"]).read_bytes().startswith(b"\x89PNG")
    points = default_sweep["points"]
    assert [(p["sample"], p["load_N"]) for p in points] == [(s, load) for s in "123456" for load in LOADS]
    assert all(p.keys() >= POINT for p in points)
    assert all(p["valid"] is True for p in points)
    assert all(s.keys() >= SAMPLE for s in default_sweep["samples"])


def test_each_mean_force_ratio_lies_within_the_thesis_repeatability_of_its_own(default_sweep: dict[str, Any]) -> None:
    thesis = printed_averages()
    assert [s["sample"] for s in default_sweep["samples"]] == sorted(thesis)
    assert default_sweep["softness_order"] == ["1", "6", "4", "3", "5", "2"]  # of Figure 5.3
    for sample in default_sweep["samples"]:
        assert (sample["thesis_force_ratio"], sample["force_ratio"]) == (
            thesis[sample["sample"]],
            pytest.approx(thesis[sample["sample"]], rel=REPEATABILITY),
        )


def test_each_load_is_servoed_and_forces_and_ratio_follow_from_the_voltages(default_sweep: dict[str, Any]) -> None:
    step = 1 / 10.306  # N
    for p in default_sweep["points"]:
        # 0.6 steps is the servo's tolerance; the mean of four readings scatters by a fifth of a step
        assert p["load_measured_N"] == pytest.approx(p["load_N"], abs=(0.6 + 3 * 0.2) * step)
        assert p["load_measured_N"] == pytest.approx((p["indicator_mV"] - 1.81) / 10.306, abs=0.002)
        assert (p["force_rigid_N"], p["force_total_N"], p["force_ratio"]) == (
            pytest.approx(p["voltage_rigid_V"] / 5.995e-3),
            pytest.approx(p["voltage_total_V"] / 68.60e-3),
            pytest.approx(p["force_rigid_N"] / p["force_total_N"]),
        )
        assert (p["force_rigid_u"], p["force_total_u"]) == (
            pytest.approx(0.033 * p["force_rigid_N"], rel=0.01),
            pytest.approx(0.03 * p["force_total_N"], rel=0.01),
        )


@pytest.mark.slow
def test_over_seeds_the_deviations_are_as_large_as_their_stated_uncertainty(
    default_sweep: dict[str, Any], scene: Scene, tmp_path: Path
) -> None:
    thesis = printed_averages()
    result = sweep_scene(scene.with_seed(2), tmp_path, samples=tuple("123456"), loads=MORE_LOADS, dwell=0.2)
    points = [*default_sweep["points"], *map(asdict, result.points)]
    means = [*default_sweep["samples"], *map(asdict, result.samples)]
    assert (len(points), len(means)) == (36 + 24, 2 * 6)
    for values in (points, means):
        assert plausible([(v["force_ratio"] - thesis[v["sample"]]) / v["force_ratio_u"] for v in values])
    scatter = [p["force_ratio"] / thesis[p["sample"]] - 1 for p in points]
    assert (np.std(scatter), result.softness_order) == (
        pytest.approx(REPEATABILITY, rel=0.25),
        ["1", "6", "4", "3", "5", "2"],
    )


@pytest.mark.slow
def test_the_noise_part_of_the_uncertainty_is_the_scatter_that_noise_makes(tmp_path: Path) -> None:
    scene = scene_of(IDEAL_SCENE + '[effects.white_noise]\ndensity = "20 µV/√Hz"\n', tmp_path)
    loads = tuple(2 + 0.1 * i for i in range(20))
    points = sweep_scene(scene, tmp_path / "run", samples=("1",), loads=loads).points
    assert plausible([(p.force_ratio - modelled("1", "experiment")) / p.noise_u for p in points])
    scatter = scene.design.ratio_scatter
    assert all(p.force_ratio_u == pytest.approx(math.hypot(p.noise_u, scatter * p.force_ratio)) for p in points)


# --- other scenes and settings -------------------------------------------------------------------------


@pytest.mark.parametrize("model", first_of(["experiment", "column", "beam", "beam_printed"]))
def test_without_imperfections_the_ratio_is_the_models_and_the_force_is_the_load(tmp_path: Path, model: str) -> None:
    scene = with_model(scene_of(IDEAL_SCENE, tmp_path), model)
    # a large load on hard samples: on less the converter's steps, 15 µV, are more than 1e-3 of the rigid film
    result = sweep_scene(scene, tmp_path / "run", samples=("1", "6"), loads=(7.2,), calibration=IDEAL_CALIBRATION)
    for p in result.points:
        assert (p.force_ratio, p.load_measured_N, p.force_total_N, p.force_rigid_N) == (
            pytest.approx(modelled(p.sample, model), rel=1e-3),
            pytest.approx(7.2, rel=0.01),
            pytest.approx(p.load_measured_N, rel=1e-3),
            pytest.approx(p.load_measured_N * modelled(p.sample, model), rel=1e-3),
        )


@pytest.mark.parametrize(("frequency", "dwell", "rate", "samples"), [(0.5, 4.0, 12.5, 50), (20.0, 1.0, 500.0, 500)])
def test_other_frequencies_and_dwells_give_the_same_ratio(
    tmp_path: Path, frequency: float, dwell: float, rate: float, samples: int
) -> None:
    scene = scene_of(IDEAL_SCENE + "[effects.charge_amplifier]\n", tmp_path)
    folder = tmp_path / "run"
    result = sweep_scene(
        scene,
        folder,
        samples=("1",),
        loads=(6.5, 7.2),
        frequency=frequency,
        dwell=dwell,
        calibration=IDEAL_CALIBRATION,
    )
    assert [p.force_ratio for p in result.points] == pytest.approx([modelled("1", "experiment")] * 2, rel=1e-3)
    waveforms = list(Run.open(folder).waveforms())
    assert [(w.point_id, w.name) for w in waveforms] == [(1, "rigid"), (1, "total"), (2, "rigid"), (2, "total")]
    assert {(w.rate, w.samples.size, w.samples.dtype.str) for w in waveforms} == {(rate, samples, "<f4")}


def loud(scene: Scene, factor: float) -> Scene:
    """The total film gives so many times what the design says."""
    rigid, total = scene.design.films
    return replace(
        scene, design=replace(scene.design, films=(rigid, replace(total, sensitivity=factor * total.sensitivity)))
    )


def test_an_over_ranged_film_marks_the_point_and_leaves_the_mean_out(tmp_path: Path, scene: Scene) -> None:
    result = sweep_scene(loud(scene, 100), tmp_path / "run", samples=("1",), loads=(3.0,), dwell=0.2)
    assert [(p.valid, p.flags, p.attempts) for p in result.points] == [(False, ("clipped",), 3)]
    assert (result.samples[0].force_ratio, result.samples[0].valid_points, result.softness_order) == (None, 0, [])


def test_a_film_that_clips_on_the_sensitive_range_is_measured_again_on_the_wide_one(
    tmp_path: Path, scene: Scene
) -> None:
    folder = tmp_path / "run"
    (point,) = sweep_scene(loud(scene, 10), folder, samples=("1",), loads=(3.0,), dwell=0.2).points
    assert (point.valid, point.flags, point.attempts) == (False, ("force",), 3)  # it is not the design's film
    assert point.force_total_N == pytest.approx(10 * 3.0, rel=0.15)
    event, _ = Run.open(folder).events()
    assert (event["kind"], event["message"]) == ("rejected", "sample 1, 3 N, attempt 1: clipped")


@pytest.mark.parametrize(
    ("load", "error", "message"),
    [
        (9.2, RangeError, r"above the bench's force limit of 10 N; loads up to 9\.09 N are possible"),
        (0.15, UnreachableError, "load 150 mN .* below 2 steps .* ask for 194 mN or more"),
    ],
)
def test_a_load_above_the_force_limit_or_below_two_steps_of_the_indicator_is_refused_before_anything_is_sent(
    sim: SimulatedBench, bench: Bench, tmp_path: Path, load: float, error: type[Exception], message: str
) -> None:
    before = dict(sim.amplifier.settings), dict(sim.indicator.settings), sim.clock.now_ns()
    with pytest.raises(error, match=message):
        sweep(bench, tmp_path / "run", loads=(load,))
    assert (sim.amplifier.settings, sim.indicator.settings, sim.clock.now_ns()) == before


def test_a_load_outside_the_calibrated_range_needs_leave_and_is_marked(tmp_path: Path, scene: Scene) -> None:
    with pytest.raises(RangeError, match=r"load 1 N lies outside the 1\.373 to 7\.257 N .* --extrapolate"):
        sweep_scene(scene, tmp_path / "refused", samples=("1",), loads=(1.0, 2.0), dwell=0.1)
    assert Run.open(tmp_path / "refused").points() == []
    result = sweep_scene(scene, tmp_path / "run", samples=("1",), loads=(1.0, 2.0), dwell=0.1, extrapolate=True)
    assert [(p.load_N, p.extrapolated) for p in result.points] == [(1.0, True), (2.0, False)]


# --- the record ----------------------------------------------------------------------------------------


def test_the_record_holds_the_points_of_the_result(default_sweep: dict[str, Any]) -> None:
    run = Run.open(Path(default_sweep["run"]))
    assert run.status == "complete"
    stored = [{k: v for k, v in p.items() if k not in ("id", "bench_ns")} for p in run.points()]
    assert (stored, run.summary["samples"], run.summary["softness_order"]) == (
        default_sweep["points"],
        default_sweep["samples"],
        default_sweep["softness_order"],
    )


def test_a_stored_waveform_gives_the_stored_result_again(default_sweep: dict[str, Any]) -> None:
    run = Run.open(Path(default_sweep["run"]))
    for point in (run.points()[0], run.points()[-1]):
        films = np.array([run.waveform(point["id"], name) for name in ("rigid", "total")])
        assert films.dtype == np.float32
        fit = fit_sine(np.arange(250) / 250.0, films, 10.0)
        assert 2 * fit.unbiased == pytest.approx([point["voltage_rigid_V"], point["voltage_total_V"]], rel=1e-6)
        ratio, ratio_u = amplitude_ratio(fit, 0, 1)
        assert (ratio * 68.60 / 5.995, ratio_u * 68.60 / 5.995) == (
            pytest.approx(point["force_ratio"], rel=1e-6),
            pytest.approx(point["noise_u"], rel=1e-3),
        )


# --- in between ----------------------------------------------------------------------------------------


def point(sample: str, force_ratio: float, valid: bool = True) -> LoadPoint:
    return LoadPoint(sample, 2.0, 22.4, 2.0, 0.03, 4e-3, 0.137, 0.6, 2.0, force_ratio, 0.04, 1e-4, 1.1, valid)


def test_only_valid_points_enter_a_mean_and_the_order() -> None:
    bad = {"force_ratio": 9.9, "valid": False}
    points = [point("2", 0.2), point("2", **bad), point("2", 0.3), point("1", 0.4), point("3", **bad)]
    result = evaluate(points, get_design("single"))
    two, one, three = result.samples
    assert (two.force_ratio, two.force_ratio_u, two.valid_points) == pytest.approx((0.25, 0.04 / math.sqrt(2), 2))
    assert (one.force_ratio, one.valid_points) == (0.4, 1)
    assert (three.force_ratio, three.force_ratio_u, three.valid_points) == (None, None, 0)
    assert (result.softness_order, result.points) == (["1", "2"], points)


def test_the_budget_of_a_mean_tells_scatter_and_noise_apart() -> None:
    (budget,) = evaluate(
        [point("1", 0.3), point("1", 0.32), point("1", 9.9, valid=False)], get_design("single")
    ).budgets
    assert (budget.quantity, budget.value) == ("force ratio of sample 1", pytest.approx(0.31))
    parts = {component.name: component.contribution for component in budget.components}
    assert (parts["noise"], math.hypot(parts["gain scatter"], parts["noise"])) == (
        pytest.approx(1e-4 / math.sqrt(2)),
        pytest.approx(0.04 / math.sqrt(2)),
    )
    assert parts["films' calibration"] == 0


@pytest.mark.parametrize(
    ("text", "loads"),
    [
        ("1.5 N:4 N:0.5 N", LOADS),
        ("2 N, 3 N", (2.0, 3.0)),
        ("2 N", (2.0,)),
        ("1 N:1 N:1 N", (1.0,)),
        ("0.1 N:0.3 N:0.1 N", (0.1, 0.2, 0.3)),
        ("1 N:1.9 N:0.5 N", (1.0, 1.5)),
        ("150 gf", (0.15 * 9.80665,)),
    ],
)
def test_loads_are_read_with_their_units(text: str, loads: tuple[float, ...]) -> None:
    assert parse_loads(text) == pytest.approx(loads, rel=1e-12)


@pytest.mark.parametrize("text", ["1 N:1001 N:1 N", "1 N:1e308 N:1e-300 N"])
def test_more_than_a_thousand_loads_are_refused(text: str) -> None:
    assert len(parse_loads("1 N:1000 N:1 N")) == 1000
    with pytest.raises(RangeError, match="more than 1000 loads"):
        parse_loads(text)


# --- A load that is repeated is a load set of its own, with gains of its own, wherever load set -------

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
    assert (mean.valid_points, budget.u / budget.value) == (4, pytest.approx(0.041 / 2, rel=0.05))


def test_steps_of_repeated_loads_are_told_apart_and_only_the_first_takes_long() -> None:
    target = choose(None, "thesis_single").target
    sweep = LoadSweep(("2",), SAME).plan(target).steps
    told = ["sample 2, 3 N", "sample 2, 3 N, set 2", "sample 2, 4 N", "sample 2, 4 N, set 2"]
    assert ([step.what for step in sweep], len({step.seconds_expected for step in sweep[1:]})) == (told, 1)
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
