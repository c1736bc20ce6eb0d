"""Is the front what it says? And what it rests on: digits of the hard cases, prices of effects.

Runs of the front are statistics alone: their ratios are drawn, with a scatter of sets and of mountings from the priors
of a plan or from elsewhere; plan, stopping rule and answer are the product's own.
"""

from __future__ import annotations

import itertools
import json
import math
import os
import shlex
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from random import Random
from typing import Any

import numpy as np
from click.testing import CliRunner
from rich.console import Console
from rich.progress import track
from scipy.special import fdtri, stdtrit

from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.stopping import answer, enough, first_sets, run_times
from palpate.instrument.allocation.table import MOST_SETS, Allocation, OutOfReach, RunOption, Table
from palpate.procedures.commands.root import palpate
from palpate.simulators.planning.plan import Question
from palpate.simulators.planning.settle import read_scene
from palpate.simulators.planning.weights import priced
from tests.benchmarks.common import Row, at_least, at_most, between, none
from tests.test_hard_cases import CASES

WORST = 0.02
SCENES = ("thesis_single", "noisy_lab", "thesis_common_base", "thesis_different_base", "humid_body", "unknown_curve")
BENCH = Costs(start=5.0, mounting=72.0, set=0.5, person=60.0)
SENSITIVITY, SCATTER, FREEDOM = 2.0, 0.041, 7.0  # of a modulus near 50 kPa; of the thesis' ratios
PRIOR, PRIOR_FREEDOM = 0.01, 2.0  # of mountings
TOLERANCES = (0.15, 0.1, 0.05, 0.03, 0.02)


@dataclass(frozen=True, slots=True)
class Truth:
    """How much mountings truly scatter in a run, and what is known of it before.

    Attributes:
        drawn: the true scatter of a run.
        known, freedom: what its plan counts.
        covered: least and greatest share of intervals that shall hold the truth.
    """

    name: str
    drawn: Callable[[np.random.Generator], float]
    known: float = PRIOR
    freedom: float = PRIOR_FREEDOM
    covered: tuple[float, float] = (0.92, 1.0)

    def lines(self) -> list[BudgetLine]:
        return [
            BudgetLine("gain scatter", SENSITIVITY * SCATTER, RepeatUnit.SET, FREEDOM),
            BudgetLine("noise", SENSITIVITY * 1e-3, RepeatUnit.SECOND),
            BudgetLine("mounting", SENSITIVITY * self.known, RepeatUnit.MOUNTING, self.freedom),
        ]


def from_prior(rng: np.random.Generator) -> float:
    return PRIOR * math.sqrt(PRIOR_FREEDOM / rng.chisquare(PRIOR_FREEDOM))


TRUTHS = (
    Truth("scatter of mountings drawn from the prior", from_prior, covered=(0.94, 0.96)),
    Truth("uniform, 0 to 2 %", lambda rng: rng.uniform(0, 0.02), covered=(0.95, 0.98)),
    *(
        Truth(f"{low:g} to {low + 0.5:g} %", lambda rng, low=low: rng.uniform(low, low + 0.5) / 100)
        for low in (0.0, 0.5, 1.0, 1.5)
    ),
    Truth("stated truly, 1 %", lambda _: 0.01, 0.01, math.inf, (0.94, 0.96)),
)


def front(trials: int = 200, runs: int = 100) -> Iterator[Row]:
    """Plans against an independent enumeration, and runs that stop by themselves."""
    yield settings(trials)
    yield advertised(trials)
    for truth in TRUTHS:
        yield from stopped(truth, runs)


def shown(count: int, what: str) -> Iterable[int]:
    """Numbers from 0 on, with a bar in the terminal: each row of this benchmark takes minutes."""
    return track(range(count), what, console=Console(stderr=True))


def setting(random: Random) -> tuple[list[RunOption], float]:
    """A random problem of a bench with three loads and two dwells, and a tolerance that some plan reaches."""
    scatter, noise = 10 ** random.uniform(-2.5, -0.7), 10 ** random.uniform(-4, -2)
    mounting, films = random.choice([0.0, 10 ** random.uniform(-3, -1.3)]), random.choice([0.0, 0.003])
    freedom = random.choice([7.0, 30.0, math.inf])
    costs = Costs(random.uniform(0, 30), random.uniform(5, 120), random.uniform(0.3, 5))
    ways = [
        RunOption(
            [
                BudgetLine("scatter", scatter, RepeatUnit.SET, freedom),
                BudgetLine("noise", noise / load, RepeatUnit.SECOND),
                BudgetLine("mounting", mounting, RepeatUnit.MOUNTING),
                BudgetLine("films", films, RepeatUnit.NOTHING),
            ],
            replace(costs, mounting=costs.mounting + 1.3 * load),
            dwell,
            load,
        )
        for load, dwell in itertools.product((2.0, 3.0, 4.0), (0.1, 0.4))
    ]
    best = min(half(way, 12, 60)[0] for way in ways)
    return ways, best * 10 ** random.uniform(0.02, 0.5)


