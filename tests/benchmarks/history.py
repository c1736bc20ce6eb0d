"""Monte Carlo of the control charts of `palpate history`: how soon a drift is found, and how often none is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from palpate.instrument.uncertainty.control_chart import checked
from tests.benchmarks.row import Row

SERIES = 10_000
MONTHLY, U = 0.01, 0.003  # relative drift in a month, standard uncertainty of a run
STEADY = 101  # runs of a series without drift: 100 checks


def measure(series: int = SERIES) -> Iterator[Row]:
    rng = np.random.default_rng(40)
    begins = {"the first of all among them": np.arange(3), "after a year without drift": np.arange(-12, 4).clip(0)}
    for what, months in begins.items():
        drift = MONTHLY * months
        found = sum(alarmed(1 + drift, rng)[-3:].any() for _ in range(series)) / series
        yield Row(f"1 % a month, u 0.3 %, found within three runs, {what}", f"{found:.1%}", ">= 95 %", found >= 0.95)
    for name, u in (("equal u", np.full(STEADY, U)), ("u of 0.1 to 1 %", np.geomspace(1e-3, 1e-2, STEADY))):
        alarms = np.mean([alarmed(np.ones(STEADY), rng, rng.permutation(u))[1:].mean() for _ in range(series // 10)])
        yield Row(f"false alarms in 100 checks, {name}", f"{100 * alarms:.2f}", "<= 1", bool(alarms <= 0.01))


def alarmed(true: np.ndarray, rng: np.random.Generator, u: np.ndarray | None = None) -> np.ndarray:
    """Which runs of a series give an alarm, whose values are off by their uncertainty."""
    us = np.full(true.size, U) if u is None else u
    values = true + us * rng.standard_normal(true.size)
    return np.array([bool(each.alarms) for each in checked(values.tolist(), us.tolist())])
