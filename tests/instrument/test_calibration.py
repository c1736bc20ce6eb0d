"""The load-cell calibration: the thesis' own numbers, an uncertainty that covers the truth."""

from __future__ import annotations

import math
from datetime import date
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from palpate.instrument.calibration.calibration import CalibrationOwner
from palpate.instrument.calibration.load_cell import (
    STANDARD_GRAVITY,
    THESIS_LOAD_CELL,
    LoadCellCalibration,
    WeightRun,
    calibrate_load_cell,
)
from palpate.instrument.errors import ConfigError, EstimateError, RangeError
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.instrument.uncertainty.interpolation import interpolate

# Thesis Table 5.1 [T]: dead weights in gf, readings in counts of 1 mV while they are put on and taken off.
WEIGHTS_N = np.arange(140.0, 741.0, 100.0) * 1e-3 * STANDARD_GRAVITY
LOADING_MV = np.array([16.0, 26.0, 36.0, 47.0, 56.0, 67.0, 77.0])
UNLOADING_MV = np.array([16.0, 26.0, 36.0, 46.0, 57.0, 66.0, 76.0])
MEANS_MV = (LOADING_MV + UNLOADING_MV) / 2


def calibrate(
    load: npt.ArrayLike = (1.0, 2.0, 3.0),
    loading: npt.ArrayLike = (12.0, 22.0, 32.0),
    unloading: npt.ArrayLike = (12.0, 22.0, 32.0),
    resolution: float = 1.0,
    device: str = "LC-1",
    degree: int | None = None,
    further: tuple[WeightRun, ...] = (),
    runs: tuple[WeightRun, ...] = (),
) -> LoadCellCalibration:
    """The calibration by `runs`; without them, by one run at 0 degrees and `further` ones."""
    return calibrate_load_cell(
        load,
        runs or [WeightRun(0.0, np.array(loading), np.array(unloading)), *further],
        resolution,
        degree=degree,
        gage_factor=8.98,
        device=device,
        simulated=True,
        source="run 1",
        created="2020-01-01T00:00:00Z",
        expires="2021-01-01",
    )


def test_the_stored_load_cell_is_what_the_fit_makes_of_table_5_1() -> None:
    fitted = calibrate_load_cell(
        WEIGHTS_N,
        [WeightRun(0.0, LOADING_MV, UNLOADING_MV)],
        1.0,
        gage_factor=8.98,
        device="thesis load cell",
        simulated=False,
        source="thesis Table 5.1",
        created="not recorded",
    )
    assert fitted == THESIS_LOAD_CELL
    assert fitted.sha256() == THESIS_LOAD_CELL.sha256()


def test_the_thesis_cell_has_10_306_counts_per_newton_from_1_81_on_is_linear_and_reversible_to_one_count() -> None:
    slope, zero = np.polyfit(WEIGHTS_N, MEANS_MV, 1)
    span, cell = slope * np.ptp(WEIGHTS_N), THESIS_LOAD_CELL
    assert (round(cell.sensitivity_mV_per_N, 3), round(cell.zero_mV, 2), cell.simulated) == (10.306, 1.81, False)
    assert (cell.resolution(), cell.linearity) == pytest.approx((0.0970, 0.0035), abs=5e-5)
    assert cell.linearity == pytest.approx(np.abs(MEANS_MV - zero - slope * WEIGHTS_N).max() / span)
    assert cell.reversibility == pytest.approx(1 / span)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_curve_and_its_covariance_are_those_of_an_independent_fit(degree: int) -> None:
    load = np.array([0.5, 1.0, 1.0, 2.5, 7.0, 8.0])
    reading = np.array([8.0, 11.0, 13.0, 28.0, 70.0, 85.0])
    curve = interpolate(load, reading, 0.01, degree)
    coefficients, covariance = np.polyfit(load, reading, degree, cov=True)
    assert curve.coefficients == pytest.approx(coefficients[::-1])
    assert curve.covariance == pytest.approx(covariance[::-1, ::-1])
    assert curve.reading(load) == pytest.approx(np.polyval(coefficients, load))
    assert curve.residual_sd == pytest.approx(
        np.std(reading - np.polyval(coefficients, load)) * math.sqrt(6 / (5 - degree))
    )
    assert curve.degrees_of_freedom == 5 - degree
    assert curve.by_scatter


