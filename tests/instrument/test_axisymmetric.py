from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from palpate.instrument.errors import RangeError, UnknownName
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.axisymmetric.model import solve_to
from palpate.instrument.models.finite_elements import elements
from palpate.instrument.models.parameters import IDENTIFIED_ROUND, RoundParameters, round_parameters
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import FilmMaterial
from palpate.instrument.thesis import read_table
from tests.instrument.direct_round import DirectSolution, solve, solve_on
from tests.settings import round_sensors
from tests.shares import first_of

CASE_A = RoundParameters()
IDENTIFIED = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))
# Degree 8 with 7 layers, in displacement-pressure and in plain displacement form: they differ by 1e-9.
CASE_A_RATIO = 0.4245274
# The same under a soft and under a hard object: under one alone the error may pass through zero.
RATIOS = {14.9e3: 0.1835738, CASE_A.sensed_modulus: CASE_A_RATIO, 1e6: 0.8246514}


@functools.cache
def case_a(refinement: int) -> DirectSolution:
    return solve(CASE_A, refinement)


@pytest.mark.slow
def test_the_error_falls_at_least_five_times_a_refinement() -> None:
    errors = [
        max(abs(solve(replace(CASE_A, sensed_modulus=m), refinement).force_ratio - RATIOS[m]) for m in RATIOS)
        for refinement in (1, 2, 3)
    ]
    assert errors[0] < 2e-4
    assert all(finer < coarser / 5 for coarser, finer in itertools.pairwise(errors))


@pytest.mark.slow
def test_a_soft_object_of_poisson_ratio_0_3_errs_less_with_its_pressure_as_an_unknown() -> None:
    for degree, layers, gain in ((4, 2, 2.5), (5, 3, 3.0)):
        with_it, without = (
            max(
                abs(solve_on(replace(CASE_A, sensed_modulus=m), degree, layers, mixed).force_ratio - RATIOS[m])
                for m in RATIOS
            )
            for mixed in (True, False)
        )
        assert with_it < without / gain


def test_where_the_ratios_of_two_meshes_cross_the_estimate_is_above_the_error() -> None:
    """There the change of the ratio is no hint of the error that is left."""
    coarse, fine, finest = (axisymmetric.curve(CASE_A, refinement) for refinement in (1, 2, 3))

    def change(logarithm: float) -> float:
        modulus = np.exp([logarithm])
        return float((fine.force_ratios(modulus) - coarse.force_ratios(modulus))[0, 0])

    modulus = np.exp([scipy.optimize.brentq(change, np.log(24e3), np.log(24e4))])
    error = abs(fine.force_ratios(modulus) - finest.force_ratios(modulus))[0, 0]
    (estimate,), _ = axisymmetric.estimates([coarse, fine], CASE_A, modulus)
    assert abs(change(np.log(modulus[0]))) < error / 100
    assert error < estimate < 100 * error


@pytest.mark.slow
@pytest.mark.parametrize("sensor", [round_sensors(8, seed=20)[k] for k in (0, 7)], ids=["narrow", "wide"])
def test_the_bound_is_above_the_error_of_a_random_setting_and_not_far_above(sensor: RoundParameters) -> None:
    """Both settings are solved quickly: one has a narrow gap, and the error of the other is near its bound."""
    solution, bound = solve_to(sensor, 1e-2)
    error = abs(solution.force_ratio - solve(sensor, 3).force_ratio)
    assert 0.001 * bound < error < bound <= 1e-2


def test_the_identified_set_gives_table_a2_1_within_0_008() -> None:
    """Every sixth row is checked here; `test_reproduce` checks all."""
    table = read_table("A2.1")
    rows = list(zip(table.keys(), table.values("force_rigid_N"), strict=True))
    assert len(rows) == 48
    for modulus, tooth_force in rows[::6]:
        ratio = solve(replace(IDENTIFIED, sensed_modulus=modulus), 1).force_ratio
        assert ratio == pytest.approx(-tooth_force, abs=0.008), f"{modulus:g} Pa"


