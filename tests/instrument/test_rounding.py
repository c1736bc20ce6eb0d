"""Means of rounded readings are as uncertain as simulation shows, with noise and without."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from palpate.instrument.uncertainty import rounding
from palpate.instrument.uncertainty.rounding import mean_u


@pytest.mark.parametrize("noise", [0.25, 0.3, 0.6, 3.0])
@pytest.mark.parametrize("count", [1, 20])
def test_the_uncertainty_of_a_mean_is_its_spread_about_the_truth(noise: float, count: int) -> None:
    rng = np.random.default_rng(9)
    true = rng.uniform(-10, 10, size=4000)
    step = 0.5
    displays = step * np.rint((true + step * noise * rng.normal(size=(20, 4000))) / step)
    scatter = math.sqrt(displays.var(axis=0, ddof=1).mean())
    spread = math.sqrt(np.mean((displays[:count].mean(axis=0) - true) ** 2))
    assert mean_u(scatter, step, count) == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize("scatter", [0.34, 0.35, 0.46, 1.0, 1e6])
def test_the_noise_behind_a_scatter_is_the_root_that_bracketing_finds(scatter: float) -> None:
    found = brentq(lambda noise: rounding._excess(noise, scatter), 0.0, scatter + 1.0, rtol=1e-15)
    assert rounding._noise(scatter) == pytest.approx(found, rel=1e-11)


def test_without_scatter_the_step_alone_is_left() -> None:
    assert mean_u(0.0, 0.1, 100) == pytest.approx(0.1 / math.sqrt(12))


def test_noise_that_hardly_shows_is_taken_for_none() -> None:
    assert mean_u(0.02, 0.1, 1000) == pytest.approx(0.1 / math.sqrt(12), rel=1e-3)
