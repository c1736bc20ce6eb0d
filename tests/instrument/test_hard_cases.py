"""The cases that break a plain program, each beside what a plain program makes of it (`naive.py`)."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.models import beam, springs
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.beam import BeamSegment
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.models.solid.ladders import OF_MANY_TEETH, Resolution
from palpate.instrument.models.solid.mesh import Elastic, Names, SolidBody
from palpate.instrument.models.solid.system import System
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import FilmMaterial
from palpate.instrument.sensor.sample import get_sample
from tests.instrument import naive
from tests.instrument.direct_round import solve, solve_on
from tests.settings import disc
from tests.shares import first_of

CASE_A = RoundParameters()
RIGID = replace(CASE_A, support="rigid")
# Bends like a foil, rides on rubber: its motion is 1e8 times its strain.
FOIL = replace(CASE_A, sensed_thickness=10e-6, sensed_modulus=140e9)
SHARE = (1.4 / 5) ** 2


@pytest.mark.parametrize("modulus", [1.49e4, 140e9])
@pytest.mark.parametrize("thickness", first_of([10e-6, 100e-3]))
@pytest.mark.parametrize("poisson", first_of([0.5, 0.3]))
def test_forces_balance_to_1e_10_whatever_the_object(modulus: float, thickness: float, poisson: float) -> None:
    solution = solve(replace(CASE_A, sensed_modulus=modulus, sensed_thickness=thickness, sensed_poisson=poisson), 1)
    assert solution.imbalance < 1e-10
    assert solution.residual < 1e-12


def test_forces_from_nodal_values_lose_what_those_from_differences_keep() -> None:
    foil = replace(FOIL, support="rigid", compliant_poisson=0.3)
    assert naive.lost_force(foil, 3, 2) > 1e-8
    assert solve_on(foil, 3, 2).imbalance < 1e-12


def test_pressure_as_an_unknown_holds_where_displacements_alone_lose_digits() -> None:
    rubber = replace(CASE_A, sensed_poisson=0.49999999, compliant_poisson=0.49999999, interface="frictionless")
    exact = solve(rubber, 2).force_ratio
    assert abs(solve(rubber, 1).force_ratio - exact) < 5e-4
    assert abs(solve_on(rubber, 3, 2, mixed=False).force_ratio - exact) > 1e-2


def test_incompressible_rubber_squeezed_flat_is_solved_like_any_other() -> None:
    flat = replace(CASE_A, sensed_modulus=1e10, compliant_poisson=0.4999, sensor_height=0.3e-3, plate_modulus=1e10)
    assert solve(flat, 1).residual < 1e-13


@pytest.mark.slow
def test_a_foil_of_rubber_like_poisson_ratio_keeps_its_digits_with_a_bound_below_its_own_bulk_modulus() -> None:
    foil = replace(FOIL, sensed_poisson=0.4999, ring_inner_radius=CASE_A.tooth_radius + 1e-6)
    assert solve_on(foil, 3, 3).imbalance < 1e-10


@pytest.mark.parametrize("radius", [0.5e-3, 4.9e-3])
def test_the_tooth_may_take_a_hundredth_or_nearly_all_of_the_face(radius: float) -> None:
    sensor = replace(RIGID, tooth_radius=radius, ring_inner_radius=radius + 1e-5, sensed_modulus=24e3)
    coarse, fine = solve(sensor, 1), solve(sensor, 2)
    assert (radius / 5e-3) ** 2 < fine.force_ratio < 1
    assert fine.force_ratio == pytest.approx(coarse.force_ratio, rel=1e-3)
    assert fine.imbalance < 1e-12
    # A film that is much softer than all below it passes its load straight down, that over the gap to both sides.
    film = replace(
        sensor, sensed_modulus=1.0, sensed_thickness=1e-5, sensed_poisson=0.0, ring_inner_radius=radius + 1e-6
    )
    assert solve(film, 1).force_ratio == pytest.approx(((radius + 0.5e-6) / 5e-3) ** 2, rel=5e-4)


def test_many_elements_of_a_beam_drown_it_in_rounding_where_rigid_motion_is_not_apart() -> None:
    """Bending of an element grows with its length to the power -3, so that four more elements cost two digits."""
    bending, stretches = 4.85e-3, (BeamSegment(1.4e-3, 8e6), BeamSegment(3.5e-3, 3e5))
    exact = beam.exact_forces(bending, stretches)[0]
    plain = {n: abs(naive.beam_forces(bending, stretches, n)[0] / exact - 1) for n in (2, 4, 64, 256)}
    assert plain[4] < plain[2] / 10
    assert plain[4] < plain[64] < plain[256]
    assert plain[256] > 1e-5
    for elements in (beam.ELEMENTS, 64, 256):
        forces = beam.stretch_forces(bending, stretches, elements)
        assert abs(forces[0] / exact - 1) < 1e-9
        assert abs(sum(forces) / 4.9e-3 - 1) < 1e-13


def test_every_model_hands_a_hard_object_to_the_tooth() -> None:
    hard, design = replace(get_sample("1"), modulus=1e15), get_design("single")
    for ratio in (
        springs.force_ratio(design, hard),
        beam.force_ratio(design, hard),
        beam.exact_force_ratio(design, hard),
        solve(replace(RIGID, sensed_modulus=1e15), 1).force_ratio,
        solid.solve(SolidParameters(support="rigid", sensed_modulus=1e15), 0).force_ratio,
    ):
        assert ratio == pytest.approx(1, abs=1e-6)


@pytest.mark.slow
def test_every_model_with_areas_hands_a_soft_film_s_load_straight_down() -> None:
    """A gap of 1 µm, no contraction: the tooth takes its share of the area."""
    thin = {"sensed_modulus": 1.0, "sensed_thickness": 1e-5, "sensed_poisson": 0.0, "ring_inner_radius": 1.401e-3}
    design = get_design("single_round")
    closed = replace(design, ring=replace(design.ring, inner_radius=1.401e-3))
    for ratio in (
        springs.ratio_of_modulus(closed, 1e-12, 1e-5),
        solve(RoundParameters(support="rigid", **thin), 1).force_ratio,  # type: ignore[arg-type]
        solid.solve(SolidParameters(support="rigid", outline="round", **thin), 1).force_ratio,  # type: ignore[arg-type]
    ):
        assert ratio == pytest.approx(SHARE, rel=1e-3)


@pytest.mark.parametrize("interface", ["bonded", "frictionless"])
def test_between_hard_plates_tooth_and_ring_are_springs_in_parallel(interface: str) -> None:
    """Poisson ratio 0: each column is in uniaxial stress, whatever holds it at its ends."""
    columns = RoundParameters(
        **{f"{part}_poisson": 0.0 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        interface=interface,
        tooth_modulus=72e3,
        film=FilmMaterial.isotropic(72e3, 0.0),
        compliant_modulus=24e3,
        sensed_modulus=24e12,
        plate_modulus=24e12,
    )
    tooth, ring = 3 * 1.4**2, 5.0**2 - 1.5**2
    assert solve(columns, 1).force_ratio == pytest.approx(tooth / (tooth + ring), rel=1e-6)


# --- Hard cases of the solid model, the naive formulation beside the shipped one -----------------------

Vector = NDArray[np.float64]

SMALLEST = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
SLIDING = SolidParameters(interface="frictionless", support="rigid")
SHIPPED = SolidBody.stiffness
ROUND = replace(SLIDING, outline="round", sensed_modulus=1e6, sensed_thickness=1e-3)


@functools.cache
def exact(poisson: float) -> float:
    """Force ratio of ROUND, its object of that Poisson ratio, by the round model."""
    p = RoundParameters(
        interface="frictionless", support="rigid", sensed_modulus=1e6, sensed_thickness=1e-3, sensed_poisson=poisson
    )
    return axisymmetric.solve(p, 2).force_ratio


def ratio(parameters: SolidParameters, resolution: Resolution) -> float:
    """Force ratio, solved anew."""
    system = System(parameters, resolution)
    found = system.curve([system.load(None)]).poles.force_ratios(np.array([parameters.sensed_modulus]))
    return float(found[0, 0])


def plain_displacement(body: SolidBody, elements: Names | None = None, _added: float = 0.0) -> Vector:
    """Element matrices with the dilatation of every point, not only of the pressure's polynomials."""
    p, h = body.plan, body.height
    nu = body.material.poisson
    lame = body.material.modulus * nu / ((1 + nu) * (1 - 2 * nu))
    matrix = SHIPPED(SolidBody(p, h, Elastic(2 * body.material.shear, 0.0)), elements)
    body.add_law(matrix, lame * np.einsum("ad,be->adbe", np.eye(3), np.eye(3)), elements)
    return matrix


