"""Response surfaces: how they are built of a model that is made up, and those that come with palpate."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.instrument.errors import ConfigError, EstimateError, RangeError
from palpate.instrument.models.axisymmetric.model import solve
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import RoundParameters, round_parameters, solid_parameters
from palpate.instrument.models.response import response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.stored import surface, surface_build
from palpate.instrument.models.stored.surface import Parameters, ResponseSurface
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.load import Load

ROUND, LOAD = get_design("single_round"), PHYSICAL.load(1e5)
SENSOR = round_parameters(ROUND, LOAD)
# A refinement of the model that is made up shifts the ratio by this.
SHIFT = 3e-4


@pytest.fixture(scope="module")
def built() -> ResponseSurface:
    """The surface that comes with palpate."""
    return surface.find(ROUND, LOAD)


def made_up(parameters: Parameters, refinement: int, modulus_ratio: float) -> float:
    """Two springs and a spring behind them, in the place of finite elements."""
    column = 0.08 * (1 + modulus_ratio) / (1 + 0.08 * modulus_ratio)
    return column * (1 - 1e-3 * modulus_ratio / (1 + modulus_ratio)) - SHIFT * refinement


# --- building ------------------------------------------------------------------------------------------


def test_a_surface_is_as_near_to_its_model_as_its_bound_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surface_build, "_solve", made_up)
    made = surface_build.build(SENSOR)
    assert len(made.coefficients) in surface_build.NODES
    assert made.error_bound < 1e-6
    ratios = np.geomspace(0.1, 1e7, 4001)[1:-1]
    exact = np.array([made_up(SENSOR, 3, ratio) for ratio in ratios])
    apart = np.abs(made.force_ratio(ratios) / exact - 1)
    assert 0.1 * made.error_bound < apart.max() < made.error_bound
    assert made.discretisation == pytest.approx(2 * SHIFT)
    assert (made.lowest, made.highest, made.model) == (0.1, 1e7, "axisymmetric")


def test_a_model_with_a_kink_has_no_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        surface_build, "_solve", lambda parameters, refinement, ratio: 0.5 + 0.1 * abs(np.log10(ratio / 3))
    )
    with pytest.raises(EstimateError, match=r"at 97 nodes is above 1e-06; ask model 'axisymmetric' itself"):
        surface_build.build(SENSOR)


def test_nodes_are_solved_once_and_where_the_caller_says(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    def apply(one: Callable[[float], float], ratios: Sequence[float]) -> Iterator[float]:
        asked.extend(ratios)
        return map(one, ratios)

    monkeypatch.setattr(surface_build, "_solve", made_up)
    made = surface_build.build(SENSOR, apply=apply)
    nodes = asked[: -2 * len(surface_build.PROBES)]
    assert len(set(nodes)) == len(nodes) == len(made.coefficients) + (len(made.coefficients) - 1) // 2


def test_a_surface_is_built_of_the_finite_elements_of_its_refinement() -> None:
    hard = replace(SENSOR, sensed_modulus=240e3)
    assert surface_build._solve(SENSOR, 1, 10.0) == solve(hard, 1).force_ratio
    square = solid_parameters(get_design("single"), LOAD)
    assert surface_build._solve(square, 0, 10.0) == solid.solve(replace(square, sensed_modulus=240e3), 0).force_ratio


# --- one of them ---------------------------------------------------------------------------------------


def test_the_discretisation_bound_holds_against_a_finer_mesh(built: ResponseSurface) -> None:
    fine = solve(replace(SENSOR, sensed_modulus=12 * SENSOR.compliant_modulus), 4).force_ratio
    assert 0 < abs(built.force_ratio(12.0) - fine) < built.discretisation < 1e-5


def test_every_second_node_makes_a_surface_through_the_same_points(built: ResponseSurface) -> None:
    thin = built.thinned(2)
    assert len(thin.coefficients) == (len(built.coefficients) + 1) // 2
    nodes = 10 ** (3 + 4 * np.cos(np.pi * np.arange(0, len(built.coefficients), 2) / (len(built.coefficients) - 1)))
    nodes = np.clip(nodes, built.lowest, built.highest)
    assert thin.force_ratio(nodes) == pytest.approx(built.force_ratio(nodes), rel=1e-12)
    assert thin.error_bound == np.inf


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
    back = surface.read(path)
    assert back.coefficients.tobytes() == built.coefficients.tobytes()
    assert (back.error_bound, back.design_hash) == (built.error_bound, built.design_hash)


@pytest.mark.parametrize("other", ["design", "version"])
def test_a_surface_of_another_design_or_version_is_refused(
    built: ResponseSurface, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: str
) -> None:
    wrong = surface.find(get_design("single"), LOAD) if other == "design" else built
    wrong.save(tmp_path / "single_round.npz")
    monkeypatch.setattr(surface, "STORED", tmp_path)
    if other == "version":
        monkeypatch.setattr(surface, "CODE_VERSION", surface.CODE_VERSION + 1)
    with pytest.raises(RangeError, match="has no surface for design 'single_round' with these dimensions"):
        surface._find.__wrapped__(ROUND, LOAD)


def test_many_teeth_take_the_coarsest_mesh() -> None:
    """Twelve teeth take it; two take the mesh that finite elements of a single tooth take."""
    few, many = (solid_parameters(get_design(name), LOAD) for name in ("common_base", "array"))
    assert surface.design_hash(few) == surface.design_hash(few, 1)
    assert surface.design_hash(many) == surface.design_hash(many, 0)


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
        surface.read(path)


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
        surface.read(path)


# --- those that come with palpate -----------------------------------------------------------------------

SHIPPED = ("single_round", "single", "common_base", "different_base", "array")


@pytest.mark.parametrize("design", ["single_round", "single"])
def test_a_shipped_surface_agrees_with_its_model_now(design: str) -> None:
    modulus = 24e3 * 10 ** np.random.default_rng(len(design)).uniform(-1, 7)
    found = surface.find(get_design(design), PHYSICAL.load(modulus))
    parameters = surface.surface_parameters(get_design(design), PHYSICAL.load(modulus))
    if isinstance(parameters, RoundParameters):
        exact = solve(parameters, surface.REFINEMENTS["axisymmetric"]).force_ratio
    else:
        exact = solid.solve(parameters, surface.REFINEMENTS["solid"]).force_ratio
    assert abs(found.force_ratio(modulus / 24e3) / exact - 1) < found.error_bound < 1e-6


@pytest.mark.parametrize("design", SHIPPED)
def test_model_surface_answers_for_each_shipped_design_with_its_bound(design: str) -> None:
    given = response(get_design(design), PHYSICAL.load(1e5, force=3.0), "surface")
    found = surface.find(get_design(design), PHYSICAL.load(1e9))
    assert given.force_ratio == found.force_ratio(1e5 / 24e3)
    assert given.force_total == 3.0
    assert given.error_estimate == pytest.approx(found.discretisation + found.error_bound * given.force_ratio)
    assert (surface.STORED / f"{design}.npz").stat().st_size < 5000


@pytest.mark.parametrize(
    "design, load, model",
    [
        ("single", replace(PHYSICAL, sensed_thickness=2e-3).load(1e5), "solid"),
        ("single", replace(PHYSICAL, interface="frictionless").load(1e5), "solid"),
        ("single_round", replace(PHYSICAL, sensed_poisson=0.4).load(1e5), "axisymmetric"),
        ("single", replace(PHYSICAL.load(1e5), at=(1e-3, 1e-3)), "solid"),
        ("single_round", replace(PHYSICAL.load(1e5), at=(5e-3, 5e-3)), "solid"),
        ("single_round", PHYSICAL.load(2.3e3), "axisymmetric"),
        ("single", PHYSICAL.load(2.5e11), "solid"),
    ],
)
def test_anything_else_is_refused_with_the_model_to_ask(design: str, load: Load, model: str) -> None:
    with pytest.raises(RangeError, match=f"model '{model}'"):
        response(get_design(design), load, "surface")


def test_a_changed_material_has_no_surface() -> None:
    design = get_design("single")
    stiff = replace(design, ring=replace(design.ring, material=replace(design.ring.material, modulus=33e3)))
    with pytest.raises(RangeError, match=r"has .*single_round.* ask model 'solid'"):
        response(stiff, PHYSICAL.load(1e5), "surface")
