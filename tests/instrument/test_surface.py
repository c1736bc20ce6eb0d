"""The curves that come with palpate, from which model "surface" answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import ConfigError, RangeError
from palpate.instrument.models import surface
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.curve import ratio_curve
from palpate.instrument.models.finite_elements.work import write
from palpate.instrument.models.parameters import (
    PHYSICAL,
    RoundParameters,
    SolidParameters,
    get_parameter_set,
    round_parameters,
    solid_parameters,
)
from palpate.instrument.models.price_list import AUTO_TOLERANCE
from palpate.instrument.models.response import response, responses
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.surface import RoundMesh, Surface
from palpate.instrument.sensor.design import FILM_KINDS
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import Load, through

ROUND, LOAD = get_design("single_round"), PHYSICAL.load(1e5)
SHIPPED = ("single_round", "single", "common_base", "different_base", "array", "array_16")


@pytest.fixture(scope="module")
def found() -> Surface:
    return surface.find(ROUND, LOAD)


@pytest.mark.parametrize("design", ["single_round", pytest.param("single", marks=pytest.mark.slow)])
def test_shipped_curves_and_the_films_signals_agree_with_their_model_now(design: str) -> None:
    sensor = get_design(design)
    load = PHYSICAL.load(24e3 * 10 ** np.random.default_rng(len(design)).uniform(-1, 7))
    shipped, felt = surface.find(sensor, load), response(sensor, replace(load, force=2.0), "surface").films
    parameters = surface.surface_parameters(sensor, load)
    for refinement, mesh in zip(surface.refinements_of(parameters), shipped.meshes, strict=True):
        ratio, signals = solved(parameters, refinement)
        moduli = np.array([parameters.sensed_modulus])
        assert mesh.poles.force_ratios(moduli)[0, 0] == pytest.approx(ratio, rel=1e-9)
    for film in sensor.films:
        found, (voltage, charge) = felt[film.name], signals[0 if film.kind == FILM_KINDS[0] else 1]
        assert found.voltage == pytest.approx(2 * voltage, rel=1e-8)
        assert found.charge == pytest.approx(2 * charge, rel=1e-8)
        assert found.voltage_error is not None and found.voltage_error > 0


def solved(parameters: RoundParameters | SolidParameters, refinement: Any) -> tuple[float, Sequence[Sequence[float]]]:
    """Force ratio, and voltage and charge of the tooth's film and of the base's, by the model itself."""
    if isinstance(parameters, SolidParameters):
        answer = solid.solve(parameters, refinement)
        return answer.force_ratio, answer.signals
    found = axisymmetric.solve(parameters, refinement)
    return found.force_ratio, [[found.films[name].voltage, found.films[name].charge] for name in ("tooth", "base")]


@pytest.mark.parametrize("design", SHIPPED)
def test_model_surface_answers_for_each_shipped_design_with_its_estimate(design: str) -> None:
    sensor = get_design(design)
    given = response(sensor, replace(LOAD, force=3.0), "surface")
    shipped = surface.find(sensor, through(LOAD, 1e9))
    assert given.force_ratio == pytest.approx(shipped.force_ratios(np.array([1e5]))[0], rel=1e-9)
    assert given.error_estimate == pytest.approx(shipped.relative(np.array([1e5]))[0], rel=1e-9)
    assert given.force_total == pytest.approx(3.0, rel=1e-9)
    assert sum(given.tooth_forces) == pytest.approx(3.0 * given.force_ratio, rel=1e-10)  # as much is not shipped
    size = sum(path.stat().st_size for path in surface.STORED.glob(f"{design}.*"))
    assert size < 500_000


@pytest.mark.slow
def test_the_estimate_at_the_asked_modulus_holds_against_a_finer_mesh(found: Surface) -> None:
    moduli = np.geomspace(2.4e3, 2.4e8, 30)
    finer = axisymmetric.curve(round_parameters(ROUND, LOAD), axisymmetric.REFINEMENTS[-1])
    apart = np.abs(found.force_ratios(moduli) - finer.force_ratios(moduli)[:, 0])
    estimates = found.estimates(moduli)[0]
    assert (apart <= estimates).all() and estimates.max() < 1e-5
    assert len(set(estimates)) > 5


def test_many_moduli_have_the_answers_of_each() -> None:
    for design in ("single_round", "single"):
        sensor = get_design(design)
        loads = [through(LOAD, modulus) for modulus in (1e4, 1e5, 1e13, 2.3e3)]
        for each, alone in zip(
            responses(sensor, loads, "surface"), [response(sensor, load, "surface") for load in loads], strict=True
        ):
            assert each.force_ratio == pytest.approx(alone.force_ratio, rel=1e-13)
            assert each.error_estimate == pytest.approx(alone.error_estimate, rel=1e-9)
            assert each.films.keys() == alone.films.keys()


def test_the_curve_of_a_surface_is_its_poles_with_the_greatest_estimate(found: Surface) -> None:
    curve = ratio_curve(ROUND, LOAD, "surface")
    moduli = np.geomspace(*curve.moduli, 50)
    assert curve.force_ratio(moduli) == pytest.approx(found.force_ratios(moduli), rel=1e-12)
    assert curve.error == pytest.approx(found.estimates(moduli)[0].max(), rel=0.2)


# --- which files ---------------------------------------------------------------------------------------


NONE = (RangeError, "has no surface for design 'single_round' with these dimensions")


@pytest.mark.parametrize(
    ("other", "error", "message"),
    [
        ("sensor", *NONE),
        ("version", *NONE),
        ("hash", ConfigError, r"it was written for something else.*build it again"),
        ("missing", ConfigError, r"not readable \(No such file.*palpate model surfaces --store"),
    ],
)
def test_curves_of_another_sensor_or_version_are_not_taken_and_a_missing_file_not_for_another_sensor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: str, error: type[Exception], message: str
) -> None:
    monkeypatch.setattr(surface, "STORED", tmp_path)
    files = [(path, key) for _, path, key in surface.places("single_round", round_parameters(ROUND, LOAD))]
    mesh = RoundMesh(axisymmetric.curve(round_parameters(ROUND, LOAD), 1), 1.0)
    for path, key in files[other == "missing" :]:
        write(path, mesh, "0" * 64 if other == "hash" else key)
    if error is RangeError:
        surface.read_surface.__wrapped__(ROUND, LOAD)
    if other == "version":
        monkeypatch.setattr(surface, "CODE_VERSION", surface.CODE_VERSION + 1)
    asked = replace(PHYSICAL, sensed_thickness=2e-3).load(1e5) if other == "sensor" else LOAD
    with pytest.raises(error, match=message):
        surface.read_surface.__wrapped__(ROUND, asked)


@pytest.mark.parametrize("design", SHIPPED)
def test_auto_reads_off_each_design_without_setting_up_a_mesh(design: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A measurement on 16 teeth waited many minutes for its first answer."""
    for model in (axisymmetric, solid):
        monkeypatch.setattr(model, "curve", lambda *_: pytest.fail("a mesh was set up"))
    sample = ratio_curve(get_design(design), LOAD, "auto")
    assert sample.model == "surface" and sample.error <= AUTO_TOLERANCE