def test_plain_displacement_elements_agree_where_rubber_is_compressible(monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = ratio(replace(ROUND, sensed_poisson=0.3), SMALLEST)
    monkeypatch.setattr(SolidBody, "stiffness", plain_displacement)
    assert 0 < abs(ratio(replace(ROUND, sensed_poisson=0.3), SMALLEST) - shipped) < 0.01


@pytest.mark.slow
def test_rubber_locks_plain_displacement_elements_and_not_the_shipped_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    rubber = replace(ROUND, sensed_poisson=0.499999)
    shipped = abs(ratio(rubber, OF_MANY_TEETH.resolutions[0]) - exact(0.499999))
    assert shipped < 0.01
    monkeypatch.setattr(SolidBody, "stiffness", plain_displacement)
    assert abs(ratio(rubber, OF_MANY_TEETH.resolutions[0]) - exact(0.499999)) > 10 * shipped


@pytest.mark.parametrize("soft, hard", [("sensed_modulus", "tooth_modulus"), ("compliant_modulus", "sensed_modulus")])
def test_moduli_of_15_kPa_and_140_GPa_stand_side_by_side(soft: str, hard: str) -> None:
    solution = solid.solve_on(replace(SolidParameters(), **{soft: 1.49e4, hard: 140e9}), SMALLEST)
    assert sum(solution.base_forces) == pytest.approx(1.0, abs=1e-9)
    assert 0 < solution.force_ratio < 1


@pytest.mark.slow
def test_a_closed_gap_leaves_no_hole_between_object_and_ring() -> None:
    """Reference: the round model, whose ring touches the tooth. With the ring's edge let go, off by 0.015 to 0.03."""
    closed = {"ring_inner_radius": 1.4e-3, "sensed_modulus": 2e5, "sensed_thickness": 3.5e-4, "sensed_poisson": 0.4999}
    its = axisymmetric.solve(replace(RoundParameters(compliant_poisson=0.455), **closed), 2).force_ratio
    ours = solid.solve(SolidParameters(outline="round", compliant_poisson=0.455, **closed), 1).force_ratio
    assert ours == pytest.approx(its, abs=0.005)


@pytest.mark.slow
def test_a_foil_of_rubber_on_a_rigid_tooth_loses_no_digits() -> None:
    """Its stiffness is so great that the rounding of it, as a force on the tooth, was a tenth of the whole load."""
    radii = {"tooth_radius": 4.4e-4, "ring_inner_radius": 1.36e-3, "ring_outer_radius": 10.5e-3}
    foil = {"sensed_poisson": 0.5, "sensed_thickness": 1e-5, "sensor_height": 2.6e-3, "support": "rigid"}
    asked = SolidParameters(outline="round", cell_length=30e-3, cell_width=30e-3, **radii, **foil)
    its = axisymmetric.solve(disc(asked), 2).force_ratio
    ours = ratio(asked, Resolution(layers=1, ratio=0.2, sectors=1, degree=3))
    assert ours == pytest.approx(its, rel=0.1)