def test_readings_that_round_alike_are_no_better_than_the_resolution() -> None:
    line = interpolate([1, 2, 3, 4], [10, 20, 30, 40], 1 / math.sqrt(12))
    assert not line.by_scatter
    assert line.residual_sd == pytest.approx(0, abs=1e-12)
    assert math.sqrt(line.covariance[1, 1]) == pytest.approx(1 / math.sqrt(12 * 5))


def test_a_line_far_from_the_origin_survives_where_normal_equations_lose_it() -> None:
    load = 1e8 + np.arange(7.0)
    reading = 10 * (load - 1e8) + 1.8
    assert interpolate(load, reading, 0.1).coefficients[1] == pytest.approx(10, rel=1e-12)
    n, sx, sy, sxx, sxy = load.size, load.sum(), reading.sum(), load @ load, load @ reading
    with np.errstate(divide="ignore", invalid="ignore"):
        naive = (n * sxy - sx * sy) / (n * sxx - sx * sx)
    assert not abs(naive - 10) < 0.1


def test_a_curved_calibration_reads_back_its_loads_and_covers_them() -> None:
    rng = np.random.default_rng(3)
    load = np.linspace(1, 10, 10)
    covered = 0
    for _ in range(100):
        true = 2 + 10 * load + 0.1 * load**2
        calibration = calibrate(load, *(true + rng.normal(size=(2, 10))), resolution=0.01, degree=2)
        assert calibration.curvature is not None
        assert calibration.load(calibration.reading(4.2))[0] == pytest.approx(4.2, rel=1e-12)
        value, u = calibration.load(2 + 10 * 4.2 + 0.1 * 4.2**2)
        covered += abs(value - 4.2) <= 2.365 * u  # 95 %, 7 degrees of freedom
    assert 89 <= covered <= 99
    with pytest.raises(EstimateError, match="beyond the vertex"):
        calibrate(load, *(2 * [10 * load - 0.4 * load**2]), degree=2).load(100.0)


def test_positions_that_differ_make_the_sensitivity_as_uncertain_as_they_differ() -> None:
    load = np.arange(1.0, 9.0)
    runs = tuple(WeightRun(position, s * load, s * load) for position, s in ((120.0, 11.0), (240.0, 9.0)))
    alone, turned = (calibrate(load, 10 * load, 10 * load, 1e-3, further=further) for further in ((), runs))
    assert turned.sensitivity_mV_per_N == pytest.approx(alone.sensitivity_mV_per_N)
    assert turned.sensitivity_u == pytest.approx(1.0, rel=1e-3)
    assert turned.reproducibility == pytest.approx(0.2)
    assert alone.reproducibility is None


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.3, 5.0])
def test_intervals_cover_whatever_the_noise_that_dithers_the_display(noise: float) -> None:
    rng = np.random.default_rng(7)
    sensitivities, zeros = 0, 0
    for _ in range(200):
        slope, zero = 10.3 * (1 + rng.uniform(-0.05, 0.05)), rng.uniform(-5, 5)
        displays = np.rint(zero + slope * WEIGHTS_N + noise * rng.normal(size=(2, 10, 7)))
        scatter = float(np.sqrt(displays.var(axis=1, ddof=1).mean()))
        run = WeightRun(0.0, *displays.mean(axis=1), repeats=10, scatter_mV=scatter)
        found = calibrate(WEIGHTS_N, degree=1, runs=(run,))
        k = coverage_factor(found.degrees_of_freedom or math.inf)
        sensitivities += abs(found.sensitivity_mV_per_N - slope) <= k * found.sensitivity_u
        zeros += abs(found.zero_mV - zero) <= k * found.zero_u
    assert 181 <= sensitivities <= 199
    assert 181 <= zeros <= 199


def test_drift_between_loading_and_unloading_shows() -> None:
    calibration = calibrate([1.0, 2.0, 3.0], [12.0, 22.0, 32.0], [12.0, 22.0, 34.0])
    # means 12, 22, 33 mV: slope 10.5, deviations 1/6, −1/3, 1/6; loading and unloading differ by 2 mV at 3 N
    assert calibration.sensitivity_mV_per_N == pytest.approx(10.5)
    assert calibration.linearity == pytest.approx((1 / 3) / 21)
    assert calibration.reversibility == pytest.approx(2 / 21)


