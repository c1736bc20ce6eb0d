"""The solid model against exact solutions, the round model and solutions for one modulus; its films and sections."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models import film
from palpate.instrument.models.axisymmetric import curves
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import (
    IDENTIFIED_SOLID,
    PHYSICAL,
    RoundParameters,
    SolidParameters,
    solid_parameters,
)
from palpate.instrument.models.response import response
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import OF_FEW_TEETH, Resolution
from palpate.instrument.models.solid.mesh import (
    Elastic,
    HeightElements,
    PlanElements,
    PlanMesh,
    SolidBody,
    UnitCell,
    graded,
    plan_basis,
    plan_mesh,
)
from palpate.instrument.models.solid.model import curve_on, point_loads, solve, solve_on, solve_to
from palpate.instrument.models.solid.system import System, section
from palpate.instrument.models.table import FilmLoad
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import PVDF
from palpate.instrument.thesis import read_table
from tests.instrument.coupled import coupled
from tests.instrument.direct import direct
from tests.settings import disc, give_meshes
from tests.shares import first_of

SMALLEST = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
COARSE = SolidParameters(interface="frictionless", support="rigid")
PAIR = replace(COARSE, cell_length=12e-3, cell_width=12e-3, columns=2)


@functools.cache
def coarse_ratio(compliant_poisson: float) -> float:
    return solve(replace(COARSE, compliant_poisson=compliant_poisson), 0).force_ratio


@pytest.fixture
def one_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The smallest mesh, for what holds exactly on any."""
    give_meshes(monkeypatch, *[SMALLEST] * 3)


def unit_cell(sectors: int = 1, degree: int = 2) -> tuple[PlanMesh, PlanElements]:
    """A whole cell of 12 x 12 mm around the origin."""
    cell = UnitCell(6e-3, 6e-3, 1.4e-3, 1.5e-3, 5e-3)
    quarters = {(i, j): (0.0, 0.0, 0) for i in (0, 1) for j in (0, 1)}
    plan = plan_mesh(cell, quarters, Resolution(layers=2, ratio=0.3, sectors=sectors, degree=degree))
    return plan, PlanElements(plan_basis(plan, degree), np.arange(plan.mesh.nelements), degree)


def common_base(modulus: float) -> SolidParameters:
    """The set identified from Tables A2.1 and A2.3."""
    return solid_parameters(IDENTIFIED_SOLID.design(get_design("common_base")), IDENTIFIED_SOLID.load(modulus))


@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.3, 0.49])
def test_a_homogeneous_strain_has_the_exact_energy(poisson: float) -> None:
    plan, matrices = unit_cell()
    x, y = plan_basis(plan, 2).doflocs
    breaks = graded(0.0, 2e-3, 2, 0.3, "both")
    body = SolidBody(matrices, HeightElements(breaks, 2), Elastic(1e5, poisson))
    z = np.concatenate([breaks[:-1], (breaks[1:] + breaks[:-1]) / 2, breaks[-1:]])
    strain = np.array([[1e-3, 4e-4, -2e-4], [4e-4, -5e-4, 3e-4], [-2e-4, 3e-4, 7e-4]])
    places = np.stack(np.broadcast_arrays(x, y, z[:, None]))
    displacement = body.local(np.einsum("ab,bhn->ahn", strain, places))
    shear, lame = 1e5 / (2 * (1 + poisson)), 1e5 * poisson / ((1 + poisson) * (1 - 2 * poisson))
    density = shear * np.sum(strain**2) + lame / 2 * np.trace(strain) ** 2
    energy = np.einsum("ei,eij,ej->", displacement, body.stiffness(), displacement) / 2
    assert energy == pytest.approx(density * 12e-3**2 * 2e-3, rel=1e-10)


@pytest.mark.parametrize("sectors", [1, 2, 3])
def test_curved_elements_have_the_area_of_the_circle(sectors: int) -> None:
    plan, _ = unit_cell(sectors)
    areas = plan_basis(plan, 2).dx.sum(axis=1)
    assert areas[plan.region == 0].sum() == pytest.approx(math.pi * 1.4e-3**2, rel=1e-12)
    assert areas.sum() == pytest.approx(12e-3**2, rel=1e-12)


