"""Means of rounded readings are as uncertain as simulation shows, with noise and without."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy

from palpate.instrument.uncertainty import budget
from palpate.instrument.uncertainty.budget import mean_u, sums_u


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


@pytest.mark.parametrize("noise", [0.0, 0.25, 0.4])
@pytest.mark.parametrize("apart", [0.0, 0.1, 0.5, 1.02])
def test_sums_of_means_are_as_uncertain_as_what_their_rounding_shares(noise: float, apart: float) -> None:
    step, weights = 0.5, np.array([[-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
    readings = step * (7 + apart) * np.arange(3)
    # The mean of what a display shows of a reading: each of its steps with its probability.
    true = readings + step * np.linspace(0, 1, 200, endpoint=False)[:, np.newaxis]
    edges = np.arange(-2, 31) + 0.5
    passed = (
        scipy.special.ndtr((true[..., np.newaxis] / step - edges) / noise)
        if noise
        else true[..., np.newaxis] / step > edges
    )
    off = step * (edges[0] - 0.5 + passed.sum(axis=-1)) - true
    spread = np.sqrt(np.mean((off @ weights) ** 2, axis=0))
    scatter = step * math.sqrt(noise**2 + 1 / 12 - budget._bias(noise)) if noise else 0.0
    assert sums_u(weights, readings[np.newaxis], scatter, step)[0] == pytest.approx(spread, rel=0.01, abs=1e-3 * step)


@pytest.mark.parametrize("scatter", [0.34, 0.35, 0.46, 1.0, 1e6])
def test_the_noise_behind_a_scatter_is_the_root_that_bracketing_finds(scatter: float) -> None:
    found = scipy.optimize.brentq(lambda noise: budget._excess(noise, scatter), 0.0, scatter + 1.0, rtol=1e-15)
    assert budget._noise(scatter) == pytest.approx(found, rel=1e-11)


def test_without_scatter_the_step_alone_is_left() -> None:
    assert mean_u(0.0, 0.1, 100) == pytest.approx(0.1 / math.sqrt(12))


def test_noise_that_hardly_shows_is_taken_for_none() -> None:
    assert mean_u(0.02, 0.1, 1000) == pytest.approx(0.1 / math.sqrt(12), rel=1e-3)
