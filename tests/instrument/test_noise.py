"""The noise that counts is that around the drive; rapid noise is what is left about a line through each cycle."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import stdtrit

from palpate.instrument.arrays import Floats
from palpate.instrument.signals.estimate import FEW_DEGREES, SineFit, fit_sine, sine_columns
from palpate.instrument.signals.noise import RapidNoise, rapid_noise
from palpate.instrument.uncertainty.budget import coverage_factor

FREQUENCY, RATE = 10.0, 250.0
REPEATS = 400
LEAST = 0.92  # of REPEATS intervals of 95 %; the benchmark `coverage` takes ten times as many, and asks for 0.93


def held(fit: SineFit, true: float) -> float:
    """Share of the 95 % intervals of the amplitudes that hold the true one."""
    half = coverage_factor(fit.degrees_of_freedom) * fit.amplitude_u
    return float(np.mean(np.abs(fit.amplitude - true) <= half))


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


@pytest.mark.parametrize("duration", [1.0, 5.0])
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
    ("frequency", "rate", "duration", "mains"), [(48.0, 1200.0, 0.1, 49.8), (2.5, 62.5, 4.0, 60.0)]
)
def test_hum_that_cannot_be_told_from_the_drive_says_what_it_may_add(
    frequency: float, rate: float, duration: float, mains: float
) -> None:
    time = np.arange(round(duration * rate)) / rate
    clean, phases = np.sin(2 * np.pi * frequency * time), np.linspace(0, 2 * np.pi, 100)[:, np.newaxis]
    fit = fit_sine(time, clean + 0.01 * np.cos(2 * np.pi * mains * time + phases), frequency)
    assert np.ptp(fit.amplitude) / 0.02 == pytest.approx(fit.hum, rel=0.02)
    assert fit.hum > 0.89


def test_noise_that_falls_with_frequency_counts_as_it_is_at_the_drive() -> None:
    time = times(2.0)
    pink = coloured(time, lambda line: 10 / line)
    fit = fit_sine(time, tone(time, FREQUENCY, 1.0) + pink, FREQUENCY)
    assert fit.amplitude.var() == pytest.approx(2 * 0.02**2 / time.size, rel=0.2)
    assert np.mean(fit.noise**2) == pytest.approx(0.02**2, rel=0.06)
    assert np.mean(fit.rapid.rms**2) < 0.7 * np.mean(fit.noise**2)


def test_degrees_of_freedom_are_those_that_the_noise_scatters_with() -> None:
    time, freedom = times(4.0), 820
    fits = [fit_sine(time, some, FREQUENCY) for some in white(time).reshape(-1, 20, time.size)]
    power = np.array([fit.noise**2 for fit in fits])
    assert np.mean([fit.degrees_of_freedom for fit in fits]) == pytest.approx(freedom, rel=0.03)
    assert power.mean() == pytest.approx(0.02**2, rel=0.03)
    assert np.var(power) / power.mean() ** 2 == pytest.approx(2 / freedom, rel=0.25)


def test_noise_far_below_the_first_line_keeps_a_degree_of_freedom() -> None:
    """It is all but unknown there; with none there would be no interval at all."""
    time = times(1.2)
    fits = [fit_sine(time, tone(time, 1.0, 1.0) + some, 1.0) for some in white(time)[:20].reshape(-1, 2, time.size)]
    assert min(fit.degrees_of_freedom for fit in fits) == 1
    assert np.mean([held(fit, 1.0) for fit in fits]) >= LEAST


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
        fit_sine(time, noise, FREQUENCY).noise, rel=5e-3
    )


def test_noise_common_to_two_channels_is_seen_as_such() -> None:
    time = times(4.0)
    first, second = white(time)[:2]
    fit = fit_sine(time, np.stack([first, 0.6 * first + 0.8 * second]), FREQUENCY)
    assert fit.correlation[0, 1] == pytest.approx(0.6, abs=0.15)


@pytest.mark.parametrize(
    ("duration", "frequency"), [(0.952, 49.95), (0.2, 49.8), (0.3, 60.2), (1.0, 49.8), (1.9, 59.83), (7.3, 50.2)]
)
def test_mains_that_wander_are_fitted_where_they_are(duration: float, frequency: float) -> None:
    """10 mV beside noise of 0.1 mV: at 50 Hz alone intervals hold half of the amplitudes over 0.952 s."""
    time = times(duration)
    phases = np.linspace(0, 2 * np.pi, REPEATS)[:, np.newaxis]
    hum = 10e-3 * np.cos(2 * np.pi * frequency * time + phases)
    signals = tone(time, FREQUENCY, 0.1) + hum + 5e-3 * white(time)
    pairs = [fit_sine(time, some, FREQUENCY) for some in signals.reshape(-1, 20, time.size)]
    assert np.mean([held(fit, 0.1) for fit in pairs]) >= LEAST
    assert pairs[0].hum == 0 and not pairs[0].hum_u.any()
    told = [min(fit.mains, key=lambda each: abs(each - frequency)) for fit in pairs]
    assert told == pytest.approx([frequency] * len(told), abs=0.05 / duration)


@pytest.mark.parametrize(
    ("frequency", "mains", "duration"), [(49.5, 49.87, 1.05), (49.5, 49.87, 0.5), (50.6, 50.2, 0.5)]
)
def test_hum_less_than_a_turn_from_the_drive_widens_the_uncertainty_by_what_may_hide(
    frequency: float, mains: float, duration: float
) -> None:
    time = np.arange(round(25 * frequency * duration)) / (25 * frequency)
    phases = np.random.default_rng(9).uniform(0, 2 * np.pi, (40, 1))
    signals = tone(time, frequency, 0.1) + 10e-3 * np.cos(2 * np.pi * mains * time + phases)
    fit = fit_sine(time, signals + 1e-4 * np.random.default_rng(4).standard_normal(signals.shape), frequency)
    assert fit.beside_mains and fit.hum_u.all()
    assert held(fit, 0.1) >= 0.93


def test_hum_over_one_cycle_widens_the_uncertainty_by_as_much_as_its_wander_may_change() -> None:
    time = times(0.1)
    rng = np.random.default_rng(8)
    turns, off = rng.uniform(0, 2 * np.pi, (REPEATS, 1)), rng.uniform(-0.2, 0.2, (REPEATS, 1))
    hum = 10e-3 * np.cos(2 * np.pi * (50 + off) * time + turns)
    fit = fit_sine(time, tone(time, FREQUENCY, 0.1) + hum + 1e-4 * white(time), FREQUENCY)
    assert held(fit, 0.1) >= LEAST
    assert fit.hum_u == pytest.approx(10e-3 * 9e-3 / np.sqrt(6), rel=0.05)
    assert np.std(fit.amplitude) == pytest.approx(fit.hum_u[0], rel=0.3)


@pytest.mark.parametrize("duration", [0.06, pytest.param(0.2, marks=pytest.mark.slow)])
def test_noise_that_falls_as_1_over_f_is_held_by_a_record_that_cannot_tell_it(duration: float) -> None:
    """Over one cycle 25 samples look nearly the same with it and without."""
    count, time = round(duration * RATE), times(4.0)
    pieces = coloured(time, lambda line: FREQUENCY / line)[:, : time.size // count * count].reshape(-1, 1, count)[::3]
    short = times(duration)
    fits = [fit_sine(short, tone(short, FREQUENCY, 1.0) + piece, FREQUENCY) for piece in pieces[: REPEATS // 2]]
    assert np.mean([held(fit, 1.0) for fit in fits]) >= LEAST
    assert max(fit.degrees_of_freedom for fit in fits) < FEW_DEGREES


@pytest.mark.slow
@pytest.mark.parametrize(
    ("duration", "law"),
    [
        (0.1, "as much 1/f"),
        (0.4, "white"),
    ],
)
def test_few_samples_hold_as_often_as_they_say(duration: float, law: str) -> None:
    """Noise falling as 1/f and white noise look alike in a short record, which therefore counts with both."""
    shares = {"white": 0.0, "as much 1/f": 0.5}
    time = times(40.0)
    long = coloured(time, lambda line: 1 - shares[law] + shares[law] * FREQUENCY / line)
    count = round(duration * RATE)
    pieces = long[:, : time.size // count * count].reshape(-1, count)[::3][:2000]
    short = times(duration)
    fits = [fit_sine(short, tone(short, FREQUENCY, 1.0) + piece, FREQUENCY) for piece in pieces[:, np.newaxis]]
    share = np.mean([held(fit, 1.0) for fit in fits])
    assert share >= 0.93
    assert share <= 0.97 or np.median([fit.degrees_of_freedom for fit in fits]) < FEW_DEGREES


# --- Noise is what is left about a line through each cycle: a decaying offset is none, and repeated rounding is known

SAMPLES = 250
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
