"""What an oscilloscope reads: peak to peak with the screen's steps, over averaged sweeps, with its uncertainty."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.signals.harmonics import distortion
from palpate.instrument.signals.oscilloscope import Oscilloscope
from tests.shares import first_of

RATE, DRIVE = 250.0, 10.0
TIME = np.arange(250) / RATE
SEED = 20


def sine(amplitude: float, frequency: float = DRIVE, phase: float = 0.3) -> np.ndarray:
    return amplitude * np.cos(2 * np.pi * frequency * TIME + phase)


@pytest.mark.parametrize("phase", np.linspace(0, 0.25, 6))
def test_a_clean_sine_is_read_to_the_steps_of_the_screen_whatever_its_phase(phase: float) -> None:
    read = Oscilloscope(bits=8).read(RATE, 70 + sine(16.0, phase=phase), DRIVE)
    assert read.step == 5 * 8 / 256  # 5 mV a division: 2 would show 16 mV, and the wave has 32
    assert abs(read.peak_to_peak - 32) < 2.5 * read.u
    assert read.u == pytest.approx(read.step / math.sqrt(6))
    finer = Oscilloscope(bits=20).read(RATE, 70 + sine(16.0, phase=phase), DRIVE)
    assert finer.peak_to_peak == pytest.approx(32, rel=2e-4)


@pytest.mark.parametrize("averages", [1, 8])
def test_its_uncertainty_is_what_readings_scatter_and_averages_lower_it_by_their_root(averages: int) -> None:
    noise, scope = np.random.default_rng(SEED), Oscilloscope(bits=16, averages=averages)
    read = [scope.read(RATE, sine(0.1) + 1e-3 * noise.standard_normal(250), DRIVE) for _ in range(400)]
    u = float(np.mean([each.u for each in read]))
    assert u == pytest.approx(math.sqrt(2 / averages) * 1e-3, rel=0.03)
    assert np.std([each.peak_to_peak for each in read]) == pytest.approx(u, rel=0.2)


def test_noise_and_harmonics_are_in_the_reading() -> None:
    noise, scope = np.random.default_rng(SEED), Oscilloscope(bits=16)
    noisy = [scope.read(RATE, sine(0.1) + 0.01 * noise.standard_normal(250), DRIVE).peak_to_peak for _ in range(100)]
    assert np.mean(noisy) > 0.21
    assert Oscilloscope(bits=16).read(RATE, sine(1, phase=0) + sine(0.1, 3 * DRIVE, 0), DRIVE).peak_to_peak > 2.19


@pytest.mark.parametrize(
    ("samples", "rate", "scope", "why"),
    [
        (250, 250.5, Oscilloscope(), "25.05 samples a cycle are not a whole number; sample at 250 Hz"),
        (20, RATE, Oscilloscope(), "20 samples at 250 Hz hold no cycle of 10 Hz"),
        (250, 100.0, Oscilloscope(), "no cycle of 10 Hz of 16 samples or more; sample faster"),
        (30, RATE, Oscilloscope(), "has 1 whole cycles.*needs 2; dwell longer"),
        (250, RATE, Oscilloscope(averages=11), "has 10 whole cycles.*averages 11 needs 11; dwell longer"),
    ],
)
def test_a_record_that_shows_no_sweep_is_refused(samples: int, rate: float, scope: Oscilloscope, why: str) -> None:
    with pytest.raises(EstimateError, match=why):
        scope.read(rate, sine(1.0)[:samples], DRIVE)


def test_a_waveform_with_holes_and_an_oscilloscope_without_bits_are_refused() -> None:
    with pytest.raises(EstimateError, match=r"shape \(250,\) must be \(n,\) and finite"):
        Oscilloscope().read(RATE, np.full(250, np.nan), DRIVE)
    with pytest.raises(RangeError, match="bits 0 is not 1 to 24"):
        Oscilloscope(bits=0)


# --- harmonics -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", first_of([0.01, 0.0, 0.05]))
def test_the_distortion_of_noisy_records_scatters_about_the_true_one_by_its_uncertainty(share: float) -> None:
    noise, found = np.random.default_rng(SEED), []
    for _ in range(400):
        volts = sine(0.1) + sine(0.1 * share, 2 * DRIVE) + 0.02 * TIME + 1e-3 * noise.standard_normal(250)
        found.append(distortion(fit_sine(TIME, [volts], DRIVE), 0, volts))
    value, u = np.array([each.value for each in found]), np.mean([each.u for each in found])
    assert np.std(value) < 1.15 * u
    assert np.mean(value > share + 3 * u) < 0.01
    assert np.mean(value) == pytest.approx(share, abs=0.5 * u)
    if share:
        assert u == pytest.approx(np.std(value), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("cycles", [4, 10])
def test_noise_alone_looks_as_distorted_as_often_as_is_said(cycles: int) -> None:
    noise, time = np.random.default_rng(SEED), TIME[: 25 * cycles]
    chances = []
    for _ in range(1500):
        volts = sine(0.1)[: time.size] + 1e-3 * noise.standard_normal(time.size)
        chances.append(distortion(fit_sine(time, [volts], DRIVE), 0, volts).by_noise)
    for level in (0.01, 0.1, 0.5):
        assert np.mean(np.array(chances) < level) == pytest.approx(level, abs=4 * math.sqrt(level / 1500))
    spoilt = sine(0.1)[: time.size] + sine(0.002, 3 * DRIVE)[: time.size] + 1e-5 * noise.standard_normal(time.size)
    assert distortion(fit_sine(time, [spoilt], DRIVE), 0, spoilt).by_noise < 1e-12


def test_several_harmonics_add_up_as_squares_and_hum_is_none_of_them() -> None:
    volts = sine(1.0) + sine(0.03, 2 * DRIVE) + sine(0.04, 3 * DRIVE) + sine(0.2, 50.0)
    assert distortion(fit_sine(TIME, [volts], DRIVE), 0, volts).value == pytest.approx(0.05, rel=2e-4)


def test_too_few_cycles_and_hum_on_every_harmonic_tell_no_distortion() -> None:
    with pytest.raises(EstimateError, match=r"2 cycles of 10 Hz and 1 V.*needs 3 cycles"):
        distortion(fit_sine(TIME[:50], [sine(1.0)[:50]], DRIVE), 0, sine(1.0)[:50])
    fast = np.arange(500) / 1250
    volts = np.cos(2 * np.pi * 50 * fast)
    with pytest.raises(EstimateError, match=r"harmonics \[\] off the mains"):
        distortion(fit_sine(fast, [volts], 50.0), 0, volts)
