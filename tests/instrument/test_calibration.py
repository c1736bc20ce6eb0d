"""The load-cell calibration: by weights and bridge, its uncertainty, its file and its class."""

from __future__ import annotations

import errno
import math
import os
from datetime import date
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from palpate.instrument.calibration.bridge import Bridge
from palpate.instrument.calibration.calibration import CalibrationOwner
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.load_cell import (
    NOT_CLASSIFIABLE,
    STANDARD_GRAVITY,
    THESIS_LOAD_CELL,
    Classification,
    Curvature,
    LoadCellCalibration,
    Quantities,
    WeightRun,
    calibrate_load_cell,
    classify_astm_e74,
    classify_iso_376,
    iso_376_class_of,
    quantities,
)
from palpate.instrument.errors import ConfigError, EstimateError, RangeError, RecordError
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


# --- A load-cell calibration survives its file, and a file that is wrong is refused --------------------


@pytest.mark.parametrize("simulated", [False, True])
@pytest.mark.parametrize("text", ["A", "\0", 'a "quoted"\n\r\ttext \\', "\u00b5\u2028\U0001f4a7\x7f"])
def test_a_calibration_comes_back_from_its_file_bit_by_bit(tmp_path: Path, text: str, simulated: bool) -> None:
    draw = Random(text)
    values = [10.0 ** draw.uniform(-6, 6) for _ in range(6)]
    zero, correlation = draw.choice([-1e9, 0.1, -0.0, 1e-300]), draw.choice([-1.0, 1.0, draw.random()])
    calibration = LoadCellCalibration(
        sensitivity_mV_per_N=values[0],
        sensitivity_u=values[1],
        zero_mV=zero,
        zero_u=values[2],
        covariance=correlation * values[1] * values[2],
        degrees_of_freedom=5,
        least_N=-values[0],
        greatest_N=values[1],
        linearity=values[3],
        reversibility=values[4],
        reversibility_of_reading=values[2],
        interpolation=values[3],
        creep=values[0],
        lower_limit_factor_N=values[5],
        astm_e74=Classification(name="A", least_N=values[0], greatest_N=values[1]),
        iso_376=Classification(name="not classifiable", reason=text),
        gage_factor=values[1],
        expires="2020-02-29",
        curvature=Curvature(mV_per_N2=zero, u=values[3], with_sensitivity=0.0, with_zero=0.0),
        resolution_mV=values[5],
        device=text,
        simulated=simulated,
        source=text,
        created=text,
    )
    path = tmp_path / "load_cell.toml"
    write_calibration(path, calibration)
    assert read_calibration(path, LoadCellCalibration) == calibration
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("linearity", "lineraity", r"lineraity: unknown key \(did you mean 'linearity'\?\)"),
        ("linearity", "lineraity", "linearity: is missing"),
        ("resolution_mV = 1.0", "resolution_mV = -1.0", r"resolution_mV: -1\.0 is too small; give more than 0"),
        ("resolution_mV = 1.0", "resolution_mV = nan", "resolution_mV: nan is not finite; give a number"),
        ("resolution_mV = 1.0", 'resolution_mV = "1"', "resolution_mV: '1' is no number; give one without quotes"),
        ("reversibility = ", "reversibility = -", r"reversibility: -[0-9.e-]+ is too small; give at least 0"),
        (
            "simulated = false",
            "simulated = 0",
            "simulated: 0 is neither true nor false",
        ),
        ("covariance = -", "covariance = -9", r"covariance: -90\.0134 exceeds sensitivity_u · zero_u = 0\.0146682"),
        ("simulated = false", "simulated = ", "is not TOML"),
        ("least_N = 1.3", "least_N = 9.3", r"greatest_N: 7\.25692 N is not above least_N = 9\.372"),
        ('"thesis Table 5.1"', '"a"\nexpires = "soon"', "expires: 'soon' is not a date such as 2027-11-21"),
        (
            "[astm_e74]",
            "[curvature]\nmV_per_N2 = 1.0\nu = 1.0\nwith_zero = 0.5\nwith_sensitivity = 0.0\n[astm_e74]",
            "covariances of zero, sensitivity and curvature cannot be",
        ),
    ],
)
def test_a_wrong_calibration_file_is_refused_by_file_key_and_problem(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "load_cell.toml"
    write_calibration(path, THESIS_LOAD_CELL)
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=message) as caught:
        read_calibration(path, LoadCellCalibration)
    assert str(caught.value).startswith(str(path))


