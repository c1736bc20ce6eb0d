from __future__ import annotations

import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from instrument.designs import get_design
from instrument.errors import ConfigError, RangeError
from instrument.models import surface
from instrument.models.axisymmetric import solve
from instrument.models.parameter_sets import IDENTIFIED_ROUND
from instrument.models.parameters import round_parameters
from instrument.models.surface import ResponseSurface

SENSOR = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))


@pytest.fixture(scope="module")
def built() -> ResponseSurface:
    return surface.build(SENSOR, refinement=1)


def test_the_surface_agrees_with_its_model_within_its_own_bound(built: ResponseSurface) -> None:
    assert built.error_bound < 1e-6
    rng = np.random.default_rng(5)
    for ratio in (0.1, 1e7, *10 ** rng.uniform(-1, 7, 12)):
        modulus = SENSOR.compliant_modulus * ratio
        exact = solve(replace(SENSOR, sensed_modulus=modulus), 1).force_ratio
        assert abs(built.force_ratio(float(ratio)) / exact - 1) < built.error_bound


def test_the_surface_rises_from_end_to_end(built: ResponseSurface) -> None:
    ratios = np.logspace(-1, 6.9, 2000)
    assert (np.diff(built.force_ratio(ratios)) > 0).all()


def test_an_array_and_a_number_give_the_same(built: ResponseSurface) -> None:
    values = built.force_ratio(np.array([[1.0, 10.0]]))
    assert values.shape == (1, 2)
    assert built.force_ratio(10.0) == values[0, 1]
    assert isinstance(built.force_ratio(10.0), float)


@pytest.mark.parametrize("ratio", [0.0999, 1.001e7, np.nan, -1.0])
def test_the_surface_refuses_to_extrapolate(built: ResponseSurface, ratio: float) -> None:
    with pytest.raises(RangeError, match=r"outside 0.1 to 1e\+07"):
        built.force_ratio(ratio)
    with pytest.raises(RangeError):
        built.force_ratio(np.array([1.0, ratio]))


def test_a_stored_surface_comes_back_bit_for_bit(built: ResponseSurface, tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    built.save(path)
    back = surface.load(path, replace(SENSOR, sensed_modulus=1e6), refinement=1)
    assert back.coefficients.tobytes() == built.coefficients.tobytes()
    assert (back.error_bound, back.design_hash) == (built.error_bound, built.design_hash)


def test_a_surface_of_another_design_or_refinement_is_refused(built: ResponseSurface, tmp_path: Path) -> None:
    path = tmp_path / "surface.npz"
    built.save(path)
    with pytest.raises(ConfigError, match="another design"):
        surface.load(path, replace(SENSOR, sensed_thickness=2.02e-3), refinement=1)
    with pytest.raises(ConfigError, match="another design"):
        surface.load(path, SENSOR, refinement=2)


@pytest.mark.parametrize("field", ["coefficients", "numbers", "model", "design_hash"])
def test_a_surface_that_was_changed_is_refused(built: ResponseSurface, tmp_path: Path, field: str) -> None:
    path = tmp_path / "surface.npz"
    built.save(path)
    with np.load(path) as stored:
        arrays = dict(stored)
    if arrays[field].ndim:
        arrays[field][3] += 1e-9
    else:
        arrays[field] = np.array("solid")
    np.savez(path, **arrays)
    with pytest.raises(ConfigError, match="content hash"):
        surface.load(path, SENSOR, refinement=1)


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "text", "no field", "pickle"])
def test_a_corrupt_file_is_refused(built: ResponseSurface, tmp_path: Path, damage: str) -> None:
    path = tmp_path / "surface.npz"
    built.save(path)
    whole = path.read_bytes()
    if damage == "missing":
        path.unlink()
    elif damage == "pickle":
        np.savez(path, numbers=np.array([{}], dtype=object))
    elif damage == "no field":
        with zipfile.ZipFile(path, "w"):
            pass
    else:
        path.write_bytes({"empty": b"", "cut": whole[: len(whole) // 2], "text": b"force ratio"}[damage])
    with pytest.raises(ConfigError, match="build it again"):
        surface.load(path, SENSOR, refinement=1)
