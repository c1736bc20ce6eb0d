"""What an interval is worth that rests on mountings of an earlier run, by what is counted of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from palpate.instrument.allocation.allocate import allocate
from palpate.instrument.allocation.lines import BudgetLine, RepeatUnit
from palpate.instrument.allocation.stopping import FIRST, answer, enough, first_sets
from palpate.instrument.uncertainty.budget import Between, between_groups
from tests.benchmarks.allocation import BENCH, FREEDOM, SCATTER, SENSITIVITY
from tests.benchmarks.row import Row

RUNS, MOUNTINGS, TOLERANCE, LEAST = 300, 3, 0.02, 0.93
SCATTERS = (0.0, 0.005, 0.01, 0.02)


# What a plan may count; the first is what plans do.
WAYS: dict[str, Callable[[Between], float]] = {
    "their means": lambda found: found.means_u,
    "their means less the sets' part": lambda found: found.u,
    "that only where it is told": lambda found: found.u if found.significant else 0.0,
}


def measure() -> Iterator[Row]:
    for scatter in SCATTERS:
        for name, counts in WAYS.items():
            yield counted(scatter, name, counts, RUNS)


def counted(scatter: float, name: str, counts: Callable[[Between], float], runs: int) -> Row:
    """Coverage and time of runs that plan by an earlier run's three mountings of ten sets."""
    rng = np.random.default_rng(3)
    held, seconds = 0, []
    for _ in range(runs):
        shifts = scatter * rng.standard_normal((MOUNTINGS, 1))
        earlier = between_groups(np.exp(shifts + SCATTER * rng.standard_normal((MOUNTINGS, FIRST))).tolist())
        deviation, half, taken = run(scatter, counts(earlier), rng)
        held += abs(deviation) <= half
        seconds.append(taken)
    covered = held / runs
    what = f"{TOLERANCE:.0%}, mountings scatter by {scatter:.1%}, counted are {name}: intervals that hold; time"
    goal, met = (f">= {LEAST:.0%}", covered >= LEAST) if name == "their means" else ("", None)
    return Row(what, f"{covered:.1%}; {np.mean(seconds):.0f} s", goal, met)


def run(scatter: float, known: float, rng: np.random.Generator) -> tuple[float, float, float]:
    """Deviation from the truth, half-width of the interval, and bench time of a run that stops by itself."""
    lines = [
        BudgetLine("gain scatter", SENSITIVITY * SCATTER, RepeatUnit.SET, FREEDOM),
        BudgetLine("noise", SENSITIVITY * 1e-3, RepeatUnit.SECOND),
        *([BudgetLine("mounting", SENSITIVITY * known, RepeatUnit.MOUNTING, MOUNTINGS - 1)] if known else []),
    ]
    plan = allocate(lines, BENCH, TOLERANCE, fewest=FIRST)
    ratios: list[list[float]] = []
    while not (verdict := enough(lines, BENCH, TOLERANCE, plan, SENSITIVITY, ratios)).why:
        wanted = verdict.sets // verdict.mountings if ratios else first_sets(plan)
        if not ratios or len(ratios[-1]) >= wanted:
            ratios.append([])
            mounted = scatter * rng.standard_normal()
        more = wanted - len(ratios[-1])
        ratios[-1] += np.exp(mounted + SCATTER * rng.standard_normal(more)).tolist()
    found = answer(lines, plan, SENSITIVITY, ratios)
    taken = BENCH.seconds(len(ratios), sum(map(len, ratios)), plan.dwell)
    return SENSITIVITY * math.log(found.ratio), found.budget.expanded(), taken
