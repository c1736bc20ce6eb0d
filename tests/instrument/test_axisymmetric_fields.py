"""The pressure on the sensor's face: what it adds up to, where it must be uniform, and where it may not."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models.axisymmetric.curves import FacePressure, RoundSection, on, section
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.axisymmetric.model import resolution_of
from palpate.instrument.models.parameters import RoundParameters
from palpate.instrument.sensor.material import FilmMaterial
from tests.instrument.direct_round import DirectSolution, solve

CASE_A = RoundParameters()


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
