"""Films of any design give the forces and ratios that the thesis would have taken from them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.findings.film_forces import film_forces
from palpate.instrument.sensor.design import Design
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import SineFit, fit_sine

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


def test_a_dead_base_film_is_named() -> None:
    design = get_design("different_base")
    with pytest.raises(EstimateError, match=r"film 'total_2' on channel 4 gives .* too little for a ratio"):
        film_forces(design, fitted(design, [0.3, 2.0, 0.3, 0.0], noise=1e-4))
