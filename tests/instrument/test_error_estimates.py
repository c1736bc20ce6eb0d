"""A share of `python -m tests.benchmarks estimates`, and what its figures are made of."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import pytest

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.finite_elements.error_estimate import Bounds, Energies, Judged, bounds
from palpate.instrument.models.parameter_sets import PHYSICAL
from palpate.instrument.models.parameters import RoundParameters, SolidParameters, solid_parameters
from palpate.instrument.models.solid import model as solid
from palpate.instrument.sensor.designs import DESIGNS
from tests.benchmarks import estimates

MESHES = [Judged(0.4, (0.2, 0.1), Energies(1e-3, 200.0)), Judged(0.4, (0.21, 0.1), Energies(1.01e-3, 201.0))]


def test_the_greatest_change_of_a_voltage_counts_for_every_film() -> None:
    assert bounds(MESHES, slowly=False).voltage == pytest.approx(4 * 0.01)


def test_where_all_voltages_of_two_meshes_agree_the_estimate_is_not_nothing() -> None:
    """The error of one of 62 sensors was nine times the greatest change: 3.5e-4 of the voltage."""
    agreeing = [replace(mesh, voltages=(0.2, 0.1)) for mesh in MESHES]
    assert bounds(agreeing, slowly=False).voltage == pytest.approx(0.2 * math.sqrt(1e-5 / 1.01e-3))


# Number of a random sensor -> voltages on two meshes [V], the load's energies there [J], voltages of a finer model [V].
VOLTAGES = {
    675: ((0.0063683657, 0.0068590449), (0.0063730675, 0.0068669242), (5.9047452e-06, 5.8995967e-06),
          (0.0064054211, 0.0068731478)),
    810: ((0.2525054605, 0.1713786182), (0.2523460018, 0.1714599884), (8.4407073e-06, 8.4498746e-06),
          (0.2532195205, 0.1715178664)),
    840: ((0.2301099048, 0.0699676168), (0.2298950349, 0.0698597719), (2.1758281e-05, 2.1871939e-05),
          (0.2335380007, 0.0695731263)),
    910: ((3.9436707793, 1.0690713968), (3.9440791301, 1.0705482697), (2.473700563e-04, 2.482583064e-04),
          (3.9758045218, 1.0718828525)),
    1041: ((6.7734207833, 0.5217735148), (6.7576206660, 0.5217373453), (5.3714378255e-05, 5.5725421747e-05),
           (6.1599014538, 0.5149489286)),
}  # fmt: skip


@pytest.mark.parametrize("number", VOLTAGES)
def test_voltages_that_hardly_moved_while_the_solution_did_are_not_trusted(number: int) -> None:
    """What the meshes of five random sensors gave whose voltages were off by up to 2.2 times an earlier estimate."""
    coarse, fine, energies, finer = VOLTAGES[number]
    judged = [Judged(0.4, volts, Energies(energy, 1.0)) for volts, energy in zip((coarse, fine), energies, strict=True)]
    error = max(abs(own - true) for own, true in zip(fine, finer, strict=True))
    assert 0 < error < 0.6 * bounds(judged, slowly=False).voltage


Lengths = tuple[float, float, float, float]
WIDE = {SolidParameters: {"cell_length": 20e-3, "cell_width": 20e-3}}
# A random sensor of narrow gap or thin object: model, radii of tooth and ring and thickness of the object [m]; force
# ratio and energies on each mesh, from the coarsest on; the force ratio of a finer mesh or model.
NARROW: dict[str, tuple[Any, Lengths, tuple[tuple[float, float, float], ...], float]] = {
    "solid 380": (SolidParameters, (2.8902827e-3, 2.8987890e-3, 7.7354238e-3, 1.567e-5),
                  ((0.1786099186, 2.6786491882e-04, 153.2379117), (0.1775018091, 2.6854088020e-04, 148.9216759)),
                  0.1720071382),
    "solid 340": (SolidParameters, (2.2767865e-3, 2.2933516e-3, 3.4499560e-3, 7.773e-4),
                  ((0.7755529545, 4.4828965235e-05, 2254.6204424), (0.7760984529, 4.4778336813e-05, 2257.3789375),
                   (0.7761806923, 4.4780014857e-05, 2258.1504737)), 0.7765451167),
    "solid 1122": (SolidParameters, (6.0503901e-4, 6.5762481e-4, 9.1294427e-3, 1.088e-5),
                   ((0.0095322688, 7.9705668323e-04, 5.8451348), (0.0088168501, 7.9762760297e-04, 4.9458354)),
                   0.0070913145),
}  # fmt: skip


@pytest.mark.parametrize("name", NARROW)
def test_meshes_that_do_not_see_a_narrow_gap_are_not_trusted(name: str) -> None:
    """Random sensors had errors of up to 1.2 times an earlier estimate: meshes hardly differed, and all were wrong."""
    model, (tooth, inner, outer, thickness), known, finer = NARROW[name]
    judged = [Judged(ratio, (), Energies(load, jump)) for ratio, load, jump in known]
    radii = {"tooth_radius": tooth, "ring_inner_radius": inner, "ring_outer_radius": outer}
    sensor = model(sensed_thickness=thickness, **radii, **WIDE[model])
    estimate = solid.error_estimate(judged, sensor)
    assert 0 < abs(known[-1][0] - finer) < 0.6 * estimate.force_ratio


def test_meshes_do_not_see_what_a_cap_leaves_to_a_narrow_gap() -> None:
    """The error of random sensor 1911 was 1.65 times an earlier estimate."""
    known = ((0.9986092516, 1.40e-3), (0.9974723342, 0.0))  # force ratio, and product of the changes of energies
    judged = [Judged(ratio, (), Energies(1.0 - product, 1.0 - product)) for ratio, product in known]
    sensor = SolidParameters(interface="capped", ring_inner_radius=1.0224 * SolidParameters().tooth_radius)
    assert 0.6 * solid.error_estimate(judged, sensor).force_ratio > 0.9974723342 - 0.9766221760


def test_meshes_of_the_same_sectors_do_not_tell_what_these_leave() -> None:
    """Three meshes share their sectors, which left 3.6e-4 of random sensor 340."""
    agreeing = [Judged(0.4, (), Energies(1e-3, 200.0))] * 3
    assert solid.error_estimate(agreeing, SolidParameters()).force_ratio > 2 * 3.6e-4


def test_gap_and_object_of_the_designs_are_not_narrow() -> None:
    """Otherwise their estimates would be three times as wide without need, as their errors are known."""
    loads = PHYSICAL.load(100e3)
    assert not any(solid.is_narrow(solid_parameters(design, loads)) for design in DESIGNS.values())


def test_under_a_point_load_changes_alone_count() -> None:
    pointed = [Judged(ratio, (), Energies(None, jump)) for ratio, jump in ((0.4, 200.0), (0.41, 300.0))]
    assert bounds(pointed, slowly=False).force_ratio == pytest.approx(1.5 * 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 7])
def test_no_estimate_of_some_random_sensors_is_below_the_error(number: int) -> None:
    result = estimates.tried(number)
    assert not result.refused
    assert len(result.claims) == len(axisymmetric.REFINEMENTS) - 2
    assert all(0 < claim["ratio"] <= 1 for claim in result.claims)


def test_an_estimate_below_the_error_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = RoundParameters(support="rigid")
    curves = [axisymmetric.curve(sensor, refinement) for refinement in (1, 2, 3)]
    monkeypatch.setattr(estimates.axisymmetric, "error_estimate", lambda *_: Bounds(1e-9, math.inf))
    (claim,) = estimates.claims(2, sensor, curves)
    assert claim.ratio > 100
    result = estimates.Tried(2, [asdict(claim)])
    (missed,) = [row for row in estimates.rows([result], goal=1) if "of the ratio above" in row.figure]
    assert missed.met is False and "sensor 2" in missed.measured
