"""Plans against brute force, and Monte Carlo of runs that stop by themselves: coverage, uncertainty, time."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from random import Random

import numpy as np

from palpate.instrument.allocation.allocate import allocate, allocate_time
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.preparations import prepare
from palpate.instrument.allocation.purchase import RunOption
from palpate.instrument.allocation.stopping import FIRST, answer, enough, first_sets
from palpate.instrument.allocation.times import times
from tests.benchmarks.row import Row
from tests.instrument.test_allocation import cheapest, setting
from tests.instrument.test_preparations import problem, quickest

SETTINGS, WORST, SLOWEST = 300, 0.01, 5.0  # settings; relative distance; ms
RUNS = 2000
COVERED, ACHIEVED, TIMES, BELOW = (0.93, 0.97), (0.9, 1.2), (0.9, 1.1), 0.95
BENCH = Costs(start=4.0, mounting=93.0, set=1.7, person=60.0)
SENSITIVITY, SCATTER, FREEDOM = 2.0, 0.041, 7  # of a modulus near 50 kPa; of the thesis' ratios
TOLERANCES = (0.2, 0.1, 0.05, 0.02, 0.01)
MOST = 10_000  # sets of a run


@dataclass(frozen=True, slots=True)
class Truth:
    """How much sets and mountings truly scatter, and what is known of it before the run."""

    name: str
    sets: float = SCATTER
    mountings: float = 0.0
    drawn: bool = False  # the scatter of sets is drawn from what the prior leaves open
    freedom: float = FREEDOM
    mountings_known: float | None = None
    wanted: tuple[float, float] = ACHIEVED

    def lines(self) -> list[BudgetLine]:
        known = self.mountings if self.mountings_known is None else self.mountings_known
        return [
            BudgetLine("gain scatter", SENSITIVITY * SCATTER, RepeatUnit.SET, self.freedom),
            BudgetLine("noise", SENSITIVITY * 1e-3, RepeatUnit.SECOND),
            BudgetLine("mounting", SENSITIVITY * known, RepeatUnit.MOUNTING),
        ]


TRUTHS = (
    Truth("known scatter", freedom=math.inf, wanted=(0.9, 1.1)),
    Truth("learned scatter"),
    Truth("scatter drawn from the prior", drawn=True),
    Truth("scatter x 1.5", sets=1.5 * SCATTER),
    Truth("scatter x 0.67", sets=0.67 * SCATTER),
    Truth("mounting scatter of 1 %", mountings=0.01),
    Truth("mounting scatter of 2 %", mountings=0.02),
)


def measure() -> Iterator[Row]:
    yield from settings(SETTINGS)
    yield from prepared(SETTINGS)
    for truth in TRUTHS:
        for tolerance in TOLERANCES:
            yield from stopped(truth, tolerance, RUNS)


def settings(count: int) -> Iterator[Row]:
    """Random settings of a bench, each by the plan and by trying every other."""
    random, worst, slowest = Random(20), 0.0, 0.0
    for _ in range(count):
        lines, costs, tolerance = setting(random)
        start = time.process_time()
        found = allocate(lines, costs, tolerance)
        allocate_time(lines, costs, found.seconds * 1.01)
        slowest = max(slowest, 1e3 * (time.process_time() - start))
        worst = max(worst, found.seconds / cheapest(lines, costs, tolerance) - 1)
    yield Row(f"worst plan of {count} settings over brute force", f"{worst:.3%}", f"<= {WORST:.0%}", worst <= WORST)
    yield Row("slowest of these plans, for a tolerance and for a time", f"{slowest:.2f} ms", f"<= {SLOWEST:g} ms",
              slowest <= SLOWEST)  # fmt: skip


def prepared(count: int) -> Iterator[Row]:
    """Random benches with films and references that may be calibrated, and two frequencies or nine ways of the run."""
    for among, ways_of in (("frequency", list), ("nine loads and dwells", nine)):
        random, worst, slowest = Random(20), 0.0, 0.0
        for _ in range(count):
            two, preparations, tolerance = problem(random)
            ways = ways_of(two)
            start = time.process_time()
            found = prepare(ways, tolerance, preparations)
            slowest = max(slowest, 1e3 * (time.process_time() - start))
            worst = max(worst, found.seconds / quickest(ways, preparations, tolerance) - 1)
        what = f"{count} settings with film points, references and {among}"
        yield Row(f"worst plan of {what}", f"{worst:.3%}", f"<= {WORST:.0%}", worst <= WORST)
        yield Row("slowest of these plans", f"{slowest:.2f} ms", f"<= {SLOWEST:g} ms", slowest <= SLOWEST)


def nine(ways: Sequence[RunOption]) -> list[RunOption]:
    """The first way at three loads and three dwells, as `measure modulus` has them."""
    lines, costs, shortest = ways[0].lines, ways[0].costs, ways[0].shortest
    return [
        RunOption(
            [replace(line, u=line.u * fitted / load) if line.per is RepeatUnit.SECOND else line for line in lines],
            replace(costs, set=costs.set * (1 + load / 100)),
            cycles * shortest,
        )
        for load in (1, 1.5, 2)
        for cycles, fitted in ((1, 1.38), (2, 1.05), (4, 1.01))
    ]


@dataclass(frozen=True, slots=True)
class Ended:
    """One run: its answer's deviation from the truth, its interval, and what it took."""

    deviation: float
    u: float
    half: float
    sets: int
    seconds: float