def test_a_missing_calibration_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent\.toml: cannot be read: No such file"):
        read_calibration(tmp_path / "absent.toml", LoadCellCalibration)


def test_a_missing_folder_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(
        RecordError, match=r"load_cell\.toml: cannot write the calibration: No such file .* another folder"
    ):
        write_calibration(tmp_path / "absent" / "load_cell.toml", THESIS_LOAD_CELL)


def test_a_full_disk_leaves_the_old_calibration_and_no_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "load_cell.toml"
    write_calibration(path, THESIS_LOAD_CELL)

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(RecordError, match="No space left on device"):
        write_calibration(path, THESIS_LOAD_CELL.model_copy(update={"device": "LC-1"}))
    assert read_calibration(path, LoadCellCalibration) == THESIS_LOAD_CELL
    assert list(tmp_path.iterdir()) == [path]


# --- Classes of load cells: the thesis' has none, a good one has its class over the loads where it is good

LOAD = np.arange(1.0, 11.0)
PERFECT = {name: np.zeros(10) for name in ("repeatability", "reproducibility", "interpolation", "zero_return")}


def iso(found: Quantities, load: np.ndarray = LOAD) -> Classification:
    return classify_iso_376(load, found)


# --- the thesis' cell ----------------------------------------------------------------------------------


def test_the_thesis_cell_has_a_lower_limit_factor_of_a_tenth_of_a_newton() -> None:
    # 14 readings about a line have 12 degrees of freedom; with 13 it would be the 0.096 N that others find
    assert THESIS_LOAD_CELL.lower_limit_factor_N == pytest.approx(0.1000, abs=5e-5)
    assert THESIS_LOAD_CELL.lower_limit_factor_N * math.sqrt(12 / 13) == pytest.approx(0.096, abs=5e-4)


def test_the_thesis_cell_cannot_be_classified_at_its_loads() -> None:
    astm, iso_376 = THESIS_LOAD_CELL.astm_e74, THESIS_LOAD_CELL.iso_376
    assert (astm.name, iso_376.name) == (NOT_CLASSIFIABLE, NOT_CLASSIFIABLE)
    assert "begins at 400 x 0.1 N = 40 N, above the greatest load of 7.26 N" in astm.reason
    assert "resolution 2.91 % from 3.334 N on exceeds the 0.2 % of ISO 376 class 2" in iso_376.reason
    assert "repeatability and zero_return, which the runs do not tell" in iso_376.reason


# --- ASTM E74 ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "name", "least"),
    [(1e-4, "AA", 1.0), (2e-3, "AA", 4.0), (6e-3, "A", 2.4), (0.03, NOT_CLASSIFIABLE, None)],
)
def test_a_class_begins_at_so_many_lower_limit_factors_and_not_below_the_least_load(
    factor: float, name: str, least: float | None
) -> None:
    found = classify_astm_e74(LOAD, 30, factor, 1e-6)
    assert (found.name, found.least_N) == (name, pytest.approx(least))


def test_a_step_of_the_indicator_is_the_least_lower_limit_factor() -> None:
    assert classify_astm_e74(LOAD, 30, 1e-6, 6e-3).least_N == pytest.approx(2.4)


def test_too_few_readings_give_no_class_of_astm_e74() -> None:
    assert "asks for 30 readings at 10 loads, not 20 at 10" in classify_astm_e74(LOAD, 20, 1e-4, 1e-6).reason


# --- ISO 376 -------------------------------------------------------------------------------------------


