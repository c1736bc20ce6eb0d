from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
import scipy

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.mesh import grid
from palpate.instrument.models.parameters import IDENTIFIED_ROUND, RoundParameters, round_parameters
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.material import FilmMaterial
from palpate.instrument.thesis import read_table
from tests.instrument.direct_round import solve, solve_on
from tests.shares import first_of

CASE_A = RoundParameters()
IDENTIFIED = round_parameters(IDENTIFIED_ROUND.design(get_design("single")), IDENTIFIED_ROUND.load(1e5))
# Degree 8 with 7 layers, in displacement-pressure and in plain displacement form: they differ by 1e-9.
CASE_A_RATIO = 0.4245274
# The same under a soft and under a hard object: under one alone the error may pass through zero.
RATIOS = {14.9e3: 0.1835738, CASE_A.sensed_modulus: CASE_A_RATIO, 1e6: 0.8246514}


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


def test_the_identified_set_gives_table_a2_1_within_0_008() -> None:
    """Every sixth row is checked here; `test_reproduce` checks all."""
    table = read_table("A2.1")
    rows = list(zip(table.keys(), table.values("force_rigid_N"), strict=True))
    assert len(rows) == 48
    for modulus, tooth_force in rows[::6]:
        ratio = solve(replace(IDENTIFIED, sensed_modulus=modulus), 1).force_ratio
        assert ratio == pytest.approx(-tooth_force, abs=0.008), f"{modulus:g} Pa"


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
