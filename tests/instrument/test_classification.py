"""Classes of load cells: the thesis' has none, a good one has its class over the loads where it is good."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.calibration.load_cell import (
    NOT_CLASSIFIABLE,
    THESIS_LOAD_CELL,
    Classification,
    Quantities,
    WeightRun,
    classify_astm_e74,
    classify_iso_376,
    iso_376_class_of,
    quantities,
)
from palpate.instrument.uncertainty.interpolation import interpolate

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