@pytest.mark.parametrize(
    "parameters",
    [
        COARSE,
        SolidParameters(),
        replace(PAIR, support="elastic", separate_bases=True),
        replace(COARSE, load="platen", sensed_modulus=140e9),
        replace(COARSE, load_at=(0.0, 5e-3)),
        replace(COARSE, load_at=(10e-3, 10e-3)),
    ],
)
def test_forces_balance(parameters: SolidParameters) -> None:
    solution = solve(parameters, 0)
    assert solution.total_force == pytest.approx(1.0, abs=1e-10)


def test_the_whole_sensor_gives_what_its_quarter_gives(one_layer: None) -> None:
    centre = (5e-3, 5e-3)
    quarter = solve(replace(COARSE, load_at=centre), 0).tooth_forces
    whole = point_loads(COARSE, [centre, (4e-3, 5.5e-3)], 0)[0]
    assert whole == pytest.approx(quarter, rel=1e-8)


def test_mirrored_loads_give_mirrored_forces(one_layer: None) -> None:
    left, right = point_loads(PAIR, [(4e-3, 6e-3), (20e-3, 6e-3)], 0)
    assert left == pytest.approx(right[::-1], rel=1e-8)
    assert left[0] > left[1]


@pytest.mark.slow
def test_a_load_here_moves_there_as_a_load_there_moves_here(one_layer: None) -> None:
    system = System(SolidParameters(interface="frictionless"), OF_FEW_TEETH.resolutions[0], mirrored=(False, True))
    here, there = system.load((2e-3, 5e-3)), system.load((8.5e-3, 5e-3))
    work = there @ system.displacement(here)
    assert work == pytest.approx(here @ system.displacement(there), rel=1e-9)


@pytest.mark.parametrize("poisson", [0.499999, 0.5])
def test_rubber_does_not_lock(poisson: float) -> None:
    assert coarse_ratio(poisson) == pytest.approx(coarse_ratio(0.498), rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    first_of([
        {},
        # No gap and an object as soft as the ring: the stress at the tooth's edge is at its most singular.
        {"ring_inner_radius": 1.4e-3, "interface": "bonded", "sensed_modulus": 2.5e4, "sensed_thickness": 1.1e-3},
    ]),
)  # fmt: skip
def test_the_error_estimate_covers_the_distance_to_the_round_model(change: dict[str, Any]) -> None:
    solution, estimate = solve_to(replace(COARSE, outline="round", **change), 0.1)
    known = axisymmetric.solve(disc(replace(COARSE, outline="round", **change)), 2).force_ratio
    assert abs(solution.force_ratio - known) <= estimate


@pytest.mark.parametrize("gap", [1e-5, 1e-7, 0.0])
def test_a_closed_gap_is_no_singular_case(gap: float) -> None:
    closed = solve(replace(COARSE, ring_inner_radius=COARSE.tooth_radius + gap), 0)
    assert closed.total_force == pytest.approx(1.0, abs=1e-9)
    assert closed.force_ratio == pytest.approx(coarse_ratio(COARSE.compliant_poisson), abs=0.03)


@pytest.mark.parametrize("modulus", ["14900", "102700", "720000", "140000000000"])
def test_table_A2_3_is_met_by_the_identified_set(modulus: str) -> None:
    table = read_table("A2.3")
    expected = abs(table.values("force_ratio")[table.rows.index(modulus)])
    assert solve(common_base(float(modulus)), 0).force_ratio == pytest.approx(expected, abs=0.015)


