"""The dwell for a target: what the formula says, in whole 0.1 s, and never below the floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import t

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import RangeError
from palpate.instrument.signals.dwell import (
    Floor,
    check_dwell,
    check_target,
    dwell_of,
    half_width,
    whole_steps,
)
from palpate.instrument.signals.estimate import SineFit, fit_sine
from tests.chance import amplitude_ratio

FREQUENCY, RATE = 10.0, 250.0
AMPLITUDES = np.array([0.3, 1.0])


def record(duration: float, sigma: Floats, seed: int) -> SineFit:
    time = np.arange(round(duration * RATE)) / RATE
    noise = np.random.default_rng(seed).normal(size=(2, time.size)) * sigma[:, np.newaxis]
    return fit_sine(time, AMPLITUDES[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + 1.0) + noise, FREQUENCY)


def noise_of(fit: SineFit) -> float:
    """Relative standard uncertainty that noise leaves in the ratio of both amplitudes after one second [√s]."""
    ratio, u = amplitude_ratio(fit, 0, 1)
    return u / ratio * math.sqrt(fit.samples / fit.rate)


def test_the_dwell_is_that_of_the_formula() -> None:
    sigma = np.array([0.01, 0.02])
    dwell = dwell_of(4e-3, noise_of(record(40.0, sigma, 1)), FREQUENCY).dwell
    density = sigma * math.sqrt(2 / RATE)
    assert dwell == pytest.approx(float(((density / AMPLITUDES) ** 2).sum()) * (1.96 / 4e-3) ** 2, rel=0.2)


def test_a_scatter_of_few_degrees_of_freedom_takes_a_longer_dwell_by_students_factor() -> None:
    few = (Floor("gain scatter", 0.03, 7),)
    assert half_width(few) == pytest.approx(t.ppf(0.975, 7) * 0.03)
    dwell = dwell_of(0.1, 0.03, FREQUENCY, few).dwell

    def half(dwell: float) -> float:
        u = math.hypot(0.03, 0.03 / math.sqrt(dwell))
        return float(t.ppf(0.975, 7 * (u / 0.03) ** 4) * u)  # Welch and Satterthwaite

    assert half(dwell) <= 0.1 < half(dwell - 0.1)


def test_a_quiet_point_takes_one_cycle_in_whole_steps() -> None:
    assert dwell_of(0.1, 0.0, 10.0).dwell == 0.1
    assert dwell_of(0.1, 0.0, 3.0).dwell == 0.4


@pytest.mark.parametrize(("dwell", "steps"), [(0.3, 0.3), (0.1 + 0.2, 0.3), (0.3001, 0.4), (1e-9, 0.1), (7.0, 7.0)])
def test_dwells_are_rounded_up_to_whole_tenths(dwell: float, steps: float) -> None:
    assert whole_steps(dwell) == steps


@pytest.mark.parametrize(
    ("target", "part"),
    [
        (0.08, r"± 8 % is not above the ± 8\.04 % that no dwell beats .*gain scatter u = 0\.041"),
        (0.0, "is not above 0"),
        (math.nan, "is not above 0"),
        (math.inf, "above the 50 %"),
        (5.0, "500 %, above the 50 %"),
    ],
)
def test_a_target_that_no_dwell_reaches_is_refused_with_the_floor_named(target: float, part: str) -> None:
    with pytest.raises(RangeError, match=part):
        check_target(target, (Floor("gain scatter", 0.041),))


def test_a_target_just_above_the_floor_does_not_take_for_ever() -> None:
    with pytest.raises(RangeError, match=r"above the limit of 3600 s .*; no dwell gets below ± 8\.04 %; ask"):
        dwell_of(1.96 * 0.041, 0.1, FREQUENCY, (Floor("gain scatter", 0.041),))


@pytest.mark.parametrize(
    ("dwell", "frequency", "part"),
    [
        (0.09, 10.0, "dwell 90 ms is below one cycle of 10 Hz; dwell 100 ms"),
        (math.nan, 10.0, "below one cycle"),
        (1.0, 126.0, "126 Hz is not above 0 and below half the sample rate, 125 Hz"),
        (1.0, 125.0, "is not above 0 and below"),
        (1.0, 0.0, "is not above 0 and below"),
        (1.0, math.nan, "is not above 0 and below"),
    ],
)
def test_a_dwell_or_frequency_that_gives_no_estimate_is_refused(dwell: float, frequency: float, part: str) -> None:
    with pytest.raises(RangeError, match=part):
        check_dwell(dwell, frequency, RATE)
