"""`calibrate load-cell --tolerance` plans weights and runs and ends where more help nothing; `--class` judges."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

from palpate.instrument.calibration.load_cell import (
    THESIS_LOAD_CELL,
    LoadCellCalibration,
    WeightRun,
    load_cell_curve,
    slope_u,
)
from palpate.instrument.errors import RangeError
from palpate.instrument.uncertainty.budget import coverage_factor, mean_u
from palpate.procedures.measurements.load_cell.procedure import (
    LOADS,
    LoadCellSeries,
    PlannedRuns,
    expected_sensitivity,
    run_seconds,
    spread,
)
from palpate.procedures.measurements.load_cell.report import REPEATS
from tests.procedures.conftest import Palpate

CALIBRATE = ("calibrate", "load-cell")
SLOPE, STEP = 10.306, 1.0  # mV/N, mV


def quickest(tolerance: float, cell: LoadCellCalibration = THESIS_LOAD_CELL, loads_u: float = 0.0) -> PlannedRuns:
    return LoadCellSeries(loads_u=loads_u).quickest(cell, tolerance)


def run_up_and_down(
    random: np.random.Generator,
    loads: tuple[float, ...],
    noise: float = 0.3,
    slope: float = SLOPE,
    step: float = STEP,
    zero: float = 1.81,
) -> WeightRun:
    """A run on a cell with noise [mV] before its display of some steps [mV]."""
    shown = np.round((slope * np.array([*loads, *loads]) + zero)[:, None] / step + random.normal(
        0, noise / step, (2 * len(loads), REPEATS))) * step  # fmt: skip
    mean = shown.mean(axis=1)
    scatter = math.sqrt(float(shown.var(axis=1, ddof=1).mean()))
    return WeightRun(0.0, mean[: len(loads)], mean[len(loads) :], zero, zero, REPEATS, scatter)


def measured(
    random: np.random.Generator, tolerance: float, noise: float = 0.3, slope: float = SLOPE
) -> tuple[tuple[float, ...], list[WeightRun]]:
    """The loads of a series and its runs, as many as it asks for."""
    loads, runs, zero = quickest(tolerance).loads, [], float(random.uniform(0, STEP))
    while not runs or LoadCellSeries().learned(tolerance, loads, runs, STEP).runs > len(runs):
        runs.append(run_up_and_down(random, loads, noise, slope, zero=zero))
    return loads, runs


# --- the plan --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [0.006, 0.003, 0.0028])
def test_the_plan_is_the_quickest_of_all_numbers_of_weights_and_runs(tolerance: float) -> None:
    plan = quickest(tolerance)
    seconds = min(
        runs * run_seconds(count)
        for count in range(5, len(LOADS) + 1)
        for runs in range(1, 20)
        if 1.96 * expected_sensitivity(spread(LOADS, count), 2 * REPEATS * runs, 1, THESIS_LOAD_CELL)[0].u <= tolerance
    )
    assert plan.allocation.seconds == pytest.approx(seconds)
    (promised,) = expected_sensitivity(plan.loads, 2 * REPEATS * plan.runs, 1, THESIS_LOAD_CELL)
    assert plan.allocation.u == pytest.approx(promised.u)
    assert plan.allocation.half == pytest.approx(1.96 * promised.u, rel=1e-4)  # all that is uncertain is known
    assert plan.allocation.half <= tolerance


def test_what_the_steps_of_the_display_leave_no_run_lowers_and_the_refusal_says_what_would() -> None:
    with pytest.raises(RangeError, match=r"resolution leaves ± 0\.253 %: the display") as refused:
        quickest(0.001)
    assert "best now  --tolerance '0.26 %'" in str(refused.value)
    assert "± 0.161 % by weights that are rounded independently" in str(refused.value)  # 1.96 · 0.0821 %
    assert quickest(0.0026).allocation.half <= 0.0026
    finer = THESIS_LOAD_CELL.model_copy(update={"resolution_mV": 0.1})
    assert quickest(0.001, finer).allocation.half <= 0.001


def test_what_the_loads_are_off_by_counts_once_in_plan_and_result_and_no_run_lowers_it(palpate: Palpate) -> None:
    exact, plan = quickest(0.006), quickest(0.006, loads_u=0.001)
    assert plan.allocation.u == pytest.approx(math.hypot(exact.allocation.u, 0.001))
    assert plan.allocation.shares["weights"] == pytest.approx((0.001 / plan.allocation.u) ** 2)
    run = run_up_and_down(np.random.default_rng(1), LOADS)
    free, bound = (load_cell_curve(np.array(LOADS), [run], STEP, 1, each).sensitivity for each in (0.0, 0.001))
    assert bound.u == pytest.approx(math.hypot(free.u, 0.001 * bound.value))
    said = palpate(*CALIBRATE, "--loads-u", "0.2 %", "--tolerance", "0.2 %").complaint
    assert "--loads-u 0.2 % leaves ± 0.392 %, which no run lowers" in said
    assert "outside 0 to 50 %" in palpate(*CALIBRATE, "--loads-u", "60 %").complaint


# --- the end ---------------------------------------------------------------------------------------------


def test_a_display_that_scatters_more_than_was_expected_takes_more_runs() -> None:
    usual, noisy = (len(measured(np.random.default_rng(1), 0.003, noise)[1]) for noise in (0.3, 0.9))
    assert usual <= quickest(0.003).runs + 1
    assert noisy > 2 * usual


def test_a_cell_that_is_off_its_curve_ends_the_series_and_says_so() -> None:
    loads, random = quickest(0.003).loads, np.random.default_rng(2)
    bent = run_up_and_down(random, loads)
    off = 2.0 * (-1) ** np.arange(len(loads))
    found = LoadCellSeries().learned(0.003, loads, [replace(bent, loading_mV=bent.loading_mV + off)], STEP)
    assert found.runs == 1
    assert found.why_not.startswith("deviation from the curve leaves")


def test_runs_whose_slopes_differ_more_than_noise_explains_count_in_the_uncertainty() -> None:
    random = np.random.default_rng(3)
    slopes = (SLOPE * 0.99, SLOPE, SLOPE * 1.01)
    alike, apart = (
        load_cell_curve(np.array(LOADS), [run_up_and_down(random, LOADS, slope=each) for each in each_slope], STEP, 1)
        for each_slope in ((SLOPE,) * 3, slopes)
    )
    assert [part.name for part in alike.sensitivity.components] == ["curve", "positions"]
    curve, _, differing = apart.sensitivity.components
    assert differing.u == pytest.approx(SLOPE * 0.01 / math.sqrt(3), rel=0.2)
    assert differing.degrees_of_freedom == 2
    # Noise, and steps that seven loads of about 10 mV share, leave 0.15 to 0.3 % besides.
    assert apart.sensitivity.u == pytest.approx(math.hypot(differing.u, curve.u))


def test_a_series_to_a_tolerance_ends_when_it_is_reached_and_tells_predicted_and_achieved(palpate: Palpate) -> None:
    planned = palpate(*CALIBRATE, "--tolerance", "0.6 %", "--dry-run", "--json").object
    found = palpate(*CALIBRATE, "--tolerance", "0.6 %", "--json").object
    assert found["achieved_u"] == found["sensitivity_u"] / found["sensitivity_mV_per_N"]
    assert found["achieved_u"] == pytest.approx(found["predicted_u"], rel=0.1)
    assert found["predicted_results"] == planned["predicted_results"]
    assert found["achieved_seconds"] == pytest.approx(planned["planned"]["seconds"], rel=0.02)
    assert found["stopped"].endswith("reached, ± 0.6 % was asked for")
    assert {point["load_N"] for point in found["points"]} == {0.0, *planned["planned"]["loads_N"]}
    certificate = Path(found["certificate"]).read_text(encoding="utf-8")
    assert "runs up and down in each position | 1 |" in certificate
    assert "uncertainty of all loads together | none given |" in certificate


@pytest.mark.slow
def test_intervals_of_series_that_end_by_their_tolerance_hold_the_true_sensitivity() -> None:
    """Where slopes differ, loads share no rounding on average, while u is the greatest one over the slopes."""
    random, number = np.random.default_rng(5), 200
    held, expected, errors, independent = 0, 0.0, [], []
    for _ in range(number):
        slope = SLOPE * random.uniform(0.95, 1.05)
        loads, runs = measured(random, 0.003, 0.6, slope)
        curve = load_cell_curve(np.array(loads), runs, STEP, None)
        found, scatter = curve.sensitivity, curve.scatter_mV
        assert scatter is not None
        errors.append(found.value - slope)
        independent.append(slope_u(np.array(loads), 1) * mean_u(scatter, STEP, 2 * REPEATS * len(runs)))
        k = coverage_factor(found.degrees_of_freedom)
        held += abs(errors[-1]) <= k * found.u
        expected += 2 * ndtr(k * found.u / independent[-1]) - 1
        reached = LoadCellSeries().learned(0.003, loads, runs, STEP)
        assert k * found.u / found.value <= 0.003 or reached.why_not
    assert held / number == pytest.approx(expected / number, abs=0.025)
    assert np.std(errors) <= 1.05 * math.sqrt(np.mean(np.square(independent)))


# --- a class that is asked for -----------------------------------------------------------------------------


ISO = ("--loads", "300 gf:1000 gf:100 gf", "--runs", "2", "--positions", "0,120")


@pytest.mark.slow
def test_a_calibration_that_misses_its_class_is_stored_and_told_with_what_binds_and_ends_as_a_failure(
    palpate: Palpate,
) -> None:
    said = palpate(*CALIBRATE, *ISO, "--class", "2")
    assert said.status == 1
    assert "wanted         class 2: NOT REACHED" in said.out
    error = said.err.splitlines()[0]
    assert error.startswith("palpate: error: class 2 is not reached (found: not classifiable): ")
    assert "resolution 1.98 % from 4.903 N on exceeds the 0.2 % of ISO 376 class 2" in error
    (run,) = palpate("runs", "list", "--json").object["runs"]
    assert run["status"] == "complete"
    assert (Path(run["run"]) / "calibration.toml").is_file()


@pytest.mark.slow
def test_a_calibration_of_a_better_class_than_was_asked_for_is_enough(palpate: Palpate, tmp_path: Path) -> None:
    scene = tmp_path / "cell.toml"
    scene.write_text(
        'name = "good cell"\npurpose = "A cell with a fine display."\ndesign = "single"\n'
        '[effects.load_cell]\nzero = "0 mV"\nnoise = "2 uV"\ndecimals = 3\n',
        encoding="utf-8",
    )
    said = palpate(*CALIBRATE, *ISO, "--scene", str(scene), "--class", "0.5")
    assert (said.status, "wanted         class 0.5: reached" in said.out) == (0, True)
    assert "ISO 376        00 from" in said.out
