"""Noise is what is left about a line through each cycle: a decaying offset is none, and repeated rounding is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import stdtrit

from palpate.instrument.signals.estimate import fit_sine, sine_columns
from palpate.instrument.signals.noise import RapidNoise, rapid_noise

SAMPLES, FREQUENCY = 250, 10.0
TIME = np.arange(SAMPLES) / (25 * FREQUENCY)
NOISE, STEP = 22e-6, 153e-6  # V


def noises(decay: float, runs: int = 120) -> list[RapidNoise]:
    """Noise of a film of 0.15 V whose offset, with a standard deviation of `decay` [V], decays with 1 s."""
    draw = np.random.default_rng(20)
    amplitude, phase = draw.normal(0.15, 0.005, (runs, 1)), draw.uniform(0, 2 * math.pi, (runs, 1))
    volts = amplitude * np.cos(2 * math.pi * FREQUENCY * TIME + phase) + draw.normal(0, NOISE, (runs, SAMPLES))
    volts += draw.normal(0, 1, (runs, 1)) * decay * np.exp(-TIME) + draw.uniform(0, STEP, (runs, 1))
    return [fit_sine(TIME, STEP * np.round(each / STEP)[np.newaxis], FREQUENCY).rapid for each in volts]


@pytest.mark.parametrize("decay", [0.0, 1e-3, 4e-3])
def test_noise_scatters_as_it_says_whether_an_offset_decays_or_stands_still_within_a_step(decay: float) -> None:
    each = noises(decay)
    found, stated = np.array([one.rms[0] for one in each]), np.array([one.rms_u[0] for one in each])
    assert found.mean() == pytest.approx(math.hypot(NOISE, STEP / math.sqrt(12)), rel=0.05)
    assert 0.8 < found.std(ddof=1) / math.sqrt(np.mean(stated**2)) < 1.2
    held = np.abs(found - found.mean()) < stdtrit(each[0].degrees_of_freedom, 0.975) * stated
    assert held.mean() > 0.9


@pytest.mark.parametrize(("samples", "cycle"), [(250, 25.0), (260, 25.0), (30, 25.0), (64, 2.5)])
def test_white_noise_keeps_its_size(samples: int, cycle: float) -> None:
    time = np.arange(samples) / 250
    drawn = np.random.default_rng(3).normal(0, 1, (4000, samples))
    columns = np.stack([np.ones(samples), time - time.mean()])
    ends = np.linalg.lstsq(columns.T, drawn.T)[0]
    found = rapid_noise(time, drawn - (columns.T @ ends).T, cycle, spent=2)
    assert np.mean(found.rms**2) == pytest.approx(1.0, rel=0.01)
    assert 0.8 < found.rms.std() / math.sqrt(np.mean(found.rms_u**2)) < 1.2
    assert (found.greatest > found.rms).all()


def test_rounding_of_independent_samples_is_less_uncertain_than_normal_noise_and_is_told_as_it_is() -> None:
    basis = sine_columns(TIME, FREQUENCY)
    volts = np.random.default_rng(4).uniform(-1, 1, (4000, SAMPLES))
    left = volts - (basis.columns @ basis.solve(volts)).T
    found = rapid_noise(TIME, left, 25.0, spent=basis.columns.shape[1])
    assert np.sqrt(np.mean(found.rms_u**2)) == pytest.approx(found.rms.std(), rel=0.05)