def run(truth: Truth, tolerance: float, rng: np.random.Generator) -> Ended:
    """A run that stops by itself."""
    lines = truth.lines()
    plan = allocate(lines, BENCH, tolerance, fewest=FIRST)
    each = truth.sets * math.sqrt(truth.freedom / rng.chisquare(truth.freedom)) if truth.drawn else truth.sets
    ratios: list[list[float]] = []
    while not (verdict := enough(lines, BENCH, tolerance, plan, SENSITIVITY, ratios)).why:
        wanted = verdict.sets // verdict.mountings if ratios else first_sets(plan)
        if not ratios or len(ratios[-1]) >= wanted:
            ratios.append([])
            mounted = truth.mountings * rng.standard_normal()
        more = wanted - len(ratios[-1])
        ratios[-1] += np.exp(mounted + each * rng.standard_normal(more)).tolist()
    found = answer(lines, plan, SENSITIVITY, ratios)
    half = found.budget.expanded()
    taken = BENCH.seconds(verdict.mountings, verdict.sets, plan.dwell)
    return Ended(SENSITIVITY * math.log(found.ratio), found.u, half, verdict.sets, taken)


def stopped(truth: Truth, tolerance: float, runs: int) -> Iterator[Row]:
    """Coverage, achieved over predicted uncertainty, time over its prediction, and the bound of time."""
    rng = np.random.default_rng(20)
    lines = truth.lines()
    plan = allocate(lines, BENCH, tolerance, fewest=FIRST)
    taken = times(lines, BENCH, tolerance, plan, (first_sets(plan), MOST))
    ended = [run(truth, tolerance, rng) for _ in range(runs)]
    covered = float(np.mean([abs(each.deviation) <= each.half for each in ended]))
    achieved = float(np.std([each.deviation for each in ended]) / np.mean([each.u for each in ended]))
    seconds = float(np.mean([each.seconds for each in ended]) / taken.mean)
    within = float(np.mean([each.seconds <= taken.longest for each in ended]))
    sets = float(np.mean([each.sets for each in ended]))
    what = f"{truth.name}, {tolerance:.0%}"
    yield Row(f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}", f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
              COVERED[0] <= covered <= COVERED[1])  # fmt: skip
    low, high = truth.wanted
    yield Row(f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}", f"{low:g} to {high:g}",
              low <= achieved <= high)  # fmt: skip
    low, high = TIMES
    yield Row(f"{what}: mean bench time over predicted; sets", f"{seconds:.2f}; {sets:.1f}", f"{low:g} to {high:g}",
              low <= seconds <= high)  # fmt: skip
    yield Row(f"{what}: runs below the bound of bench time", f"{within:.1%}", f">= {BELOW:.0%}", within >= BELOW)