def test_many_teeth_have_fewer_meshes() -> None:
    few, most = (solid_parameters(get_design(name), LOAD) for name in ("common_base", "array_16"))
    assert len(surface.refinements_of(few)) > len(surface.refinements_of(most)) >= 2


@pytest.mark.parametrize("design", ["single", "common_base", "different_base"])
def test_shipped_curves_of_one_tooth_and_of_pairs_are_certified_to_1e_4(design: str) -> None:
    shipped = surface.find(get_design(design), LOAD)
    assert shipped.estimates(np.geomspace(2.4e3, 2.4e9, 61))[0].max() <= 1e-4


def test_every_shipped_file_belongs_to_a_design_as_it_is() -> None:
    expected = set()
    for name in SHIPPED:
        for parameters in surface.SETS if get_design(name).thesis_force_ratio else surface.SETS[:1]:
            chosen = get_parameter_set(parameters, "surface")
            sensor = surface.surface_parameters(chosen.design(get_design(name)), chosen.load(1e5))
            expected |= {path for _, path, _ in surface.places(name, sensor)}
    assert set(surface.STORED.iterdir()) == expected


@pytest.mark.parametrize(
    "design, load, model",
    [
        ("single", replace(PHYSICAL, sensed_thickness=2e-3).load(1e5), "solid"),
        ("single", replace(PHYSICAL, interface="frictionless").load(1e5), "solid"),
        ("single_round", replace(PHYSICAL, sensed_poisson=0.4).load(1e5), "axisymmetric"),
        ("single", replace(PHYSICAL.load(1e5), at=(1e-3, 1e-3)), "solid"),
        ("single_round", replace(PHYSICAL.load(1e5), at=(5e-3, 5e-3)), "solid"),
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


def test_a_surface_does_not_depend_on_modulus_or_force() -> None:
    sensor = solid_parameters(get_design("single"), LOAD)
    other = replace(sensor, sensed_modulus=7.0, force=4.0)
    assert isinstance(other, SolidParameters)
    assert surface.curve_hash(sensor, 1) == surface.curve_hash(other, 1) != surface.curve_hash(sensor, 2)


def test_meshes_that_an_estimate_asks_beside_are_known_by_what_they_are_of() -> None:
    """Not by their place among these: what was another sensor's or mesh's is not taken for it."""
    sensor = solid_parameters(get_design("array"), LOAD)
    keys = [key for refinement, _, key in surface.places("array", sensor) if isinstance(refinement, str)]
    asked = solid.beside(sensor, len(surface.refinements_of(sensor)))
    assert keys == [surface.curve_hash(*each) for each in asked]
    assert len(set(keys)) == len(asked) > 2
    of, mesh = asked[0]
    assert surface.curve_hash(replace(of, sensed_thickness=1e-3), mesh) not in keys
