"""Films of any design give the forces and ratios that the thesis would have taken from them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import SineFit, amplitude_ratio, fit_sine

RATE, FREQUENCY = 250.0, 10.0


def fitted(design: Design, force: list[float], noise: float = 1e-12, seed: int = 0) -> SineFit:
    """A fit of films that feel a force [N, peak to peak]."""
    time = np.arange(250) / RATE
    volts = np.array([film.sensitivity for film in design.films]) * np.array(force)
    random = np.random.default_rng(seed).standard_normal((len(force), len(time)))
    return fit_sine(time, volts[:, None] / 2 * np.cos(2 * np.pi * FREQUENCY * time) + noise * random, FREQUENCY)


@pytest.mark.parametrize(
    ("design", "force", "ratio", "teeth"),
    [
        ("single", [0.471, 1.501], 0.3138, [0.3138]),  # Table A2.9
        ("common_base", [0.236, 0.191, 1.493], 0.2860, [0.1581, 0.1279]),  # Table A2.15
        ("different_base", [0.513, 1.475, 0.518, 1.489], 0.3478, [0.3478, 0.3479]),  # Table 5.7
    ],
)
def test_forces_give_the_ratio_of_the_thesis_own_row(
    design: str, force: list[float], ratio: float, teeth: list[float]
) -> None:
    found = film_forces(get_design(design), fitted(get_design(design), force))
    assert found.force_ratio == pytest.approx(ratio, abs=6e-5)
    assert [tooth.force_ratio for tooth in found.teeth] == pytest.approx(teeth, abs=6e-5)
    assert [tooth.tooth for tooth in found.teeth] == list(range(1, len(teeth) + 1))
    assert found.force_rigid_N + found.force_total_N == pytest.approx(math.fsum(force), rel=1e-6)


def test_the_teeth_of_an_array_add_up() -> None:
    design = get_design("array_16")
    found = film_forces(design, fitted(design, [0.01 * (k + 1) for k in range(16)] + [4.0]))
    assert [tooth.force_N for tooth in found.teeth] == pytest.approx([0.01 * (k + 1) for k in range(16)])
    assert found.force_ratio == pytest.approx(1.36 / 4)
    assert found.force_ratio == pytest.approx(math.fsum(tooth.force_ratio for tooth in found.teeth))


def test_of_one_tooth_the_noise_is_that_of_the_ratio_of_two_amplitudes() -> None:
    design = get_design("single")
    fit = fitted(design, [0.6, 2.0], noise=1e-2)
    ratio, u = amplitude_ratio(fit, 0, 1)
    gain = design.film("total").sensitivity / design.film("rigid").sensitivity
    found = film_forces(design, fit)
    assert (found.force_ratio, found.noise_u) == pytest.approx((ratio * gain, u * gain))
    scatter = design.ratio_scatter * found.force_ratio
    assert found.force_ratio_u == pytest.approx(math.hypot(found.noise_u, scatter), rel=1e-4)  # the quotient's bias
    assert found.teeth[0].force_ratio_u == pytest.approx(found.force_ratio_u)


@pytest.mark.parametrize("name", ["common_base", "different_base"])
def test_the_stated_noise_is_the_scatter_of_repeats(name: str) -> None:
    design = get_design(name)
    force = [0.3 if film.kind == "rigid" else 2.0 for film in design.films]
    repeats = [film_forces(design, fitted(design, force, noise=1e-4, seed=seed)) for seed in range(200)]
    assert np.std([r.force_ratio for r in repeats]) == pytest.approx(np.mean([r.noise_u for r in repeats]), rel=0.15)
    first = [r.teeth[0] for r in repeats]
    assert np.std([t.force_ratio for t in first]) == pytest.approx(np.mean([t.noise_u for t in first]), rel=0.15)


def test_of_one_tooth_a_force_is_as_uncertain_as_its_film_and_its_noise() -> None:
    design = get_design("single")
    found = film_forces(design, fit := fitted(design, [0.6, 2.0], noise=1e-2))
    noise = 2 * fit.amplitude_u / [film.sensitivity for film in design.films]
    scatter = [0.033 * found.force_rigid_N, 0.03 * found.force_total_N]
    said = (found.force_rigid_u, found.force_total_u)
    assert said == pytest.approx(np.hypot(noise, scatter))
    assert (found.teeth[0].force_u, found.teeth[0].base_force_u) == pytest.approx(said)
    assert noise[0] > 0.1 * scatter[0]


def test_films_that_scatter_together_make_sums_more_uncertain() -> None:
    design = replace(get_design("common_base"), scatter_correlation={("rigid_2", "rigid_1"): 0.5})
    found = film_forces(design, fitted(design, [0.3, 0.4, 2.0]))
    a, b = 0.125 * 0.3, 0.095 * 0.4
    assert found.force_rigid_u == pytest.approx(math.sqrt(a**2 + b**2 + 2 * 0.5 * a * b), rel=1e-6)
    assert [tooth.force_u for tooth in found.teeth] == pytest.approx([a, b], rel=1e-6)


def test_calibrated_films_add_the_uncertainty_of_their_calibration() -> None:
    design = get_design("single")
    calibrated = replace(design, film_covariance=((4e-4, 1e-4), (1e-4, 1e-4)))
    plain, found = (film_forces(each, fitted(each, [0.6, 2.0])) for each in (design, calibrated))
    assert found.force_rigid_u == pytest.approx(math.hypot(plain.force_rigid_u, 0.02 * 0.6))
    assert found.force_total_u == pytest.approx(math.hypot(plain.force_total_u, 0.01 * 2.0))


def test_a_dead_base_film_is_named() -> None:
    design = get_design("different_base")
    with pytest.raises(EstimateError, match=r"film 'total_2' on channel 4 gives .* too little for a ratio"):
        film_forces(design, fitted(design, [0.3, 2.0, 0.3, 0.0], noise=1e-4))


def test_a_pickup_that_the_bench_states_is_in_forces_and_ratio() -> None:
    """The pick-up is 2 % of the load in each film, with unknown phase: JCGM 101, 6.4.6."""
    plain, found = (
        film_forces(get_design("single").with_pickup(share), fitted(get_design("single"), [0.6, 2.0]))
        for share in (0.0, 0.02)
    )
    assert found.force_ratio == plain.force_ratio
    assert plain.pickup_u == 0
    assert found.pickup_u == pytest.approx(0.02 / math.sqrt(2) * math.hypot(1.0, 0.3), rel=1e-6)
    for name in ("force_ratio_u", "force_total_u"):
        added = found.pickup_u if name == "force_ratio_u" else 0.02 / math.sqrt(2) * 2.0
        assert getattr(found, name) == pytest.approx(math.hypot(getattr(plain, name), added), rel=1e-6)