def half(way: RunOption, mountings: int, each: int | np.ndarray) -> np.ndarray:
    """Half-width of the 95 % interval by Student's t, written anew: the sets' scatter is told by the first ones."""
    u = {line.name: line.u**2 for line in way.lines}
    of_sets = (u["scatter"] + u["noise"] / way.dwell) / (mountings * np.atleast_1d(each))
    whole = of_sets + u["mounting"] / mountings + u["films"]
    first = np.maximum(10, np.ceil(np.atleast_1d(each) / 2))
    known = math.isinf(way.lines[0].degrees_of_freedom)
    freedom = np.full(whole.shape, 1e9) if known else (first - 1) * (whole / of_sets) ** 2
    return stdtrit(np.minimum(freedom, 1e9), 0.975) * np.sqrt(whole)


def expected(each: np.ndarray, freedom: float) -> np.ndarray:
    """Sets that a mounting has on average, written anew: their variance over the known one is drawn from F."""
    if math.isinf(freedom):
        return each
    first = np.maximum(10, np.ceil(each / 2))
    drawn = fdtri(first[:, None] - 1, freedom, (np.arange(400) + 0.5) / 400)
    return np.maximum(first[:, None], np.ceil(each[:, None] * drawn)).mean(axis=1)


def quickest(ways: list[RunOption], tolerance: float, most: int = 61) -> float:
    """Least mean bench time, by trying all numbers of mountings and sets."""
    each, best = np.arange(10, 3000), math.inf
    sets = expected(each, ways[0].lines[0].degrees_of_freedom)
    for way, mountings in itertools.product(ways, range(1, most)):
        good = (half(way, mountings, each) <= tolerance) & (mountings * each <= MOST_SETS)
        if good.any():
            taken = way.costs.start + mountings * (way.costs.mounting + (way.costs.set + way.dwell) * sets[good])
            best = min(best, float(taken.min()))
    return best


def settings(count: int) -> Row:
    """Random settings of a bench, each by the table and by trying every plan."""
    random, worst = Random(20), 0.0
    for _ in shown(count, "settings"):
        ways, tolerance = setting(random)
        # Preferring the greater load costs 2 % at most by design; here all loads count alike.
        table = Table.of([replace(way, load=0.0) for way in ways], range(1, 61))
        worst = max(worst, table.for_tolerance(tolerance).mean / quickest(ways, tolerance) - 1)
    return at_most(f"worst plan of {count} settings over trying all", worst, WORST, "{:.2%}")


def advertised(count: int) -> Row:
    """Random objects, tolerances and scenes: is a plan of the front what its command plans, and is none refused?"""
    random, other = Random(21), []
    for _ in shown(count, "commands"):
        words = ["--modulus", f"{random.uniform(25, 110):.3g} kPa", "--scene", random.choice(SCENES)]
        words += random.choice([[], ["--load", f"{random.choice((2, 3, 4))} N"]])
        words += random.choice([[], [], ["--mounting-scatter", f"{random.choice((0, 0.5, 2))} %"]])
        words += random.choice([[], [], ["--frequency", "20 Hz"]])
        shown_front = said("accuracy", *words, "--tolerance", f"{random.uniform(2, 40):.3g} %")
        plans = [*shown_front["front"], *(each["plan"] for each in shown_front["targets"]), shown_front["asked"]]
        plan = random.choice([each for each in plans if each is not None])
        planned = said(*shlex.split(plan["command"])[1:], "--dry-run").get("planned", {})
        if any(planned.get(name) != plan[name] for name in ("load_N", "mountings", "sets", "dwell_s", "longest_s")):
            other.append(plan["command"])
    return none(
        f"commands of {count} random plans that plan something else, or are refused",
        len(other),
        ": ".join([str(len(other)), *other[:1]]),
    )


def said(*words: str) -> dict[str, Any]:
    """The JSON of a command; empty: it is refused."""
    found = CliRunner().invoke(palpate, [*words, "--json"])
    return json.loads(found.output) if found.exit_code == 0 else {}


@dataclass(frozen=True, slots=True)
class Ended:
    """One run: whether its interval holds the truth, its half-width, and its bench time [s]."""

    held: bool
    half: float
    seconds: float
    tolerance: float


