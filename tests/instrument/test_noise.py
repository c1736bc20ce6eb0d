"""The noise that counts is the noise around the drive."""

from __future__ import annotations

import numpy as np
import pytest

from instrument.estimate import Floats, fit_sine

FREQUENCY, RATE = 10.0, 250.0
REPEATS = 400


def tone(time: Floats, frequency: float, amplitude: float) -> Floats:
    return amplitude * np.cos(2 * np.pi * frequency * time + 0.4)


def times(duration: float) -> Floats:
    return np.arange(round(duration * RATE)) / RATE


def white(time: Floats) -> Floats:
    return np.random.default_rng(3).normal(scale=0.02, size=(REPEATS, time.size))


@pytest.mark.parametrize(("duration", "left"), [(0.2, 0.05), (1.0, 0.005), (5.0, 0.001)])
def test_the_uncertainty_is_that_of_the_spread_with_hum_or_without(duration: float, left: float) -> None:
    """In short records hum shifts the trend a little."""
    time = times(duration)
    quiet = fit_sine(time, tone(time, FREQUENCY, 1.0) + white(time), FREQUENCY)
    for mains in (50.0, 60.0):
        humming = fit_sine(time, tone(time, FREQUENCY, 1.0) + white(time) + tone(time, mains, 0.3), FREQUENCY)
        assert np.mean(humming.amplitude_u**2) == pytest.approx(np.mean(quiet.amplitude_u**2), rel=left)
        assert humming.residual.mean() > 5 * quiet.residual.mean()
    assert np.mean(quiet.amplitude_u**2) == pytest.approx(quiet.amplitude.var(), rel=0.25)


def test_noise_that_falls_with_frequency_counts_as_it_is_at_the_drive() -> None:
    time = times(2.0)
    lines = np.fft.rfftfreq(time.size, 1 / RATE)
    spectrum = np.fft.rfft(white(time), axis=1) * np.sqrt(10 / np.maximum(lines, 0.5))
    pink = np.fft.irfft(spectrum, n=time.size, axis=1)
    fit = fit_sine(time, tone(time, FREQUENCY, 1.0) + pink, FREQUENCY)
    assert fit.amplitude.var() == pytest.approx(2 * 0.02**2 / time.size, rel=0.2)
    assert np.mean(fit.noise**2) == pytest.approx(0.02**2, rel=0.12)
    assert np.mean(fit.residual**2) < 0.7 * np.mean(fit.noise**2)


def test_degrees_of_freedom_are_those_that_the_noise_scatters_with() -> None:
    time = times(1.0)
    fit = fit_sine(time, white(time), FREQUENCY)
    assert fit.degrees_of_freedom == 48
    scatter = float(np.var(fit.noise**2) / np.mean(fit.noise**2) ** 2)
    assert scatter == pytest.approx(2 / 48, rel=0.25)


def test_noise_common_to_two_channels_is_seen_as_such() -> None:
    time = times(4.0)
    first, second = white(time)[:2]
    fit = fit_sine(time, np.stack([first, 0.6 * first + 0.8 * second]), FREQUENCY)
    assert fit.correlation[0, 1] == pytest.approx(0.6, abs=0.15)
