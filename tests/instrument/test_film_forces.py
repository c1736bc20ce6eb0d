"""Films of any design give forces and ratios, by sensitivities that were calibrated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.calibration.calibration import CalibrationOwner
from palpate.instrument.calibration.files import read_calibration, write_calibration
from palpate.instrument.calibration.films import FilmCalibration, FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import SineFit, fit_sine
from palpate.instrument.uncertainty.budget import coverage_factor

RATE, FREQUENCY = 250.0, 10.0


def fitted(design: Design, force: list[float], noise: float = 1e-12, seed: int = 0) -> SineFit:
    """A fit of films that feel a force [N, peak to peak]."""
    time = np.arange(250) / RATE
    volts = np.array([film.sensitivity for film in design.films]) * np.array(force)
    random = np.random.default_rng(seed).standard_normal((len(force), len(time)))
    return fit_sine(time, volts[:, None] / 2 * np.cos(2 * np.pi * FREQUENCY * time) + noise * random, FREQUENCY)


@pytest.mark.parametrize(
    ("design", "force", "ratio", "teeth"),
    [
        ("single", [0.471, 1.501], 0.3138, [0.3138]),  # Table A2.9
        ("common_base", [0.236, 0.191, 1.493], 0.2860, [0.1581, 0.1279]),  # Table A2.15
        ("different_base", [0.513, 1.475, 0.518, 1.489], 0.3478, [0.3478, 0.3479]),  # Table 5.7
        ("array_16", [*(0.01 * k for k in range(1, 17)), 4.0], 0.34, [0.0025 * k for k in range(1, 17)]),
    ],
)
def test_forces_give_the_ratio_of_the_thesis_own_row(
    design: str, force: list[float], ratio: float, teeth: list[float]
) -> None:
    found = film_forces(get_design(design), fitted(get_design(design), force))
    assert found.force_ratio == pytest.approx(ratio, abs=6e-5)
    assert [tooth.force_ratio for tooth in found.teeth] == pytest.approx(teeth, abs=6e-5)
    assert [tooth.tooth for tooth in found.teeth] == list(range(1, len(teeth) + 1))
    assert found.force_rigid_N + found.force_total_N == pytest.approx(math.fsum(force), rel=1e-6)


def test_a_dead_base_film_is_named() -> None:
    design = get_design("different_base")
    with pytest.raises(EstimateError, match=r"film 'total_2' on channel 4 gives .* too little for a ratio"):
        film_forces(design, fitted(design, [0.3, 2.0, 0.3, 0.0], noise=1e-4))


# --- Film sensitivities: the mean that was there, an uncertainty that covers it, and crosstalk tooth by tooth

LOADS = np.arange(1.5, 4.1, 0.5)
SINGLE, PAIR = get_design("single"), get_design("common_base")
ORIGIN = {
    "device": "N-1", "simulated": True, "source": "run 1", "created": "2020-01-01T00:00:00Z", "expires": "2021-01-01",
}  # fmt: skip


def readings(
    design: Design, gains: np.ndarray | None = None, crosstalk: float = 0.0, frequency: float = 10.0
) -> list[FilmReading]:
    """Each tooth under each load; `gains`, (films, teeth · loads), multiply the films' sensitivities."""
    found = []
    for tooth in range(len(design.teeth)):
        for load in LOADS:
            shares = [1.0 if tooth in film.teeth else crosstalk for film in design.films]
            volts = np.array([film.sensitivity for film in design.films]) * shares * load
            if gains is not None:
                volts = volts * gains[:, len(found)]
            found.append(FilmReading(tooth, frequency, float(load), float(load), 0.03, volts))
    return found


def calibrate(design: Design = SINGLE, points: list[FilmReading] | None = None) -> FilmCalibration:
    return calibrate_films(design, readings(design) if points is None else points, THESIS_LOAD_CELL, ORIGIN)


