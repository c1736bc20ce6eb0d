"""The noise that counts is the noise around the drive."""

from __future__ import annotations

from collections.abc import Callable

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


def coloured(time: Floats, power: Callable[[Floats], Floats]) -> Floats:
    """Noise whose power, over that of `white`, is a function of the frequency."""
    lines = np.fft.rfftfreq(time.size, 1 / RATE)
    return np.fft.irfft(np.fft.rfft(white(time), axis=1) * np.sqrt(power(np.maximum(lines, 0.5))), n=time.size, axis=1)


@pytest.mark.parametrize("duration", [0.1, 0.2, 1.0, 5.0])
def test_hum_changes_neither_amplitude_nor_uncertainty(duration: float) -> None:
    time = times(duration)
    quiet = fit_sine(time, tone(time, FREQUENCY, 1.0) + white(time), FREQUENCY)
    for mains in (50.0, 60.0):
        humming = fit_sine(time, tone(time, FREQUENCY, 1.0) + white(time) + tone(time, mains, 0.3), FREQUENCY)
        assert humming.hum == 0
        assert humming.amplitude == pytest.approx(quiet.amplitude, abs=1e-12)
        assert humming.amplitude_u == pytest.approx(quiet.amplitude_u, rel=1e-9)
    assert np.mean(quiet.amplitude_u**2) == pytest.approx(quiet.amplitude.var(), rel=0.25)


@pytest.mark.parametrize(
    ("frequency", "rate", "duration", "mains"), [(48.0, 1200.0, 0.1, 50.0), (2.5, 62.5, 4.0, 60.0)]
)
def test_hum_that_cannot_be_told_from_the_drive_says_what_it_may_add(
    frequency: float, rate: float, duration: float, mains: float
) -> None:
    time = np.arange(round(duration * rate)) / rate
    clean, phases = np.sin(2 * np.pi * frequency * time), np.linspace(0, 2 * np.pi, 100)[:, np.newaxis]
    fit = fit_sine(time, clean + 0.01 * np.cos(2 * np.pi * mains * time + phases), frequency)
    assert np.ptp(fit.amplitude) / 0.02 == pytest.approx(fit.hum, rel=0.02)
    assert fit.hum > 0.9


def test_noise_that_falls_with_frequency_counts_as_it_is_at_the_drive() -> None:
    time = times(2.0)
    pink = coloured(time, lambda line: 10 / line)
    fit = fit_sine(time, tone(time, FREQUENCY, 1.0) + pink, FREQUENCY)
    assert fit.amplitude.var() == pytest.approx(2 * 0.02**2 / time.size, rel=0.2)
    assert np.mean(fit.noise**2) == pytest.approx(0.02**2, rel=0.06)
    assert np.mean(fit.residual**2) < 0.7 * np.mean(fit.noise**2)


@pytest.mark.parametrize(("duration", "freedom"), [(0.4, 48), (4.0, 820)])
def test_degrees_of_freedom_are_those_that_the_noise_scatters_with(duration: float, freedom: int) -> None:
    """Of the lines around the drive, or of all lines."""
    time = times(duration)
    fits = [fit_sine(time, some, FREQUENCY) for some in white(time).reshape(-1, 20, time.size)]
    power = np.array([fit.noise**2 for fit in fits])
    assert np.mean([fit.degrees_of_freedom for fit in fits]) == pytest.approx(freedom, rel=0.03)
    assert power.mean() == pytest.approx(0.02**2, rel=0.03)
    assert np.var(power) / power.mean() ** 2 == pytest.approx(2 / freedom, rel=0.25)


def test_a_spectrum_of_another_shape_counts_by_the_lines_around_the_drive() -> None:
    time = times(4.0)
    hill = coloured(time, lambda line: 1 + 8 * np.exp(-(((line - 40) / 10) ** 2)))
    fit = fit_sine(time, hill, FREQUENCY)
    assert fit.degrees_of_freedom == 2 * 58  # 5 to 20 Hz without the drive and its harmonic
    assert np.mean(fit.noise**2) == pytest.approx(0.02**2, rel=0.03)


def test_harmonics_of_the_drive_are_no_noise() -> None:
    time = times(2.0)
    bent = tone(time, FREQUENCY, 1.0) + tone(time, 20.0, 0.05) + tone(time, 30.0, 0.05)
    noise = white(time)[:2]
    assert fit_sine(time, bent + noise, FREQUENCY).noise == pytest.approx(
        fit_sine(time, noise, FREQUENCY).noise, rel=1e-3
    )


def test_noise_common_to_two_channels_is_seen_as_such() -> None:
    time = times(4.0)
    first, second = white(time)[:2]
    fit = fit_sine(time, np.stack([first, 0.6 * first + 0.8 * second]), FREQUENCY)
    assert fit.correlation[0, 1] == pytest.approx(0.6, abs=0.15)
