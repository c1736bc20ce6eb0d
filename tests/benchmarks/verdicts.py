"""Monte Carlo of verdicts: false acceptances by the stated risk, and undecided ones by the guard band."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.special import ndtr, ndtri

from palpate.instrument.uncertainty.decision import PASS, UNDECIDED, Bounds, Estimate, NormalPrior, decide, guard_band
from tests.benchmarks.row import Row

RUNS = 10_000
RISKS = (0.01, 0.05, 0.2)
LIMIT, U = 1.5, 0.3  # of objects whose values are normal, with mean 0 and standard deviation 1
WIDE = math.hypot(1.0, U)  # standard deviation of the measured values
KINDS = {"normal": (math.inf, False), "7 degrees of freedom": (7.0, False), "prior of the production": (math.inf, True)}


def measure(runs: int = RUNS) -> Iterator[Row]:
    for number, (name, (freedom, known)) in enumerate(KINDS.items()):
        for risk in RISKS:
            bounds = Bounds(-LIMIT, LIMIT, risk, NormalPrior(0.0, 1.0) if known else None)
            yield from judged(f"{name}, risk {risk:.0%}", bounds, freedom, runs, np.random.default_rng(100 + number))


def judged(name: str, bounds: Bounds, freedom: float, runs: int, rng: np.random.Generator) -> Iterator[Row]:
    """Objects of a production, then objects on the limit: half of them might as well be just outside."""
    risk = bounds.risk
    true = rng.standard_normal(runs)
    estimates = measured(true, freedom, rng)
    found = [decide(each, bounds) for each in estimates]
    passed = [(decision, bounds.hold(value)) for decision, value in zip(found, true, strict=True)
              if decision.outcome == PASS]  # fmt: skip
    wrong = sum(not holds for _, holds in passed) / len(passed)
    yield Row(f"{name}: false among accepted", f"{wrong:.2%}", f"<= {risk:.0%}", wrong <= risk)
    if bounds.prior is not None:
        told = math.fsum(decision.outside for decision, _ in passed) / len(passed)
        noise = 3 * math.sqrt(told / len(passed))
        yield Row(f"{name}: the same as their verdicts tell it", f"{told:.2%}", f"{wrong:.2%} ± {noise:.2%}",
                  abs(told - wrong) <= noise)  # fmt: skip
    else:
        there = measured(np.full(runs, LIMIT), freedom, rng)
        accepted = sum(decide(each, bounds).outcome == PASS for each in there) / runs
        most = risk + 3 * math.sqrt(risk * (1 - risk) / runs)
        yield Row(f"{name}: accepted of those on the limit", f"{accepted:.2%}", f"<= {risk:.0%} + noise = {most:.2%}",
                  accepted <= most)  # fmt: skip
    undecided = sum(decision.outcome == UNDECIDED for decision in found) / runs
    band = predicted(estimates, bounds)
    yield Row(f"{name}: undecided", f"{undecided:.1%}", f"{band:.1%} ± 2 points", abs(undecided - band) <= 0.02)


def measured(true: np.ndarray, freedom: float, rng: np.random.Generator) -> list[Estimate]:
    """Measured values with their uncertainty, which is itself estimated where its degrees of freedom are finite."""
    values = true + U * rng.standard_normal(true.size)
    u = np.full(true.size, U) if math.isinf(freedom) else U * np.sqrt(rng.chisquare(freedom, true.size) / freedom)
    return [Estimate(float(value), float(each), freedom) for value, each in zip(values, u, strict=True)]


def predicted(estimates: list[Estimate], bounds: Bounds) -> float:
    """Share of measured values within the guard bands of the two limits; a prior moves and narrows them."""
    if bounds.prior is None:
        centre, half = np.full(len(estimates), LIMIT), np.array([guard_band(each, bounds) for each in estimates])
    else:  # the value with the prior is the measured one over 1 + U², its standard deviation U over the root of that
        centre, half = np.array([LIMIT * WIDE**2]), np.array([-ndtri(bounds.risk) * U * WIDE])
    return float(2 * np.mean(ndtr((centre + half) / WIDE) - ndtr((centre - half) / WIDE)))
