"""What voltages that add to the films' do to the results: force and force ratio of a least-squares sine.

The fit is linear: an amplitude changes by no more than the length of weights @ voltages, over its cosine and sine.
Bounds are of the voltages before the converter, whose own steps are the bound of `adc`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import numpy as np

from instrument.design import FILM_KINDS, Film
from simulators.effects.effect import AmplifierEffect, Bound, Case, Floats

SIGMAS = 6.0  # of noise, that a bound covers: two quadratures exceed it once in 6e7 fits


def bound(case: Case, error: Callable[[Film], float]) -> Bound:
    """What amplitudes that are wrong by `error` of a film [V] do to the results."""
    relative = {film.name: _over(error(film), signal(case, film)) for film in case.design.films}
    rigid, total = ([film for film in case.design.films if film.kind == kind] for kind in FILM_KINDS)
    pairs = [(tooth, base) for tooth in rigid for base in total if set(tooth.teeth) <= set(base.teeth)]
    return Bound(
        max(relative[base.name] for base in total),
        max(
            (relative[tooth.name] + relative[base.name]) / (1 - relative[base.name])
            if relative[base.name] < 1
            else math.inf
            for tooth, base in pairs
        ),
    )


def signal(case: Case, film: Film) -> float:
    """Amplitude of a film's voltage [V], at least."""
    part = len(film.teeth) / len(case.design.teeth) * (case.ratio if film.kind == FILM_KINDS[0] else 1.0)
    amplifier = next((e for e in case.effects.values() if isinstance(e, AmplifierEffect)), None)
    passed = 1.0
    if amplifier is not None:
        passed = abs(amplifier.system(film, case.design, 0.0).transfer(case.frequency)[0, 0])
    return film.sensitivity * part * case.amplitude * passed


def spread(case: Case) -> float:
    """Standard deviation of an amplitude over that of independent noise in each sample."""
    return float(np.linalg.norm(_weights(case.frequency, case.dwell, case.rate), 2))


def correlated_spread(case: Case, correlation: Callable[[Floats], Floats]) -> float:
    """The same for noise with a correlation over the lag [s]."""
    from scipy.linalg import matmul_toeplitz

    weights = _weights(case.frequency, case.dwell, case.rate)
    column = correlation(np.arange(weights.shape[1]) / case.rate)
    covariance = weights @ matmul_toeplitz(column, weights.T)
    return math.sqrt(np.linalg.norm(covariance, 2))


def largest_within(case: Case) -> float:
    """Greatest error of an amplitude over that of any sample."""
    return spread(case) * math.sqrt(_count(case.dwell, case.rate))


def largest_tone(case: Case, frequency: float) -> float:
    """Greatest error of an amplitude over the amplitude of a sine of another frequency [Hz]."""
    weights = _weights(case.frequency, case.dwell, case.rate)
    turns = np.exp(2j * np.pi * frequency * np.arange(weights.shape[1]) / case.rate)
    phasors = weights @ turns
    return float(np.linalg.norm(np.stack([phasors.real, phasors.imag]), 2))  # at its worst phase


def _over(error: float, amplitude: float) -> float:
    return error / amplitude if amplitude > 0 else math.inf


def _count(dwell: float, rate: float) -> int:
    return max(1, round(dwell * rate))


@functools.lru_cache(maxsize=8)
def _weights(frequency: float, dwell: float, rate: float) -> Floats:
    """(2, n): from the samples of a dwell to cosine and sine, with offset and trend in the fit."""
    time = np.arange(_count(dwell, rate)) / rate
    time -= time.mean()
    angle = 2 * np.pi * frequency * time
    columns = np.stack([np.cos(angle), np.sin(angle), np.ones_like(time), time / max(dwell, 1 / rate)], axis=1)
    weights: Floats = np.linalg.pinv(columns)[:2]
    return weights
