"""The solid model against exact solutions, against the round model, and against Tables A2.3 and A2.7."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.parameters import IDENTIFIED_SOLID, RoundParameters, SolidParameters, solid_parameters
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
from palpate.instrument.models.solid.model import point_loads, solve, solve_to
from palpate.instrument.models.solid.system import System
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.thesis import read_table
from tests import meshes
from tests.settings import disc
from tests.shares import first_of

COARSE = SolidParameters(interface="frictionless", support="rigid")
PAIR = replace(COARSE, cell_length=12e-3, cell_width=12e-3, columns=2)


@functools.cache
def coarse_ratio(compliant_poisson: float) -> float:
    return solve(replace(COARSE, compliant_poisson=compliant_poisson), 0).force_ratio


@pytest.fixture
def one_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    """The smallest mesh, for what holds exactly on any."""
    smallest = Resolution(layers=1, ratio=0.2, sectors=1, degree=2)
    meshes.give(monkeypatch, *[smallest] * 3)


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
