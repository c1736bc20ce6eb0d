"""The pressure on the sensor's face: what it adds up to, where it must be uniform, and where it may not."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models.axisymmetric.curves import FacePressure, RoundSection, face_pressure, on, section
from palpate.instrument.models.axisymmetric.mesh import Grid, grid
from palpate.instrument.models.axisymmetric.model import resolution_of
from palpate.instrument.models.parameters import RoundParameters
from palpate.instrument.sensor.material import FilmMaterial
from tests.instrument.direct_round import DirectSolution, solve

CASE_A = RoundParameters()
WIDE = replace(
    CASE_A, ring_outer_radius=45e-3, plate_radius=45e-3, sensed_radius=45e-3, support="rigid", sensed_poisson=0.0,
    compliant_poisson=0.0,
)  # fmt: skip


@functools.cache
def drawn(parameters: RoundParameters, refinement: int = 1) -> RoundSection:
    return section(parameters, *resolution_of(refinement))


@functools.cache
def solved(parameters: RoundParameters, refinement: int = 1) -> DirectSolution:
    return solve(parameters, refinement)


def force(face: FacePressure, reach: float = np.inf) -> float:
    """Integral of the pressure within a radius [N]."""
    return float((face.pressure * face.area)[face.radius < reach].sum())


@pytest.mark.parametrize(
    "parameters",
    [
        CASE_A,
        replace(CASE_A, interface="frictionless", sensed_poisson=0.5),
        replace(CASE_A, support="rigid", sensed_modulus=140e9),
        replace(CASE_A, sensed_radius=3e-3),
    ],
    ids=["case A", "sliding, incompressible", "hard, on rigid ground", "smaller than the ring"],
)
def test_the_pressure_adds_up_to_the_forces_on_tooth_and_face(parameters: RoundParameters) -> None:
    face = drawn(parameters).face
    assert force(face, parameters.tooth_radius) == pytest.approx(solved(parameters).tooth_force_above, rel=1e-7)
    assert force(face) == pytest.approx(1, rel=1e-7)
    assert face.radius.max() < min(parameters.sensed_radius, parameters.ring_outer_radius)
    assert not np.any((face.radius > parameters.tooth_radius) & (face.radius < parameters.ring_inner_radius))


def test_over_a_closed_gap_both_integrals_meet_as_the_mesh_refines() -> None:
    closed = replace(CASE_A, ring_inner_radius=CASE_A.tooth_radius)
    differences = [
        abs(force(drawn(closed, k).face, closed.tooth_radius) / solved(closed, k).tooth_force_above - 1) for k in (1, 2)
    ]
    assert differences[1] < differences[0] / 2 < 1e-3


def test_the_forces_of_a_uniform_pressure_give_it_back() -> None:
    radii = np.array([0.0, 1e-3, 1.3e-3, 1.4e-3, 1.5e-3, 5e-3])
    dofs = np.array([[0, 1, 6], [1, 2, 7], [2, 3, 8], [3, 4, 9], [4, 5, 10]])
    touching = np.array([0, 1, 2, 4])
    # ∫ φ 2 π r dr of the two linear shape functions, and of scikit-fem's √6 x (x - 1) for the bubble.
    forces = np.zeros(11)
    for interval in touching:
        inner, width = radii[interval], radii[interval + 1] - radii[interval]
        of_one, of_x = np.array([1 / 2, 1 / 2, -1 / math.sqrt(6)]), np.array([1 / 6, 1 / 3, -1 / (2 * math.sqrt(6))])
        forces[dofs[interval]] += 2 * math.pi * width * (inner * of_one + width * of_x)
    face = face_pressure(Grid((), radii, radii, 0.0, 0.0), dofs, touching, 5e3 * forces)
    assert face.pressure == pytest.approx(5e3, rel=1e-12)
    assert force(face, 1.4e-3) == pytest.approx(5e3 * math.pi * 1.4e-3**2, rel=1e-12)


def test_one_material_without_gap_presses_evenly() -> None:
    one = RoundParameters(
        **{f"{part}_modulus": 1e6 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        **{f"{part}_poisson": 0.0 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        film=FilmMaterial.isotropic(1e6, 0.0),
        ring_inner_radius=1.4e-3,
    )
    face = drawn(one).face
    uneven = np.abs(face.pressure * math.pi * 5e-3**2 - 1)
    # One node of the ring at the slit is free, over some 40 nm; a tenth of a millimetre off it is forgotten.
    assert uneven[np.abs(face.radius - 1.4e-3) > 1e-4].max() < 1e-6
    assert np.average(uneven, weights=face.area) < 1e-5


def test_far_from_the_tooth_the_pressure_is_the_mean() -> None:
    face = drawn(WIDE, 3).face
    mean = 1 / (math.pi * 45e-3**2)
    far = (face.radius > 15e-3) & (face.radius < 44e-3)
    assert face.pressure[far] == pytest.approx(mean, rel=2e-3)
    assert face.pressure[face.radius < 1e-3].min() > 3 * mean


def test_the_pressure_away_from_the_edges_settles_while_that_at_the_edge_grows() -> None:
    coarse, fine = (drawn(CASE_A, refinement).face for refinement in (2, 3))
    places = np.array([0.7e-3, 1.2e-3, 2.5e-3, 4e-3])
    settled = np.interp(places, fine.radius, fine.pressure)
    assert np.interp(places, coarse.radius, coarse.pressure) == pytest.approx(settled, rel=0.02)
    assert fine.pressure.max() > 1.5 * coarse.pressure.max()


@pytest.mark.parametrize(
    ("parameters", "within"),
    [
        (CASE_A, 1e-8),
        (replace(CASE_A, interface="capped"), 1e-8),
        (replace(CASE_A, support="rigid", interface="frictionless"), 1e-8),
        (replace(CASE_A, sensed_poisson=0.5, compliant_poisson=0.5), 1e-5),
    ],
    ids=["bonded", "capped", "rigid, frictionless", "incompressible"],
)
def test_the_drawn_displacements_are_those_of_a_solution_for_this_modulus(
    parameters: RoundParameters, within: float
) -> None:
    known, found, mesh = solved(parameters).on_mesh, drawn(parameters).fields, grid(parameters, resolution_of(1)[1])
    assert set(found) == set(known.parts)
    for name, part in known.parts.items():
        local = on(known.displacements, part)  # its first two shape functions in each direction belong to the corners
        field = found[name]
        assert field.radius[-1, 0] == mesh.radii[part.columns[-1] + 1]
        size = max(float(np.abs(local).max()), 1e-12)
        assert field.radial[-1, 0] == pytest.approx(local[-1, 0, 0, 1, 0], abs=within * size)
        assert field.axial[-1, -1] == pytest.approx(local[-1, -1, 1, 1, 1], abs=within * size)
        assert field.axial[0, 0] == pytest.approx(local[0, 0, 1, 0, 0], abs=within * size)


def test_the_object_moves_down_and_the_floor_stays() -> None:
    fields = drawn(CASE_A).fields
    assert not fields["lower plate"].axial[:, 0].any()
    assert fields["ring"].axial[-1, -1] == pytest.approx(fields["object"].axial[-1, 0], rel=1e-12)
    assert fields["object"].axial.max() < 0