def test_case_a_reads_higher_than_the_first_row_of_table_a2_1() -> None:
    assert solve(replace(CASE_A, sensed_modulus=14.9e3), 1).force_ratio > 0.1417 + 0.03


def test_one_material_without_gap_carries_the_tooth_s_share_of_the_area() -> None:
    one = RoundParameters(
        **{f"{part}_modulus": 1e6 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        **{f"{part}_poisson": 0.0 for part in ("sensed", "compliant", "tooth", "plate")},  # type: ignore[arg-type]
        film=FilmMaterial.isotropic(1e6, 0.0),
        ring_inner_radius=1.4e-3,
    )
    solution = solve(one, 1)
    # The object's node over the slit belongs to the tooth alone, which costs 1e-7 on this mesh.
    assert solution.force_ratio == pytest.approx((1.4 / 5) ** 2, rel=2e-7)
    assert solution.films["base"].normal_stress == pytest.approx(-1 / (math.pi * 5e-3**2), rel=1e-11)
    for film in solution.films.values():
        assert film.normal_stress == pytest.approx(-1 / (math.pi * 5e-3**2), rel=2e-7)
        assert abs(film.plane_stress) < 1e-6 * abs(film.normal_stress)


def uniform_strain(points_r: NDArray[np.float64], points_z: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """Element unknowns of u = -0.3 r, w = z + 10 µm on one rectangle."""
    nodes = np.zeros((1, 2, degree + 1, degree + 1))
    nodes[0, 0, :2, :2] = -0.3 * points_r[:, None]
    nodes[0, 1, :2, :2] = points_z[None, :] + 1e-5
    return elements.differences(nodes.reshape(1, -1), np.zeros((1, nodes.size)))[0]


def test_both_forms_agree_on_a_uniform_strain_of_an_element_four_hundred_times_as_wide_as_high() -> None:
    degree, shear, lame = 4, 1e4, 3e5
    points_r, points_z = np.array([1e-3, 11e-3]), np.array([0, 25e-6])
    r, z = elements.line(points_r, degree, radial=True), elements.line(points_z, degree, radial=False)
    only = np.array([0])
    strain = uniform_strain(points_r, points_z, degree)
    stiffness = elements.Stiffness(r, z)
    plain = stiffness(only, only, elements.Constants.isotropic(shear, lame))[0] @ strain
    spread = elements.dilatation(r, z, only, only)[0]
    mixed = stiffness(only, only, elements.Constants.isotropic(shear, 0.0))[0] @ strain + lame * spread.T @ (
        spread @ strain
    )
    assert mixed == pytest.approx(plain, abs=1e-9 * np.abs(plain).max())
    volume = (11e-3**2 - 1e-3**2) / 2 * 25e-6
    energy = volume * (2 * shear * (2 * 0.3**2 + 1) + lame * 0.4**2)
    assert float(strain @ plain) == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize("nu", first_of([0.5, 0.49, 0.499, 0.4999, 0.499999]))
def test_rubber_up_to_poisson_ratio_one_half_keeps_its_accuracy(nu: float) -> None:
    rubber = replace(CASE_A, sensed_poisson=nu, compliant_poisson=nu)
    coarse, fine = solve(rubber, 1), solve(rubber, 2)
    assert abs(fine.force_ratio - coarse.force_ratio) < 1.5e-3
    assert fine.imbalance < 1e-10


def test_the_ratio_is_continuous_up_to_poisson_ratio_one_half() -> None:
    near, limit = (solve(replace(CASE_A, compliant_poisson=nu), 2).force_ratio for nu in (0.499999, 0.5))
    assert 0 < abs(near - limit) < 1e-5


@pytest.mark.slow
def test_the_ratio_is_continuous_as_the_gap_closes() -> None:
    ratios = [solve(replace(CASE_A, ring_inner_radius=1.4e-3 + gap), 2).force_ratio for gap in (1e-4, 1e-6, 1e-9, 0)]
    assert ratios[0] < ratios[1] < ratios[2]
    assert ratios[3] == pytest.approx(ratios[2], abs=3e-5)


@pytest.mark.parametrize("thickness", [10e-6, 100e-3])
def test_an_object_of_ten_micrometres_or_a_hundred_millimetres_is_resolved(thickness: float) -> None:
    thick = replace(CASE_A, sensed_thickness=thickness)
    assert solve(thick, 2).force_ratio == pytest.approx(solve(thick, 1).force_ratio, abs=1e-3)


def test_an_object_of_a_metre_takes_few_more_elements_than_one_of_millimetres() -> None:
    """Equal steps were two hundred for each metre, and 10 m took 3 GB."""
    low, high = (len(grid(replace(CASE_A, sensed_thickness=thickness), 3).heights) for thickness in (3e-3, 1.0))
    assert low < high < 2 * low


def test_a_thin_soft_object_passes_its_load_straight_down() -> None:
    thin = replace(CASE_A, sensed_thickness=10e-6)
    assert solve(thin, 1).force_ratio == pytest.approx((1.45 / 5) ** 2, abs=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ring", [1.4e-5, 43e-3])
def test_area_ratios_from_a_hundredth_to_a_thousand_are_resolved(ring: float) -> None:
    outer = 1.5e-3 + ring
    wide = replace(CASE_A, ring_outer_radius=outer, plate_radius=max(outer, 2e-3), sensed_radius=outer)
    coarse, fine = solve(wide, 1), solve(wide, 2)
    assert 0 < fine.force_ratio < 1
    assert fine.force_ratio == pytest.approx(coarse.force_ratio, abs=1e-3)
    assert fine.imbalance < 1e-9


@pytest.mark.slow
def test_refinement_stops_before_rounding_passes_the_discretisation_error() -> None:
    for refinement in axisymmetric.REFINEMENTS[:4]:
        solution = case_a(refinement)
        assert solution.imbalance < 1e-10 < abs(solution.force_ratio - CASE_A_RATIO)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"sensed_modulus": 0.0}, "sensed_modulus 0 Pa is not above 0"),
        ({"sensed_thickness": math.nan}, "sensed_thickness nan m"),
        ({"compliant_modulus": math.inf}, "compliant_modulus inf Pa"),
        ({"sensed_thickness": 10.0}, "sensed_thickness 10 m is outside 5e-08 to 1.5 m"),
        ({"sensor_height": 1e-9}, "sensor_height 1e-09 m is outside 5e-08 to 1.5 m"),
        ({"plate_modulus": 1e300}, r"plate_modulus 1e\+300 Pa is outside 0.001 to 1e\+20 Pa"),
        ({"sensed_poisson": 0.51}, r"sensed_poisson 0.51 is outside \(-1, 0.5\]"),
        ({"compliant_poisson": -1.0}, "compliant_poisson -1 is outside"),
        ({"tooth_radius": 1.6e-3}, "parts overlap: tooth_radius 0.0016 m"),
        ({"ring_outer_radius": 1.5e-3}, "parts overlap: ring_inner_radius"),
        ({"sensed_radius": 1.5e-3}, "does not reach the ring"),
    ],
)
def test_a_value_outside_its_limits_is_refused(wrong: dict[str, float], message: str) -> None:
    with pytest.raises(RangeError, match=message):
        replace(CASE_A, **wrong)  # type: ignore[arg-type]


def test_an_unknown_interface_is_refused() -> None:
    with pytest.raises(UnknownName, match="bonded"):
        replace(CASE_A, interface="glued")


def test_a_tolerance_that_no_mesh_meets_is_refused_with_the_best_there_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(axisymmetric, "REFINEMENTS", (1, 2))
    with pytest.raises(RangeError, match="its least error here is"):
        solve_to(IDENTIFIED, 1e-10)
    with pytest.raises(RangeError, match="tolerance nan"):
        solve_to(IDENTIFIED, math.nan)
    with pytest.raises(RangeError, match="refinement 9"):
        solve(IDENTIFIED, 9)
