"""Hard cases of the solid model, the naive formulation beside the shipped one."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid.ladders import OF_MANY_TEETH, Resolution
from palpate.instrument.models.solid.mesh import Elastic, Names, SolidBody
from palpate.instrument.models.solid.model import solve, solve_on
from palpate.instrument.models.solid.system import System
from tests.settings import disc

Vector = NDArray[np.float64]

SMALLEST = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
RIGID = SolidParameters(interface="frictionless", support="rigid")
SHIPPED = SolidBody.stiffness
ROUND = replace(RIGID, outline="round", sensed_modulus=1e6, sensed_thickness=1e-3)


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
    solution = solve_on(replace(SolidParameters(), **{soft: 1.49e4, hard: 140e9}), SMALLEST)
    assert sum(solution.base_forces) == pytest.approx(1.0, abs=1e-9)
    assert 0 < solution.force_ratio < 1


@pytest.mark.slow
def test_a_closed_gap_leaves_no_hole_between_object_and_ring() -> None:
    """Reference: the round model, whose ring touches the tooth. With the ring's edge let go, off by 0.015 to 0.03."""
    closed = {"ring_inner_radius": 1.4e-3, "sensed_modulus": 2e5, "sensed_thickness": 3.5e-4, "sensed_poisson": 0.4999}
    its = axisymmetric.solve(replace(RoundParameters(compliant_poisson=0.455), **closed), 2).force_ratio
    ours = solve(SolidParameters(outline="round", compliant_poisson=0.455, **closed), 1).force_ratio
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