def test_the_quantities_are_those_of_a_case_worked_by_hand() -> None:
    up = 10 * LOAD
    runs = [
        WeightRun(0.0, up + 5, up + 5.2, 5.0, 5.3),
        WeightRun(0.0, up * 1.01 + 5, up * 1.01 + 5, 5.0, 5.0),
        WeightRun(120.0, up * 0.98 + 5, up * 0.98 + 5, 5.0, 5.0),
    ]
    found = quantities(LOAD, runs, interpolate(LOAD, up + 5, 0.0), 0.5, -0.2)
    expected = {
        "reproducibility": np.full(10, 0.02 / 0.99),
        "repeatability": np.full(10, 0.01 / 1.005),
        "interpolation": np.abs(-0.01 / 3 + 0.1 / 3 / up),
        "reversibility": 0.2 / up / 3,
        "zero_return": np.full(10, 0.3 / 100),
        "creep": np.full(10, 0.2 / 100),
        "resolution": 0.5 / up,
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert found[name] == pytest.approx(values), name


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("reproducibility", 1e-3, "0.5"), ("repeatability", 1.1e-3, "2"), ("interpolation", 2.4e-4, "00"),
        ("reversibility", 5.1e-3, NOT_CLASSIFIABLE), ("zero_return", 5e-4, "1"), ("creep", 2e-3, "2"),
        ("resolution", 1 / 1001, "1"),
    ],
)  # fmt: skip
def test_a_quantity_has_the_class_of_its_limit(name: str, value: float, expected: str) -> None:
    assert iso_376_class_of(name, value) == expected


@pytest.mark.parametrize(
    ("step", "name", "least"),
    [(2e-4, "00", 1.0), (1e-3, "00", 4.0), (2.4e-3, "0.5", 5.0), (9e-3, "2", 5.0), (0.02, NOT_CLASSIFIABLE, None)],
)
def test_the_class_holds_from_the_load_that_has_steps_enough(step: float, name: str, least: float | None) -> None:
    found = iso({**PERFECT, "resolution": step / LOAD})
    assert (found.name, found.least_N) == (name, least)


def test_one_bad_load_in_the_upper_half_spoils_the_class_and_is_named() -> None:
    bad = np.where(LOAD == 7.0, 3e-3, 0.0)
    assert iso({**PERFECT, "reversibility": bad}).name == "1"
    found = iso({**PERFECT, "repeatability": bad})
    assert found.name == NOT_CLASSIFIABLE
    assert found.reason == "repeatability 0.3 % from 5 N on exceeds the 0.2 % of ISO 376 class 2"
    assert iso({**PERFECT, "repeatability": np.where(LOAD == 2.0, 3e-3, 0.0)}).least_N == 3.0


def test_too_few_loads_or_runs_give_no_class_of_iso_376() -> None:
    assert "asks for 8 loads, not 7" in iso({name: np.zeros(7) for name in PERFECT}, LOAD[:7]).reason
    assert "down to 50%" in iso(PERFECT, LOAD + 20).reason
    assert "asks for repeatability, which" in iso({**PERFECT, "repeatability": None}).reason
    assert iso({**PERFECT, "creep": None}).name == "00"


# --- The Wheatstone bridge of Appendix III: its output by Kirchhoff's laws, its balance, and gages on its arms


def test_the_output_is_the_voltage_between_the_middles_by_kirchhoffs_nodes() -> None:
    bridge = Bridge(350.0, 120.0, 500.0, 270.0, excitation=5.0)
    # Nodes between R1 and R2, and between R4 and R3: the currents into each add up to nothing.
    into = np.diag([1 / 350 + 1 / 120, 1 / 270 + 1 / 500])
    upper, lower = np.linalg.solve(into, [5 / 120, 5 / 500])
    assert bridge.output == pytest.approx(upper - lower, rel=1e-12)


def test_the_balancing_arm_gives_no_output_and_its_product_is_that_of_the_others() -> None:
    balanced = Bridge(120.0 * 270 / 500, 120.0, 500.0, 270.0)
    assert Bridge(1.0, 120.0, 500.0, 270.0).balancing_r1 == balanced.r1
    assert balanced.output == pytest.approx(0, abs=1e-15)
    assert Bridge(1.01 * balanced.r1, 120.0, 500.0, 270.0).output > 1e-3


def test_four_gages_give_four_times_one_and_are_straight() -> None:
    factor, strain = 8.98, 1e-3
    one = Bridge.of_gages(factor, strain, 0, 0, 0).output
    assert one == pytest.approx(factor * strain / 4 / (1 + factor * strain / 2), rel=1e-12)
    assert Bridge.of_gages(factor, strain, -strain, strain, -strain).output == pytest.approx(factor * strain, rel=1e-12)
    assert Bridge.of_gages(factor, strain, strain, strain, strain).output == 0


def test_an_arm_without_resistance_is_refused() -> None:
    with pytest.raises(RangeError, match=r"bridge: r3 0 must be above 0 and finite; correct it"):
        Bridge(1, 1, 0, 1)
