"""Coverage of amplitudes and ratios: how often 95 % intervals hold, every parameter drawn from its stated distribution.

Records are made as the nodes' inputs have them (white and 1/f noise, hum) and fitted as the procedures fit them. Points
that a procedure marks as too short to tell (`flags.USED`) may hold more often: their share is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from palpate.instrument.arrays import Floats
from palpate.instrument.findings.film_forces import film_forces, mean_ratio
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import FEW_DEGREES, fit_sine
from palpate.instrument.uncertainty.budget import coverage_factor
from palpate.procedures.steps.film_point import may_be_hum
from palpate.simulators.effects.pink_noise import PinkNoise
from palpate.simulators.randomness import Stream
from tests.benchmarks.row import Row

TIMES = 1000  # records a row, of two films; five minutes
RATE, FREQUENCY, PERIOD_NS = 250.0, 10.0, 4_000_000
AMPLITUDE = np.array([0.012, 0.10])  # V, of the films under 3 N
WANDER, SHORTEST, LONGEST = 0.2, 0.2, 4.0  # Hz, s
QUIET, LOUD = 2e-6, 20e-6  # V/√Hz, of thesis_single and of noisy_lab
HUM = (1e-4, 1e-2)  # V
CORNER = (1.0, 30.0)  # Hz, below which 1/f noise is more than white
WITHIN = (0.93, 0.97)
LOADS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)  # N, peak to peak


@dataclass(frozen=True, slots=True)
class Draw:
    """One record: its length [s], densities of white and 1/f noise [V/√Hz], corner [Hz], hum [V] and its frequency."""

    dwell: float
    white: float
    pink: float = 0.0
    corner: float = FREQUENCY
    hum: float = 0.0
    mains: float = 50.0

    def signals(self, rng: np.random.Generator, stream: Stream) -> tuple[Floats, Floats]:
        """Times (n,) and films (2, n) of it, at any phase."""
        numbers = np.arange(round(self.dwell * RATE)) + 5000
        time = numbers / RATE
        turned, turned_hum = rng.uniform(0, 2 * np.pi, 2)
        films = AMPLITUDE[:, np.newaxis] * np.cos(2 * np.pi * FREQUENCY * time + turned)
        films += self.white * math.sqrt(RATE / 2) * rng.standard_normal(films.shape)
        films += self.hum * np.cos(2 * np.pi * self.mains * time + turned_hum)
        if self.pink:
            noise = PinkNoise(density=f"{self.pink!r} V/√Hz", corner=f"{self.corner!r} Hz")
            films += [
                noise.volts(stream.child(film), numbers * PERIOD_NS, PERIOD_NS, lambda: np.zeros(0)) for film in (0, 1)
            ]
        return time - time[0], films


def measure() -> Iterator[Row]:
    """A row a kind of noise."""
    yield from amplitudes(TIMES)
    yield from ratios(TIMES)


def _mains(rated: float) -> Callable[[np.random.Generator], Draw]:
    return lambda rng: Draw(
        _log(rng, SHORTEST, LONGEST), _log(rng, QUIET, LOUD), 0.0, FREQUENCY, _log(rng, *HUM),
        rng.uniform(rated - WANDER, rated + WANDER),
    )  # fmt: skip


def _everything(rng: np.random.Generator) -> Draw:
    white, rated = _log(rng, QUIET, LOUD), rng.choice((50.0, 60.0))
    return Draw(
        _log(rng, SHORTEST, LONGEST), white, white, _log(rng, *CORNER), _log(rng, *HUM),
        rng.uniform(rated - WANDER, rated + WANDER),
    )  # fmt: skip


def _pink(dwell: float) -> Callable[[np.random.Generator], Draw]:
    return lambda rng: Draw(dwell, white := _log(rng, QUIET, LOUD), white, _log(rng, *CORNER))


KINDS: dict[str, Callable[[np.random.Generator], Draw]] = {
    "mains at 49.95 Hz, 10 mV, over 0.952 s": lambda _: Draw(0.952, LOUD, hum=1e-2, mains=49.95),
    "mains from 49.8 to 50.2 Hz": _mains(50.0),
    "mains from 59.8 to 60.2 Hz": _mains(60.0),
    "1/f and white noise over 0.4 s": _pink(0.4),
    "1/f noise alone over 0.4 s": lambda _: Draw(0.4, 1e-3 * QUIET, LOUD),
    "1/f and white noise over 1 s": _pink(1.0),
    "white noise over 0.1 s": lambda rng: Draw(0.1, _log(rng, QUIET, LOUD)),
    "white noise over 1 s": lambda rng: Draw(1.0, _log(rng, QUIET, LOUD)),
    "1/f, white noise and mains over 0.2 to 4 s": _everything,
    "1/f noise alone over 0.06 to 0.25 s": lambda rng: Draw(_log(rng, 0.06, 0.25), 1e-3 * QUIET, LOUD),
}


def amplitudes(times: int) -> Iterator[Row]:
    for number, name in enumerate(KINDS):
        yield _row(name, *held_amplitudes(number, name, times))


def held_amplitudes(number: int, name: str, times: int) -> tuple[list[bool], list[bool]]:
    """For each film of each record of a kind: whether its interval holds the amplitude, and whether it is marked."""
    rng = np.random.default_rng(number)
    held: list[bool] = []
    marked: list[bool] = []
    for repeat in range(times):
        time, films = KINDS[name](rng).signals(rng, Stream(number, "coverage", repeat))
        fit = fit_sine(time, films, FREQUENCY)
        half = coverage_factor(fit.degrees_of_freedom) * fit.amplitude_u
        held += (np.abs(fit.amplitude - AMPLITUDE) <= half).tolist()
        marked += [fit.degrees_of_freedom < FEW_DEGREES or may_be_hum(fit)] * len(films)
    return held, marked


def ratios(times: int) -> Iterator[Row]:
    """Coverage of ratios over load sets; cables add what the bench states, in any phase, or in step as in `noisy_lab`.

    It does not average out: over many sets it is most of what is uncertain.
    """
    bound, share = 0.1e-12 / 20e-12 / 1.5, 0.142
    design = get_design("single").with_pickup(bound)
    rng = np.random.default_rng(77)
    gains = np.array([film.sensitivity for film in design.films])
    triangle = np.array(design.scatter_triangle)
    in_step = np.zeros(2)
    for name, phases, loads in (
        ("in any phase", None, LOADS),
        ("in phase, as in noisy_lab", in_step, LOADS),
        ("in phase, 17 sets of 4 N", in_step, (4.0,) * 17),
    ):
        single, mean = [], []
        for _ in range(times):
            turned = rng.uniform(0, 2 * np.pi, 2) if phases is None else phases
            pickup = bound * np.exp(1j * turned)
            points = []
            for load in loads:
                scatter = 1 + triangle @ rng.standard_normal(2)
                phasors = gains * load / 2 * (scatter * (share, 1.0) + pickup)
                time = np.arange(250) / RATE
                films = (phasors[:, np.newaxis] * np.exp(2j * np.pi * FREQUENCY * time)).real
                films += LOUD * math.sqrt(RATE / 2) * rng.standard_normal(films.shape)
                points.append(film_forces(design, fit_sine(time, films, FREQUENCY)))
            one, all_ = points[0], mean_ratio("ratio", points, None)
            single.append(abs(one.force_ratio - share) <= 1.96 * one.force_ratio_u)
            mean.append(abs(all_.value - share) <= all_.expanded())
        yield _row(f"a ratio of 0.142, pick-up {name}", single)
        yield _row(f"a mean of {len(loads)}, pick-up {name}", mean)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


def _row(name: str, held: list[bool], marked: list[bool] | None = None) -> Row:
    """Those that are marked may hold more often than 97 %; those that are not are judged apart from them."""
    plain = [one for one, mark in zip(held, marked, strict=True) if not mark] if marked else held
    parts = [("", held)]
    if len(plain) < len(held):
        rest = [one for one, mark in zip(held, marked or [], strict=True) if mark]
        parts = [(" all", held), (" marked", rest), *([(" unmarked", plain)] if plain else [])]
    said = ", ".join(f"{sum(part) / len(part):.1%} of {len(part)}{which}" for which, part in parts)
    met = sum(held) >= WITHIN[0] * len(held) and (not plain or WITHIN[0] <= sum(plain) / len(plain) <= WITHIN[1])
    return Row(f"95 % intervals that hold: {name}", said, f"{WITHIN[0]:.0%} to {WITHIN[1]:.0%}", met)
