"""Phases, corner and resonance come back from films that have them, as well as is stated; and not from others."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.signals.frequency_response import (
    fit_corner,
    fit_resonance,
    high_pass,
    mass_on_spring,
    phase_lead,
)

FREQUENCY = np.geomspace(0.1, 100, 13)


@pytest.mark.parametrize("turned", [0.0, 1.2])
def test_the_stated_uncertainty_of_a_phase_lead_is_its_scatter(turned: float) -> None:
    """Noise that both films share cancels only where they move in step."""
    random, pairs, shared = np.random.default_rng(8), 20, 0.9
    time = np.arange(250) / 250
    clean = np.array([np.cos(20 * np.pi * time + turned), 0.8 * np.cos(20 * np.pi * time)])
    found = []
    for _ in range(25):
        first, other = random.normal(size=(2, pairs, time.size))
        noise = np.stack([first, shared * first + math.sqrt(1 - shared**2) * other], axis=1)
        fit = fit_sine(time, (clean + 1e-3 * noise).reshape(2 * pairs, -1), 10.0)
        found += [phase_lead(fit, 2 * pair, 2 * pair + 1) for pair in range(pairs)]
    leads, us = np.array(found).T
    assert leads.mean() == pytest.approx(turned, abs=4 * us.mean() / math.sqrt(len(found)))
    assert leads.std() == pytest.approx(us.mean(), rel=0.12)


def test_a_film_does_not_lead_itself_and_one_without_a_signal_has_no_phase() -> None:
    time = np.arange(250) / 250
    fit = fit_sine(time, [np.cos(20 * np.pi * time) + 1e-3 * np.sin(7 * time**2), np.zeros(250)], 10.0)
    assert phase_lead(fit, 0, 0) == (0.0, 0.0)
    assert phase_lead(fit, 1, 0)[1] == math.inf


def test_the_stated_uncertainty_of_a_corner_is_its_scatter() -> None:
    random = np.random.default_rng(3)
    exact = np.exp(high_pass(FREQUENCY, 0.0, 0.159))
    found = [fit_corner(FREQUENCY, exact * (1 + 0.03 * random.standard_normal(13)), 0.03 * exact) for _ in range(200)]
    z = [(each.corner_Hz - 0.159) / each.corner_u for each in found if each is not None]
    assert len(z) == 200
    assert np.mean([2 * np.pi * 0.159 * each.time_constant for each in found if each]) == pytest.approx(1, rel=0.03)
    assert np.std(z) == pytest.approx(1, rel=0.15)
    assert abs(np.mean(z)) < 0.3


def test_a_flat_gain_shows_no_corner() -> None:
    flat = 1 + 0.01 * np.random.default_rng(4).standard_normal(13)
    assert fit_corner(FREQUENCY, flat, 0.01 * flat) is None


@pytest.mark.parametrize("damping", [0.05, 0.5])
def test_a_resonance_is_found_however_damped(damping: float) -> None:
    response = np.exp(mass_on_spring(FREQUENCY, 0.0, 37.0, damping))
    noisy = response * (1 + 0.01 * np.random.default_rng(5).standard_normal(13))
    found = fit_resonance(FREQUENCY, noisy, 0.01 * response)
    assert found is not None
    assert found.frequency_Hz == pytest.approx(37.0, abs=3 * found.frequency_u)
    assert found.damping == pytest.approx(damping, abs=3 * found.damping_u)
    assert found.frequency_u < 2.0


def test_a_flat_response_has_no_resonance() -> None:
    flat = 1 + 0.01 * np.random.default_rng(6).standard_normal(13)
    assert fit_resonance(FREQUENCY, flat, 0.01 * flat) is None


def test_too_few_frequencies_are_refused() -> None:
    with pytest.raises(EstimateError, match="2 frequencies do not determine it; sweep 3 or more"):
        fit_corner([1, 2], [1, 1], [0.1, 0.1])