def test_table_A2_7_is_met_between_the_teeth_and_not_above_one() -> None:
    """430 kPa is the modulus at which Table A2.3 has the 0.4864 that A2.7 has for every load beside a tooth."""
    parameters = common_base(430e3)
    middle, over = point_loads(parameters, [(12e-3, 6e-3), (18e-3, 6e-3)], 0)
    right, left = (read_table("A2.7").values(f"force_pvdf{film}_N") for film in (1, 3))
    assert middle == pytest.approx([left[12], right[12]], abs=0.005)
    assert over[1] < right[18] - 0.1


@pytest.mark.parametrize(
    ("parameters", "change", "message"),
    [
        (SolidParameters(), {"sensed_modulus": 0.0}, "sensed_modulus 0 Pa"),
        (SolidParameters(), {"sensed_modulus": math.nan}, "sensed_modulus nan"),
        (SolidParameters(), {"sensed_thickness": math.inf}, "sensed_thickness inf"),
        (SolidParameters(), {"sensed_poisson": 0.51}, "outside \\(-1, 0.5\\]"),
        (SolidParameters(), {"tooth_radius": 2e-3}, "overlap"),
        (SolidParameters(), {"ring_outer_radius": 6e-3}, "overlap"),
        (SolidParameters(), {"columns": 0}, "at least one"),
        (SolidParameters(), {"load_at": (11e-3, 5e-3)}, "off the object"),
        (SolidParameters(), {"outline": "round", "columns": 2}, "holds one tooth"),
        (RoundParameters(), {"sensed_modulus": 0.0}, "sensed_modulus 0 Pa is not above 0"),
        (RoundParameters(), {"sensed_thickness": math.nan}, "sensed_thickness nan m"),
        (RoundParameters(), {"compliant_modulus": math.inf}, "compliant_modulus inf Pa"),
        (RoundParameters(), {"sensed_thickness": 10.0}, "sensed_thickness 10 m is outside 5e-08 to 1.5 m"),
        (RoundParameters(), {"sensor_height": 1e-9}, "sensor_height 1e-09 m is outside 5e-08 to 1.5 m"),
        (RoundParameters(), {"plate_modulus": 1e300}, r"plate_modulus 1e\+300 Pa is outside 0.001 to 1e\+20 Pa"),
        (RoundParameters(), {"sensed_poisson": 0.51}, r"sensed_poisson 0.51 is outside \(-1, 0.5\]"),
        (RoundParameters(), {"compliant_poisson": -1.0}, "compliant_poisson -1 is outside"),
        (RoundParameters(), {"tooth_radius": 1.6e-3}, "parts overlap: tooth_radius 0.0016 m"),
        (RoundParameters(), {"ring_outer_radius": 1.5e-3}, "parts overlap: ring_inner_radius"),
        (RoundParameters(), {"sensed_radius": 1.5e-3}, "does not reach the ring"),
    ],
)
def test_impossible_parameters_are_refused(
    parameters: SolidParameters | RoundParameters, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(RangeError, match=message):
        replace(parameters, **change)


@pytest.mark.parametrize("parameters", [SolidParameters(), RoundParameters()])
def test_an_unknown_choice_is_refused(parameters: SolidParameters | RoundParameters) -> None:
    with pytest.raises(UnknownName, match="bonded"):
        replace(parameters, interface="glued")


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda: solve_to(COARSE, 0.0), "tolerance 0 is not above 0"),
        (lambda: solve_to(COARSE, 1e-12), "tolerance 1e-12: model 'solid' rounds its ratio by up to 1e-08"),
        (lambda: axisymmetric.solve_to(RoundParameters(), 1e-9), "cannot meet tolerance 1e-09: its least error"),
        (lambda: axisymmetric.solve_to(RoundParameters(), math.nan), "tolerance nan"),
        (lambda: solve(COARSE, 9), "refinement 9"),
        (lambda: axisymmetric.solve(RoundParameters(), 9), "refinement 9"),
    ],
)
def test_a_tolerance_or_mesh_that_the_model_does_not_have_is_refused(
    asked: Callable[[], object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(axisymmetric, "REFINEMENTS", (1, 2))
    with pytest.raises(RangeError, match=message):
        asked()


# --- Curves of the solid model over the modulus of the object, beside solutions for one modulus at a time

UNLIKE = Resolution(layers=1, ratio=0.2, sectors=1, degree=3, rubber=4, stiff=2)  # degrees of elements differ
RIGID: dict[str, Any] = {"support": "rigid"}
RATIOS = (1e-2, 4.0, 1e8)  # moduli of the object over the ring's
TWO_TEETH: dict[str, Any] = {"cell_length": 12e-3, "cell_width": 12e-3, "columns": 2}
ROW: dict[str, Any] = {**TWO_TEETH, "outline": "square", "ring_outline": "round"}
# Softer across the film than along it, and sheared more easily: the mirror turns it into another film.
UNEQUAL = replace(
    PVDF, compliance=(0.082e-8, 0.2e-8, 0.0945e-8, -0.035e-8, -0.03e-8, -0.0265e-8, 0.5e-8, 0.225e-8, 0.3e-8)
)
SENSORS: dict[str, tuple[dict[str, Any], float]] = {
    "bonded": ({}, 1e-10),
    "unlike degrees": ({}, 1e-10),
    "rigid, bonded": (RIGID, 1e-10),
    "rigid, capped": ({**RIGID, "interface": "capped"}, 1e-10),
    "rigid, closed gap": ({**RIGID, "ring_inner_radius": 1.4e-3}, 1e-10),
    "platen": ({"load": "platen"}, 1e-10),
    "pair": ({**TWO_TEETH, **RIGID, "separate_bases": True}, 1e-10),
    "rigid, incompressible": ({**RIGID, "sensed_poisson": 0.5, "compliant_poisson": 0.5}, 1e-7),
    "thin, nearly incompressible": ({"sensed_poisson": 0.499999, "sensed_thickness": 3e-4}, 1e-7),
    "a film that is its own mirror image no more": ({"film": UNEQUAL}, 1e-10),
    # cells that are alike: one is eliminated for all
    "two and a half of five cells": ({**ROW, "columns": 5}, 1e-10),
    "cells with bases of their own": ({**ROW, "columns": 4, "rows": 2, "separate_bases": True}, 1e-10),
    "capped cells": ({**ROW, "columns": 4, "interface": "capped"}, 1e-10),
}


PLAIN = ("rigid, bonded", "rigid, incompressible", "a film that is its own mirror image no more")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in PLAIN else pytest.mark.slow) for name in SENSORS]
)
def test_a_curve_gives_what_a_solution_for_each_modulus_does(name: str) -> None:
    changed, within = SENSORS[name]
    sensor = replace(SolidParameters(), **changed)
    mesh = UNLIKE if name == "unlike degrees" else SMALLEST
    found = curve_on(sensor, mesh).poles
    for ratio in RATIOS:
        modulus = ratio * sensor.compliant_modulus
        known = direct(replace(sensor, sensed_modulus=modulus), mesh)
        assert solve_on(replace(sensor, sensed_modulus=modulus), mesh).force_ratio == pytest.approx(
            known.force_ratio, abs=within
        )
        voltages = found.voltages(np.array([modulus]))[0, :, 0]
        assert voltages == pytest.approx(known.voltages, rel=10 * within)


def test_the_energy_that_tears_a_closed_gap_is_finite_for_an_incompressible_ring() -> None:
    """What tears the ring from a rigid tooth strains it but keeps its volume. Error estimates count this energy."""
    closed = replace(SolidParameters(), **RIGID, ring_inner_radius=1.4e-3)
    soft, stiff = (curve_on(replace(closed, compliant_poisson=each), SMALLEST).poles.least for each in (0.498, 0.5))
    assert stiff == pytest.approx(soft, rel=5e-3)


# --- What films, bases and sections of the solid model give, on the smallest meshes that show it -------

THREE_LAYERS = Resolution(layers=3, ratio=0.2, sectors=1, degree=2)
APART = SolidParameters(cell_length=12e-3, cell_width=12e-3, columns=2, separate_bases=True)


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