def run(
    lines: list[BudgetLine],
    tolerance: float,
    plan: Allocation,
    mounted: float,
    longest: float,
    rng: np.random.Generator,
) -> Ended:
    """A run that stops by itself, or at the bound of its time; `mounted`: true scatter of its mountings."""
    each = SCATTER * math.sqrt(FREEDOM / rng.chisquare(FREEDOM))
    ratios: list[list[float]] = []
    while not (verdict := enough(lines, BENCH, tolerance, plan, SENSITIVITY, ratios)).why:
        wanted = verdict.sets // verdict.mountings if ratios else first_sets(plan)
        if ratios and len(ratios) >= plan.mountings and len(ratios[-1]) >= wanted:
            done = sum(map(len, ratios))
            if BENCH.seconds(len(ratios) + 1, done + 1, plan.dwell) > longest:
                break
        if not ratios or len(ratios[-1]) >= wanted:
            ratios.append([])
            about = mounted * rng.standard_normal()
        first = sum(map(len, ratios)) < first_sets(plan)  # later ones come in tenths of a mounting, to save time
        more = wanted - len(ratios[-1]) if first else min(wanted - len(ratios[-1]), max(1, wanted // 10))
        ratios[-1] += np.exp(about + each * rng.standard_normal(more)).tolist()
    found = answer(lines, plan, SENSITIVITY, ratios)
    reached = found.budget.expanded()
    seconds = BENCH.seconds(len(ratios), sum(map(len, ratios)), plan.dwell)
    return Ended(abs(SENSITIVITY * math.log(found.ratio)) <= reached, reached, seconds, tolerance)


def ended_runs(truth: Truth, tolerance: float, runs: int) -> list[Ended]:
    """Runs to a tolerance; none where no plan reaches it."""
    rng, lines = np.random.default_rng(20), truth.lines()
    try:
        plan = Table.of([RunOption(lines, BENCH, 0.1)], range(1, 61)).for_tolerance(tolerance)
    except OutOfReach:
        return []
    longest = run_times(lines, BENCH, tolerance, plan).longest
    return [
        run(lines, tolerance, plan, truth.drawn(rng), longest, rng)
        for _ in shown(runs, f"{truth.name}, ± {100 * tolerance:g} %")
    ]


def stopped(truth: Truth, runs: int) -> Iterator[Row]:
    """Cover, share of runs that reach their tolerance, and mean time over the predicted one."""
    groups = [some for tolerance in TOLERANCES if (some := ended_runs(truth, tolerance, runs))]
    ended = [each for some in groups for each in some]
    held = float(np.mean([each.held for each in ended]))
    what = f"{truth.name}, {len(ended)} runs"
    yield between(f"{what}: intervals that hold the truth", held, truth.covered, "{:.0%}", f"{held:.1%}")
    share = float(np.mean([each.half <= each.tolerance * (1 + 1e-9) for each in ended]))
    yield at_least(f"{what}: runs that reach their tolerance", share, 0.93, "{:.0%}", f"{share:.1%}")
    table, times = Table.of([RunOption(truth.lines(), BENCH, 0.1)], range(1, 61)), []
    for some in groups:
        plan = table.for_tolerance(some[0].tolerance)
        expected = run_times(truth.lines(), BENCH, some[0].tolerance, plan).mean
        times.append(float(np.mean([each.seconds for each in some])) / expected)
    yield Row(
        f"{what}: mean time over predicted, each tolerance", ", ".join(f"{ratio:.2f}" for ratio in times),
        "0.95 to 1.05", all(0.95 <= ratio <= 1.05 for ratio in times),
    )  # fmt: skip


# --- digits and prices ---------------------------------------------------------------------------------


def hard_cases() -> Iterator[Row]:
    """Digits of the hard cases, each beside a reference that shares no solver with it, the hardest first."""
    found = [(-math.log10(case.error()), case) for case in CASES]
    for digits, case in sorted(found, key=lambda each: each[0]):
        yield at_least(
            case.name,
            digits,
            case.least,
            "{:g}",
            f"{digits:.1f} digits beside {case.reference}; predicted: {case.predicted}",
        )


def prices() -> Iterator[Row]:
    """Whether prices of effects can be measured again: two campaigns of one scene, compared by their own uncertainties.

    Other work on the machine makes all prices larger, so that only an idle one tells; its load is told beside them.
    """
    scene, load = read_scene("everything"), os.getloadavg()[0]
    first, again = (priced(scene, Question()) for _ in range(2))
    apart = {}
    for name, a, b in ((name or "the whole", first[name], again[name]) for name in first):
        apart[f"a of {name}"] = (b.a_s - a.a_s) / math.hypot(a.u_a_s, b.u_a_s)
        apart[f"b of {name}"] = (b.b_s_per_s - a.b_s_per_s) / math.hypot(a.u_b_s_per_s, b.u_b_s_per_s)
        yield Row(f"price of {name}, ms; µs/s", " | ".join("; ".join(price.texts()) for price in (a, b)))
    worst = max(apart, key=lambda name: abs(apart[name]))
    yield at_most(
        f"{len(apart)} prices measured again, machine's load {load:.1f}: the farthest apart",
        abs(apart[worst]),
        3,
        "{:.1f} u",
        f"{worst}, {abs(apart[worst]):.1f} u",
    )
    near = sum(abs(z) < 2 for z in apart.values()) / len(apart)
    yield at_least("the same: within 2 u", near, 0.9, "{:.0%}")
