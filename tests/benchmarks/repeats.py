"""Monte Carlo of `sweep loads` with a tolerance of the mean: coverage, achieved over predicted, bench time."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.instrument.sensor.designs import get_design
from palpate.procedures.measurements.loads.repeats import Repeats
from tests.benchmarks.row import Row

RUNS = 1000
SINGLE, LOADS, SAMPLE = get_design("single"), (2.0, 3.0, 4.0), "4"
COVERED, ACHIEVED, TIMES = (0.93, 0.97), (0.9, 1.2), (0.9, 1.1)
TRUTHS = (("known scatter", 1.0, False), ("scatter x 1.5", 1.5, False), ("scatter drawn from the prior", 1.0, True))


def measure() -> Iterator[Row]:
    for name, factor, drawn in TRUTHS:
        for tolerance in (0.03, 0.01, 0.005):
            yield from repeated(name, factor, drawn, tolerance, RUNS)


def repeated(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """One sample, whose sets scatter about a ratio of 1 in logarithms of 0."""
    rng = np.random.default_rng(21)
    asked = Repeats(SINGLE, LOADS, 10.0, tolerance)
    plan = asked.allocation(SAMPLE)
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        ratios: list[float] = []
        while not (ratios and asked.has_enough(SAMPLE, len(ratios), ratios)) and len(ratios) < asked.most(SAMPLE):
            ratios += np.exp(each * rng.standard_normal(len(LOADS))).tolist()
        found = asked.answer(SAMPLE, ratios)
        deviations.append(math.log(found.ratio))
        us.append(found.u)
        inside += abs(deviations[-1]) <= found.budget.expanded()
        seconds += asked.costs.seconds(1, len(ratios), plan.dwell)
    what, covered = f"{name}, {tolerance:.1%}", inside / runs
    yield Row(f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}", f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
              COVERED[0] <= covered <= COVERED[1])  # fmt: skip
    achieved = float(np.std(deviations) / np.mean(us))
    yield Row(f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}", f"{ACHIEVED[0]:g} to {ACHIEVED[1]:g}",
              ACHIEVED[0] <= achieved <= ACHIEVED[1])  # fmt: skip
    over, known = seconds / runs / plan.seconds, factor == 1.0 and not drawn
    yield Row(f"{what}: bench time over the plan's", f"{over:.2f}", f"{TIMES[0]:g} to {TIMES[1]:g}" if known else "",
              TIMES[0] <= over <= TIMES[1] if known else None)  # fmt: skip
