"""What films, bases and sections of the solid model give, on the smallest meshes that show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models import film
from palpate.instrument.models.axisymmetric import curves
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters, SolidParameters
from palpate.instrument.models.response import response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import Resolution
from palpate.instrument.models.solid.model import solve_on
from palpate.instrument.models.solid.system import System, section
from palpate.instrument.models.table import FilmLoad
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import PVDF
from tests import meshes
from tests.instrument.coupled import coupled

SMALLEST = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
THREE_LAYERS = Resolution(layers=3, ratio=0.2, sectors=1, degree=2)
APART = SolidParameters(cell_length=12e-3, cell_width=12e-3, columns=2, separate_bases=True)


@pytest.fixture
def one_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    meshes.give(monkeypatch, *[SMALLEST] * 3)


def test_another_force_on_the_same_sensor_is_not_solved_again(one_layer: None, monkeypatch: pytest.MonkeyPatch) -> None:
    sensor, load = get_design("single"), PHYSICAL.load(1e5)
    one = response(sensor, load, "solid")
    monkeypatch.setattr(solid, "found_on", None)
    three = response(sensor, replace(load, force=3.0), "solid")
    assert (three.force_ratio, three.error_estimate) == (one.force_ratio, one.error_estimate)
    assert three.tooth_forces == pytest.approx([3 * force for force in one.tooth_forces])
    assert three.force_total == pytest.approx(3.0, abs=1e-9)
    for name, film_load in three.films.items():
        assert film_load.force == pytest.approx(3 * one.films[name].force)
        assert film_load.plane_stress == pytest.approx([3 * s for s in one.films[name].plane_stress or ()])


@pytest.mark.parametrize("plate_modulus", [70e6, 3e9])
def test_films_of_a_round_sensor_feel_what_the_round_model_says(plate_modulus: float) -> None:
    """Soft plates stretch the base film; stiff ones press it. With two layers it is off by 4 %, the tooth's by 7."""
    ours = solve_on(SolidParameters(outline="round", plate_modulus=plate_modulus, film=PVDF.round()), THREE_LAYERS)
    films = axisymmetric.solve(RoundParameters(plate_modulus=plate_modulus), 1).films
    assert ours.tooth_films[0] == pytest.approx((films["tooth"].plane_stress,) * 2, rel=0.03)
    assert ours.base_films[0] == pytest.approx((films["base"].plane_stress,) * 2, rel=0.03)
    for (voltage, charge), film_ in zip(ours.signals, films.values(), strict=True):
        assert (voltage, charge) == pytest.approx((film_.voltage, film_.charge), rel=0.03)


def test_turning_the_load_turns_the_films_stresses() -> None:
    sensor = SolidParameters(film=PVDF.round())
    along, across = (solve_on(replace(sensor, load_at=at), SMALLEST) for at in ((6.5e-3, 5e-3), (5e-3, 6.5e-3)))
    for one, other in ((along.tooth_films, across.tooth_films), (along.base_films, across.base_films)):
        assert one[0] == pytest.approx(other[0][::-1], rel=1e-6)
        assert one[0][0] != pytest.approx(one[0][1], rel=1e-3)


@pytest.mark.slow
def test_half_a_sensor_has_the_films_of_the_whole() -> None:
    """Symmetry across the width only, and along the length as well."""
    half = System(APART, SMALLEST, mirrored=(False, True))
    goals = half.curve([half.load(None)]).poles.values(np.array([APART.sensed_modulus]))[0, :, 0]
    quarter = solve_on(APART, SMALLEST)
    stresses = np.array((*quarter.tooth_films, *quarter.base_films))
    assert goals == pytest.approx([*quarter.tooth_forces, *quarter.base_forces, *stresses.T.ravel()], rel=1e-6)


