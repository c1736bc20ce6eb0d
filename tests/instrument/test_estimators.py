"""Estimators side by side: what each is right about, and how far each is off where it is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, UnknownName
from palpate.instrument.signals.estimate import (
    ESTIMATORS,
    LEAST_SQUARES,
    amplitude_ratios,
    amplitudes,
    fit_sine,
    ratio_bound,
)

FREQUENCY, RATE = 10.0, 250.0
AMPLITUDE, PHASE = np.array([0.3, 1.0]), np.array([0.7, 0.7])
BIASED = ("RMS", "peak to peak")


def times(duration: float) -> Floats:
    return np.arange(round(duration * RATE)) / RATE


def clean(time: Floats) -> Floats:
    return AMPLITUDE[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + PHASE[:, np.newaxis])


def noisy(time: Floats, relative: float, repeats: int = 2000) -> Floats:
    noise = np.random.default_rng(5).normal(size=(repeats, 2, time.size))
    return clean(time) + relative * AMPLITUDE[:, np.newaxis] * noise


@pytest.mark.parametrize("name", ESTIMATORS)
def test_over_whole_cycles_without_noise_all_agree(name: str) -> None:
    time = times(1.0)
    found = amplitude_ratios(name, time, clean(time)[np.newaxis], FREQUENCY)
    assert found == pytest.approx([0.3], rel=1e-12)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_efficiencies_at_ten_cycles_are_those_that_theory_says(name: str) -> None:
    """Theory says, over the bound: 1 but for the trend, 2/3 by a Hann window, 1 by the rms, nearly 0 by peaks."""
    time, relative = times(1.0), 0.03
    ratios = amplitude_ratios(name, time, noisy(time, relative), FREQUENCY)
    bound = 0.3 * ratio_bound(time, FREQUENCY, AMPLITUDE, PHASE, relative * AMPLITUDE)
    expected = {LEAST_SQUARES: 1.0, "lock-in boxcar": 1.0, "lock-in Hann": 2 / 3, "RMS": 1.0, "peak to peak": 0.06}
    assert bound**2 / ratios.var() == pytest.approx(expected[name], rel=0.1, abs=0.03)


def test_a_boxcar_is_off_where_cycles_are_not_whole_and_least_squares_is_not() -> None:
    time = times(0.125)
    off = {name: abs(float(f(time, clean(time), FREQUENCY)[1]) - 1) for name, f in ESTIMATORS.items()}
    assert off[LEAST_SQUARES] < 1e-12
    assert off["lock-in boxcar"] > 0.05


@pytest.mark.parametrize("name", ESTIMATORS)
def test_hum_harms_those_that_take_all_for_signal(name: str) -> None:
    time = times(1.0)
    records = clean(time) + 0.3 * np.sin(2 * np.pi * 50 * time)
    found = float(amplitude_ratios(name, time, records[np.newaxis], FREQUENCY)[0])
    if name in BIASED:
        assert found > 1.3 * 0.3
    else:
        assert found == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_noise_biases_what_counts_it_as_signal(name: str) -> None:
    time = times(1.0)
    records = clean(time) + 0.1 * np.random.default_rng(6).normal(size=(500, 2, time.size))
    bias = float(amplitude_ratios(name, time, records, FREQUENCY).mean()) / 0.3 - 1
    assert bias > 0.05 if name in BIASED else abs(bias) < 0.01


def test_the_bound_is_the_textbooks_over_many_cycles_and_more_over_one() -> None:
    sigma, rho = np.array([0.01, 0.05]), 0.6
    relative = sigma / AMPLITUDE

    def textbook(time: Floats) -> float:
        return math.sqrt(2 / time.size * float((relative**2).sum() - 2 * rho * relative.prod()))

    long, short = times(10.0), times(0.1)
    assert ratio_bound(long, FREQUENCY, AMPLITUDE, PHASE, sigma, rho) == pytest.approx(textbook(long), rel=1e-3)
    costs = [
        ratio_bound(short, FREQUENCY, AMPLITUDE, np.full(2, phase), sigma, rho) / textbook(short)
        for phase in np.linspace(0, math.pi, 40)
    ]
    assert min(costs) == pytest.approx(1.0, abs=0.01) and max(costs) == pytest.approx(1.6, abs=0.1)


def test_the_bound_is_what_the_fit_says_of_itself() -> None:
    time = times(0.5)
    records = noisy(time, 0.03, repeats=1)[0]
    fit = fit_sine(time, records, FREQUENCY)
    bound = ratio_bound(time, FREQUENCY, fit.amplitude, fit.phase, fit.noise)
    assert bound == pytest.approx(float(np.hypot(*(fit.amplitude_u / fit.amplitude))), rel=1e-12)


def test_many_records_at_once_are_fitted_as_each_alone() -> None:
    time = times(0.7)
    records = noisy(time, 0.1, repeats=3).reshape(6, time.size) + 1e3
    alone = [float(fit_sine(time, record[np.newaxis], FREQUENCY).amplitude[0]) for record in records]
    assert amplitudes(time, records, FREQUENCY) == pytest.approx(alone, rel=1e-12)


def test_what_is_unknown_or_silent_is_refused() -> None:
    time = times(1.0)
    with pytest.raises(UnknownName, match=r"estimator 'lock-in han' \(did you mean 'lock-in Hann'\?\)"):
        amplitude_ratios("lock-in han", time, clean(time)[np.newaxis], FREQUENCY)
    with pytest.raises(EstimateError, match="second channel is silent"):
        amplitude_ratios("RMS", time, np.zeros((1, 2, time.size)), FREQUENCY)
    with pytest.raises(EstimateError, match=r"shorter than 0\.25 cycle"):
        amplitude_ratios(LEAST_SQUARES, time[:6], clean(time)[np.newaxis, :, :6], FREQUENCY)
