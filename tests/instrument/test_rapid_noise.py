"""Noise is what is left about a line through each cycle, so that a decaying offset is no noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.signals.rapid_noise import rapid_noise

SAMPLES, FREQUENCY = 250, 10.0
TIME = np.arange(SAMPLES) / (25 * FREQUENCY)
NOISE, STEP = 22e-6, 153e-6  # V


def noises(decay: float, runs: int = 60) -> np.ndarray:
    """Noise of a film of 0.15 V whose offset, with a standard deviation of `decay` [V], decays with 1 s."""
    draw = np.random.default_rng(20)
    amplitude, phase = draw.normal(0.15, 0.005, (runs, 1)), draw.uniform(0, 2 * math.pi, (runs, 1))
    volts = amplitude * np.cos(2 * math.pi * FREQUENCY * TIME + phase) + draw.normal(0, NOISE, (runs, SAMPLES))
    volts += draw.normal(0, 1, (runs, 1)) * decay * np.exp(-TIME)
    return np.array([fit_sine(TIME, STEP * np.round(each / STEP)[np.newaxis], FREQUENCY).residual[0] for each in volts])


@pytest.mark.parametrize("decay", [1e-3, 4e-3])
def test_noise_scatters_as_that_of_independent_samples_where_an_offset_decays(decay: float) -> None:
    found = noises(decay)
    assert found.mean() == pytest.approx(math.hypot(NOISE, STEP / math.sqrt(12)), rel=0.05)
    assert 0.6 < found.std(ddof=1) / found.mean() * math.sqrt(2 * SAMPLES) < 1.5


@pytest.mark.parametrize(("samples", "cycle"), [(250, 25.0), (260, 25.0), (30, 25.0), (64, 2.5)])
def test_white_noise_keeps_its_size(samples: int, cycle: float) -> None:
    time = np.arange(samples) / 250
    drawn = np.random.default_rng(3).normal(0, 1, (4000, samples))
    columns = np.stack([np.ones(samples), time - time.mean()])
    ends = np.linalg.lstsq(columns.T, drawn.T)[0]
    rms, greatest = rapid_noise(time, drawn - (columns.T @ ends).T, cycle, spent=2)
    assert np.mean(rms**2) == pytest.approx(1.0, rel=0.01)
    assert (greatest > rms).all()
