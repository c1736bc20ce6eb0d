"""What voltages that add to the films' do to the results: force and force ratio of a least-squares sine.

The fit is linear: an amplitude changes by no more than the length of weights @ voltages, over its cosine and sine.
Where a scene calls for a converter, both results, with an effect and without it, are of rounded samples.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

import numpy as np

from instrument.design import FILM_KINDS, Film
from instrument.sine_columns import sine_columns
from simulators.effects.effect import AmplifierEffect, Bound, Case, FilmsEffect, Floats, LeakEffect
from simulators.randomness import Stream

if TYPE_CHECKING:
    from simulators.effects.adc import Adc
    from simulators.effects.gain_scatter import GainScatter

LATE = 30 * 86_400.0  # s
DIRECTIONS = 64  # of half a circle
SIGMAS = 6.0  # of noise, that a bound covers: two quadratures exceed it once in 6e7 fits


@runtime_checkable
class Additive(Protocol):
    """An effect that adds to the films' voltages."""

    def error(self, case: Case, film: Film) -> float:
        """Greatest change of the amplitude of a film that it makes [V]."""


def bound(effect: Additive, case: Case) -> Bound:
    """What an effect that adds to the films' voltages does to the results."""
    beside = [other for other in case.effects.values() if isinstance(other, Additive)]

    def relative(film: Film) -> float:
        error = effect.error(case, film)
        least = signal(case, film) - sum(other.error(case, film) for other in beside)
        if error == 0:
            return 0.0
        return (error + 2 * rounding(case, film)) / least if least > 0 else math.inf

    return of_films(case, relative)


def of_films(case: Case, relative: Callable[[Film], float]) -> Bound:
    """The bound of the results for that of each film's amplitude, relative."""
    changes = {film.name: relative(film) for film in case.design.films}
    rigid, total = ([film for film in case.design.films if film.kind == kind] for kind in FILM_KINDS)
    pairs = [(changes[a.name], changes[b.name]) for a in rigid for b in total if set(a.teeth) <= set(b.teeth)]
    return Bound(
        max(changes[film.name] for film in total),
        max((tooth + base) / (1 - base) if base < 1 else math.inf for tooth, base in pairs),
    )


def signal(case: Case, film: Film) -> float:
    """Amplitude of a film's voltage [V], at least: what the effects that are simulated leave of it."""
    films, effects = case.design.films, case.effects
    shares = [len(f.teeth) / len(case.design.teeth) * (case.ratio if f.kind == FILM_KINDS[0] else 1.0) for f in films]
    volts = case.amplitude * np.array([f.sensitivity for f in films]) * shares
    for name, effect in effects.items():
        if isinstance(effect, FilmsEffect) and name != "gain_scatter":
            volts = effect.matrix(case.design, Stream(0), 0) @ volts
        if isinstance(effect, AmplifierEffect):
            volts = volts * [_passed(effect, f, case) for f in films]
    scatter = cast("GainScatter | None", effects.get("gain_scatter"))
    lost = SIGMAS * scatter.strength * film.scatter if scatter else 0.0
    return float(abs(volts[films.index(film)])) * max(1 - lost, 0.0)


def _passed(amplifier: AmplifierEffect, film: Film, case: Case) -> float:
    """Gain of an amplifier, however much the scene's leak drains."""
    leak = next((effect for effect in case.effects.values() if isinstance(effect, LeakEffect)), None)
    leakages = [0.0] if leak is None else [leak.conductance(0.0), leak.conductance(LATE)]
    systems = [amplifier.system(film, case.design, leakage) for leakage in leakages]
    return min(float(abs(system.transfer(case.frequency)[0, 0])) for system in systems)


def rounding(case: Case, film: Film) -> float:
    """What rounding its samples to the steps of the scene's converter changes in the amplitude of a film [V]."""
    converter = cast("Adc | None", case.effects.get("adc"))
    return 0.0 if converter is None else converter.error(case, film)


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
    return _largest(case.frequency, case.dwell, case.rate)


@functools.lru_cache(maxsize=8)
def _largest(frequency: float, dwell: float, rate: float) -> float:
    # Sum of |weights| seen from a direction is convex: around the circle it is below that at a polygon's corners.
    angles = np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    seen = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ _weights(frequency, dwell, rate)
    return float(np.abs(seen).sum(axis=1).max()) / math.cos(np.pi / 2 / DIRECTIONS)


def largest_tone(case: Case, frequency: float) -> float:
    """Greatest error of an amplitude over the amplitude of a sine of another frequency [Hz]."""
    weights = _weights(case.frequency, case.dwell, case.rate)
    turns = np.exp(2j * np.pi * frequency * np.arange(weights.shape[1]) / case.rate)
    phasors = weights @ turns
    return float(np.linalg.norm(np.stack([phasors.real, phasors.imag]), 2))  # at its worst phase


def _count(dwell: float, rate: float) -> int:
    return max(1, round(dwell * rate))


@functools.lru_cache(maxsize=8)
def _weights(frequency: float, dwell: float, rate: float) -> Floats:
    """(2, n): from the samples of a dwell to cosine and sine, as they are fitted. Raises EstimateError."""
    columns = sine_columns(np.arange(_count(dwell, rate)) / rate, frequency)
    weights: Floats = np.linalg.pinv(columns.columns)[:2] * columns.scale[:2, np.newaxis]
    return weights