def test_a_reading_that_is_not_finite_has_no_load() -> None:
    with pytest.raises(EstimateError, match="reading nan mV is not finite"):
        THESIS_LOAD_CELL.load(math.nan)


@pytest.mark.parametrize(
    ("load", "reading", "u", "message"),
    [
        ([1, 2, 1, 2], [1, 2, 1, 2], 0.1, "2 distinct loads cannot give a line .* at least 3"),
        ([1, 2], [1, 2], 0.1, "2 distinct loads"),
        ([1, 2, 3], [1, 2], 0.1, r"loads have shape \(3,\) and readings \(2,\)"),
        ([1, 2, 3], [1, math.nan, 3], 0.1, "not finite at point 1; repeat it"),
        ([1, 2, math.inf], [1, 2, 3], 0.1, "not finite at point 2"),
        ([1, 2, math.inf], [math.nan, 2, 3], 0.1, "not finite at point 0, point 2"),
        ([1, 2, 3], [1, 2, 3], -0.1, r"standard uncertainty -0\.1 of a reading must be zero or more"),
        ([1, 2, 3], [1, 2, 3], math.inf, "standard uncertainty inf of a reading"),
    ],
)
def test_readings_that_do_not_determine_a_line_are_refused(
    load: list[float], reading: list[float], u: float, message: str
) -> None:
    with pytest.raises(EstimateError, match=message):
        interpolate(load, reading, u)


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        (
            {"loading": (12.0, 12.0, 12.0), "unloading": (12.0, 12.0, 12.0)},
            EstimateError,
            "is not more than three times that; check the weights, the bridge and its polarity",
        ),
        ({"loading": (32.0, 22.0, 12.0), "unloading": (32.0, 22.0, 12.0)}, EstimateError, "bridge and its polarity"),
        ({"unloading": (12.0, 22.0)}, EstimateError, r"3 loads, but readings of shapes .* each must be \(3,\)"),
        ({"load": (1.0, 1.0, 2.0)}, EstimateError, "must increase, each once"),
        ({"load": (3.0, 2.0, 1.0)}, EstimateError, "must increase, each once"),
        ({"resolution": 0.0}, RangeError, "must be positive: it is the indicator's smallest step"),
        ({"resolution": math.inf}, RangeError, "must be positive: it is the indicator's smallest step"),
        ({"device": ""}, ConfigError, "load cell calibration: device"),
    ],
)
def test_what_makes_no_calibration_is_refused(wrong: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        calibrate(**wrong)


@pytest.mark.parametrize(("load", "inside"), [(1.3729310, True), (7.256921, True), (1.37, False), (7.26, False)])
def test_loads_outside_the_calibrated_range_are_refused(load: float, inside: bool) -> None:
    assert THESIS_LOAD_CELL.covers(load) is inside
    if inside:
        THESIS_LOAD_CELL.check_range(load)
    else:
        with pytest.raises(RangeError, match=r"outside the 1\.373 to 7\.257 N .*--extrapolate"):
            THESIS_LOAD_CELL.check_range(load)


@pytest.mark.parametrize(
    ("whose", "message"),
    [
        (
            CalibrationOwner("LC-2", "ab", True),
            "with device LC-1 of scene ab, not for this bench's LC-2 of scene ab; run palpate",
        ),
        (CalibrationOwner("LC-1", "cd", True), "with device LC-1 of scene ab, not for this bench's LC-1 of scene cd"),
        (CalibrationOwner("LC-1", None, True), "not for this bench's LC-1; run palpate calibrate load-cell"),
        (CalibrationOwner("LC-1", None, False), "was made on a simulated bench"),
    ],
)
def test_a_calibration_is_refused_where_it_does_not_belong(whose: CalibrationOwner, message: str) -> None:
    calibration = calibrate().model_copy(update={"scene": "ab"})
    calibration.check_owner(CalibrationOwner("LC-1", "ab", True))
    calibration.check_date(date(2021, 1, 1))
    calibration.check_gage_factor(8.98)
    with pytest.raises(ConfigError, match=message):
        calibration.check_owner(whose)
    with pytest.raises(ConfigError, match=r"at gage factor 8\.98, this bench's is 2; set gage_factor"):
        calibration.check_gage_factor(2.0)
    with pytest.raises(ConfigError, match="expired on 2021-01-01; run palpate calibrate load-cell"):
        calibration.check_date(date(2021, 1, 2))
