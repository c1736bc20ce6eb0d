"""How good the estimators are: variance against the Cramér–Rao bound, bias, and dwells that meet their target."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from palpate.instrument.errors import EstimateError
from palpate.instrument.signals.dwell import dwell_of, ratio_noise
from palpate.instrument.signals.estimate import (
    ESTIMATORS,
    LEAST_SQUARES,
    Floats,
    amplitude_ratio,
    amplitude_ratios,
    fit_sine,
    ratio_bound,
)
from palpate.procedures.steps.film_point import pilot_length
from tests.benchmarks.row import Row

FREQUENCY, RATE = 10.0, 250.0
AMPLITUDE = np.array([0.3, 1.0])
NOISES = (0.003, 0.03, 0.3)  # of a sample over the amplitude
CYCLES = (1.0, 1.25, 2.0, 3.3, 10.0)
PHASES = (0.0, 0.8, 1.6)
VALUES, MOST = 8_000_000, 20_000  # samples drawn for one spread, and repeats: they tell a variance to 1 %
PAIRS = 20  # of channels, in one fit
TARGET, REPEATS = 3e-3, 200


def measure() -> Iterator[Row]:
    """Rows of least squares at its worst, of the others at ten cycles, and of the dwell."""
    rng = np.random.default_rng(2026)
    worst_variance, worst_bias, refused = (0.0, ""), (0.0, ""), 0.0
    for cycles in CYCLES:
        for relative in NOISES:
            for phase in PHASES:
                variance, bias, lost = _against_bound(rng, LEAST_SQUARES, cycles, relative, phase)
                refused = max(refused, lost)
                where = f"sigma/A {relative:g}, {cycles:g} cycles"
                worst_variance = max(worst_variance, (variance, where))
                worst_bias = max(worst_bias, (bias, where))
    limit = 1.05
    yield Row("least squares: variance / Cramér–Rao", f"{worst_variance[0]:.3f} at worst ({worst_variance[1]})",
              f"<= {limit}", worst_variance[0] <= limit)  # fmt: skip
    yield Row("least squares: bias / standard uncertainty", f"{worst_bias[0]:.3f} at worst ({worst_bias[1]})", "< 0.1",
              worst_bias[0] < 0.1)  # fmt: skip
    yield Row("records refused, base film's amplitude below 3 u", f"{refused:.2%} at worst")
    for cycles in (1.0, 2.0, 10.0):
        yield Row(f"what trend and hum cost the bound, {cycles:g} cycles",
                  f"x {_nuisance(cycles):.3f} in variance at worst")  # fmt: skip
    for name in ESTIMATORS:
        variance, bias, _ = _against_bound(rng, name, 10.0, 0.03, 0.8)
        yield Row(f"{name}, sigma/A 0.03, 10 cycles", f"efficiency {1 / variance:.2f}, bias {bias:.2f} u")
    yield from _dwells(rng)


def _noisy(rng: np.random.Generator, time: Floats, sigma: float, phase: float, repeats: int) -> Floats:
    clean = np.cos(2 * np.pi * FREQUENCY * time + phase)
    noisy: Floats = AMPLITUDE[:, np.newaxis] * (clean + sigma * rng.normal(size=(repeats, 2, time.size)))
    return noisy


def _ratios(name: str, time: Floats, records: Floats) -> Floats:
    """Force ratios by an estimator. Least squares fit some pairs at once, as a measurement does."""
    if name != LEAST_SQUARES:
        return amplitude_ratios(name, time, records, FREQUENCY)
    found: list[float] = []
    for some in np.array_split(records, -(-len(records) // PAIRS)):
        fit = fit_sine(time, some.reshape(-1, time.size), FREQUENCY)
        for pair in range(len(some)):
            with suppress(EstimateError):
                found.append(amplitude_ratio(fit, 2 * pair, 2 * pair + 1)[0])
    return np.array(found)


def _against_bound(
    rng: np.random.Generator, name: str, cycles: float, relative: float, phase: float
) -> tuple[float, float, float]:
    """Variance over that of the bound, size of the bias over the standard deviation, share of refused records."""
    time = np.arange(round(cycles * RATE / FREQUENCY)) / RATE
    repeats = min(MOST, VALUES // time.size)
    ratios = _ratios(name, time, _noisy(rng, time, relative, phase, repeats)) / 0.3
    bound = ratio_bound(time, FREQUENCY, AMPLITUDE, np.full(2, phase), relative * AMPLITUDE)
    u = float(ratios.std(ddof=1))
    return (u / bound) ** 2, abs(float(ratios.mean()) - 1) / u, 1 - len(ratios) / repeats


def _nuisance(cycles: float) -> float:
    """Variance that unknown trend and hum cost, at the worst phase."""
    time = np.arange(round(cycles * RATE / FREQUENCY)) / RATE
    alike = np.full(2, 1.0)
    bounds = [ratio_bound(time, FREQUENCY, alike, np.full(2, p), alike) for p in np.linspace(0, np.pi, 60)]
    return max(bounds) ** 2 / (4 / time.size)


def _dwells(rng: np.random.Generator) -> Iterator[Row]:
    """Each repeat chooses its dwell by the noise of a record of its own, and is measured for that long."""
    sigma = 0.04
    found, dwells = [], []
    for _ in range(REPEATS):
        pilot = np.arange(round(pilot_length(FREQUENCY) * RATE)) / RATE
        noise = ratio_noise(fit_sine(pilot, _noisy(rng, pilot, sigma, 0.8, 1)[0], FREQUENCY), 0, 1)
        chosen = dwell_of(TARGET, noise, FREQUENCY)
        time = np.arange(round(chosen.dwell * RATE)) / RATE
        found.append(amplitude_ratio(fit_sine(time, _noisy(rng, time, sigma, 0.8, 1)[0], FREQUENCY), 0, 1)[0] / 0.3)
        dwells.append(chosen)
    spread = float(np.std(found, ddof=1)) / TARGET
    true = 4 * sigma**2 / RATE / TARGET**2
    longest = max(each.dwell / each.asked for each in dwells)
    yield Row(f"dwell for {TARGET:.1%}: spread of {REPEATS} repeats / target", f"{spread:.3f}", "0.9 to 1.1",
              0.9 <= spread <= 1.1)  # fmt: skip
    yield Row("dwell / what the bound asks by the noise measured", f"{longest:.3f} at most", "<= 1.2", longest <= 1.2)
    mean, most = (float(f([each.dwell for each in dwells])) / true for f in (np.mean, np.max))
    yield Row(f"dwell / what the bound asks by the true noise ({true:.2g} s)",
              f"{mean:.3f} in the mean, {most:.3f} at most", "<= 1.2", most <= 1.2)  # fmt: skip