@pytest.mark.slow
def test_every_film_of_a_design_gives_a_voltage_under_a_point_load(one_layer: None) -> None:
    design = get_design("different_base")
    answer = response(design, replace(PHYSICAL.load(1e5, force=3.0), at=(5e-3, 6e-3)), "solid", 0.1)
    felt = {name: load.force for name, load in answer.films.items()}
    assert felt["rigid_1"] == answer.tooth_forces[0] > 10 * abs(felt["rigid_2"])
    assert felt["total_1"] + felt["total_2"] == pytest.approx(3.0, abs=1e-9)
    free = film.signals(design, replace(answer, films={name: FilmLoad(force) for name, force in felt.items()}))
    for name, given in film.signals(design, answer).items():
        assert given.voltage != pytest.approx(free[name].voltage, rel=0.01)
        # One material on one circuit: what its stresses give is the voltage that they were coupled to.
        again = film.film_response(
            design.film_sheet.material,
            design.film_area(design.film(name)),
            design.film_sheet.thickness,
            given.force,
            "free",
            "open",
            given.plane_stress or (0.0, 0.0),
        )
        assert again.voltage == pytest.approx(given.voltage, rel=1e-9, abs=1e-9)


def test_a_section_shows_one_bonded_stack() -> None:
    cut = section(SolidParameters(outline="round"), 0)
    object_, tooth = cut.bodies["object"][0], cut.bodies["tooth"][0]
    assert [len(cut.bodies[name]) for name in ("object", "tooth", "ring", "upper plate")] == [1, 1, 2, 1]
    for ours, its in ((object_.along, tooth.along), (object_.up, tooth.up)):
        at = np.interp(tooth.x[:, -1], object_.x[:, 0], ours[:, 0])
        assert at == pytest.approx(its[:, -1], abs=1e-12)
    assert object_.up == pytest.approx(object_.up[::-1], abs=1e-12)
    assert object_.along == pytest.approx(-object_.along[::-1], abs=1e-12)
    assert object_.up[:, -1].max() < 0 == cut.bodies["lower plate"][0].up[:, 0].max()


def test_the_pressure_on_a_round_face_is_that_of_the_round_model() -> None:
    """Away from the edges, where it is singular."""
    cut, face = section(SolidParameters(outline="round"), 0), curves.section(RoundParameters(), 3, 2).face
    radius = np.array([0.3e-3, 2.5e-3, 3e-3, 3.5e-3, 4e-3])
    its = np.interp(radius, face.radius, face.pressure)
    for ours in (np.interp(5e-3 + radius, cut.x, cut.pressure), np.interp(5e-3 - radius, cut.x, cut.pressure)):
        assert ours == pytest.approx(its, rel=0.08)


def test_a_load_beside_the_middle_leaves_the_section_whole(one_layer: None) -> None:
    cut = section(replace(APART, load_at=(10e-3, 6e-3)), 0)
    assert [len(cut.bodies[name]) for name in ("object", "tooth", "ring", "upper plate")] == [1, 2, 4, 2]
    lowest = cut.bodies["object"][0].x[np.argmin(cut.bodies["object"][0].up[:, -1]), 0]
    assert lowest == pytest.approx(10e-3, abs=1e-3)


@pytest.mark.parametrize(
    "plate_modulus, layers, limit",
    [(70e6, 0, 0.04), *(pytest.param(modulus, 2, 0.005, marks=pytest.mark.slow) for modulus in (3e9,))],
)
def test_films_give_the_voltages_of_a_solution_with_a_field_of_its_own(
    plate_modulus: float, layers: int, limit: float
) -> None:
    """Soft plates stretch the base film, stiff ones press it: with two materials the voltages were up to 69 % apart."""
    sensor = RoundParameters(compliant_poisson=0.3, plate_modulus=plate_modulus)
    ratio, voltages = coupled(sensor, layers)
    found = axisymmetric.solve(sensor, 2)
    assert found.force_ratio == pytest.approx(ratio, rel=limit)
    for film_, voltage in zip(found.films.values(), voltages.values(), strict=True):
        assert film_.voltage == pytest.approx(voltage, rel=limit)
