"""Estimators of an amplitude, to be compared with each other and with the Cramér–Rao bound.

Palpate measures by least squares (`fit_sine`). The others show what a lock-in amplifier, a voltmeter and an
oscilloscope would have shown. Each has a bias of its own by hum, drift and noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from palpate.instrument.errors import EstimateError, UnknownName
from palpate.instrument.signals.estimate import amplitudes
from palpate.instrument.signals.sine_columns import sine_columns

Floats = npt.NDArray[np.float64]
Estimator = Callable[[Floats, Floats, float], Floats]
"""Function of time (n,) [s], signals (channels, n) [V] and frequency [Hz] that gives amplitudes (channels,) [V]."""


def boxcar(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier that averages over the record without a window. It is exact over whole cycles."""
    return _lock_in(time, signals, frequency, np.ones_like(time))


def hann(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Lock-in amplifier with a Hann window. Other tones hardly change it, but it has half as much noise again."""
    middle = (np.arange(time.size) + 0.5) / time.size
    return _lock_in(time, signals, frequency, np.sin(np.pi * middle) ** 2)


def rms(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Voltmeter, AC coupled: √2 times the rms. Hum, drift and noise make it greater."""
    deviation: Floats = signals.std(axis=1)
    return math.sqrt(2) * deviation


def peak_to_peak(time: Floats, signals: Floats, frequency: float) -> Floats:
    """Oscilloscope: half the difference of greatest and least sample. It grows with noise and record length."""
    extent: Floats = np.ptp(signals, axis=1)
    return extent / 2


LEAST_SQUARES = "least squares"
ESTIMATORS: Mapping[str, Estimator] = {
    LEAST_SQUARES: amplitudes,
    "lock-in boxcar": boxcar,
    "lock-in Hann": hann,
    "RMS": rms,
    "peak to peak": peak_to_peak,
}


def amplitude_ratios(estimator: str, time: Floats, records: Floats, frequency: float) -> Floats:
    """Ratios (repeats,) of the amplitudes of two channels: the first over the second.

    Args:
        estimator: name of one of ESTIMATORS.
        time: (n,) s, times that all records share.
        records: (repeats, 2, n) V.
        frequency: Hz.

    Raises:
        UnknownName: no such estimator.
        EstimateError: a record does not determine a sine, or its second channel is silent.
    """
    if estimator not in ESTIMATORS:
        raise UnknownName("estimator", estimator, ESTIMATORS)
    repeats, _, n = records.shape
    found = ESTIMATORS[estimator](time, records.reshape(2 * repeats, n), frequency).reshape(repeats, 2)
    if not (found[:, 1] > 0).all():
        raise EstimateError(f"{estimator}: the second channel is silent in a record, so there is no ratio")
    ratios: Floats = found[:, 0] / found[:, 1]
    return ratios


def ratio_bound(
    time: Floats, frequency: float, amplitude: Floats, phase: Floats, sigma: Floats, correlation: float = 0.0
) -> float:
    """Cramér–Rao bound of the relative standard uncertainty of a ratio of two amplitudes.

    The noise is white; amplitudes, phases, offsets, trends and hum are unknown. Over many whole cycles the bound in
    phase is √((2/n)(σ₁²/A₁² + σ₂²/A₂² − 2ρσ₁σ₂/(A₁A₂))). Over one cycle, trend and hum make it up to 1.6 times as
    large.

    Args:
        time: (n,) s.
        frequency: Hz.
        amplitude: (2,) V.
        phase: (2,) rad, at time zero.
        sigma: (2,) V, standard deviation of the noise of one sample.
        correlation: correlation of the two channels' noise in one sample.

    Raises:
        EstimateError: the times do not determine the sine.
    """
    basis = sine_columns(time, frequency)
    direction = basis.direction(phase + 2 * np.pi * frequency * basis.middle) * (sigma / amplitude)
    together = correlation * float(direction[:, 0] @ direction[:, 1])
    return math.sqrt(max(float((direction**2).sum()) - 2 * together, 0.0))


def _lock_in(time: Floats, signals: Floats, frequency: float, window: Floats) -> Floats:
    weights = window / window.sum() * np.exp(-2j * np.pi * frequency * time)
    found: Floats = 2 * np.abs((signals - signals.mean(axis=1, keepdims=True)) @ weights)
    return found