def test_the_sensitivity_is_the_design_s_where_nothing_scatters() -> None:
    for film, own in zip(calibrate().films, SINGLE.films, strict=True):
        assert film.sensitivity_mV_per_N == pytest.approx(1e3 * own.sensitivity)
        assert film.clamping == pytest.approx(1)
        assert film.linearity == pytest.approx(0, abs=1e-12)
        assert film.scatter_u == pytest.approx(0, abs=1e-12)


def test_gain_is_told_apart_by_frequency() -> None:
    low = [FilmReading(r.tooth, 1.0, r.set_load, r.load, r.load_u, 0.9 * r.voltage) for r in readings(SINGLE)]
    found = calibrate(SINGLE, [*low, *readings(SINGLE)])
    assert found.frequencies_Hz == (1.0, 10.0)
    assert np.array(found.gain) == pytest.approx(np.array([[0.9, 1.0], [0.9, 1.0]]) / 0.95)


def test_a_film_that_bends_is_not_linear() -> None:
    bent = [FilmReading(r.tooth, 10.0, r.load, r.load, 0.0, r.voltage * (1 + 0.1 * r.load)) for r in readings(SINGLE)]
    volts = LOADS + 0.1 * LOADS**2
    slope, zero = np.polyfit(LOADS, volts, 1)
    expected = np.abs(volts - zero - slope * LOADS).max() / (slope * np.ptp(LOADS))
    assert calibrate(SINGLE, bent).films[0].linearity == pytest.approx(expected)


def test_a_calibration_comes_back_from_its_file_and_is_applied(tmp_path: Path) -> None:
    found = calibrate(PAIR, readings(PAIR, np.full((3, 12), 0.5)))
    write_calibration(tmp_path / "films.toml", found)
    assert read_calibration(tmp_path / "films.toml", FilmCalibration) == found
    assert [f.sensitivity for f in found.apply(PAIR).films] == pytest.approx([f.sensitivity / 2 for f in PAIR.films])
    assert coverage_factor(found.films[0].degrees_of_freedom) == pytest.approx(2.571, abs=1e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (readings(SINGLE)[:2], "2 readings of a film give no scatter; use at least 3"),
        ([FilmReading(0, 10.0, 2.0, 2.0, 0.03, np.ones(2))] * 3, "1 distinct load cannot give a line"),
        (readings(SINGLE, np.zeros((2, 6))), "film 'rigid' on channel 1 gives 0 mV/N"),
        ([FilmReading(0, 10.0, 2.0, -0.1, 0.03, np.ones(2))] * 3, r"load -0\.1 N by the load cell is not above 0"),
    ],
)
def test_readings_that_give_no_sensitivity_are_refused(points: list[FilmReading], message: str) -> None:
    with pytest.raises(EstimateError, match=message):
        calibrate(SINGLE, points)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"device": "N-2"}, r"with device N-1 \(single\), not for this bench's N-2 \(single\); run palpate calibrate"),
        ({"simulated": False}, "was made on a simulated bench"),
        ({"scene": "ab12"}, r"not for this bench's N-1 \(single\) of scene ab12"),
        ({"of": ("common_base",)}, r"not for this bench's N-1 \(common_base\)"),
    ],
)
def test_a_film_calibration_is_refused_where_it_does_not_belong(changed: dict[str, Any], message: str) -> None:
    found = calibrate()
    whose = CalibrationOwner("N-1", None, True, ("single",))
    found.check_owner(whose)
    found.check_films(SINGLE)
    with pytest.raises(ConfigError, match=message):
        found.check_owner(replace(whose, **changed))
    with pytest.raises(ConfigError, match="which had other films than design common_base has"):
        found.check_films(PAIR)


def test_what_the_load_cell_does_to_all_films_cancels_in_the_ratio() -> None:
    time = np.arange(250) / 250
    signals = np.array([[0.3 * f.sensitivity if f.kind == "rigid" else f.sensitivity] for f in SINGLE.films])
    fit = fit_sine(time, signals * np.sin(20 * np.pi * time), 10.0)
    alike = film_forces(calibrate().apply(SINGLE), fit)
    assert alike.calibration_u == pytest.approx(0, abs=1e-9)
