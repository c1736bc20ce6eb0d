"""Monte Carlo of `softness --risk`: wrong orders, sets and bench time, by the sets of a bench in one line each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.procedures.measurements.softness import Ranking, SoftnessPoint, SoftnessTest
from tests.benchmarks.row import Row

RUNS = 500
RISK, MOST = 0.05, 5
SINGLE = get_design("single")
SAMPLES = dict(SINGLE.thesis_force_ratio)
ALIKE = {name: 0.2 * (1 + 1e-9 * number) for number, name in enumerate(SAMPLES)}
PAIRS = {name: 0.15 * 1.3 ** (number // 2) * (1 + 1e-9 * number) for number, name in enumerate(SAMPLES)}
TRUTHS: tuple[tuple[str, Mapping[str, float], float, bool], ...] = (
    ("the thesis' six samples", SAMPLES, 1.0, False),
    ("the same, scatter x 1.5", SAMPLES, 1.5, False),
    ("the same, scatter x 0.67", SAMPLES, 0.67, False),
    ("the same, scatter drawn from the prior", SAMPLES, 1.0, True),
    ("six equal objects", ALIKE, 1.0, False),
    ("three pairs of equal objects", PAIRS, 1.0, False),
    ("three pairs of equal objects, scatter x 1.5", PAIRS, 1.5, False),
)


def measure(runs: int = RUNS) -> Iterator[Row]:
    for name, ratios, factor, drawn in TRUTHS:
        yield from ranked(name, ratios, factor, drawn, runs)


def ranked(name: str, truth: Mapping[str, float], factor: float, drawn: bool, runs: int) -> Iterator[Row]:
    """Runs whose sets scatter about the true ratios. Planned are those of the samples by the thesis' means."""
    rng = np.random.default_rng(20)
    objects = tuple(get_sample(each) for each in truth)
    test = SoftnessTest(objects, (3.0,), 1.0, 10.0, risk=RISK, sets=MOST)
    ranking = Ranking(SINGLE, test, RISK)
    planned = ranking.predicted()
    wrong, left, sets, seconds = 0, 0, 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        points: list[SoftnessPoint] = []
        for number in range(len(objects) * MOST):
            thing = objects[number // MOST].name
            if not ranking.has_enough(thing, points):
                ratio = truth[thing] * math.exp(each * rng.standard_normal())
                points.append(SoftnessPoint(thing, 3.0, 3.0, 0.01, ratio, each * ratio, 0.0, True, ()))
        found = ranking.ranked(points)
        pairs = {frozenset(pair.objects) for pair in found.not_told}
        means = {t: np.mean([math.log(p.force_ratio) for p in points if p.object == t]) for t in truth}
        names = sorted(truth, key=lambda t: truth[t])
        told = [(a, b) for n, a in enumerate(names) for b in names[n + 1 :] if frozenset((a, b)) not in pairs]
        wrong += any(means[a] > means[b] for a, b in told)
        left += bool(pairs)
        sets += len(points)
        seconds += math.fsum(ranking.costs.seconds(1, count, test.dwell) for count in found.sets.values())
    share = wrong / runs
    yield Row(f"{name}: runs with a wrong pair", f"{share:.1%}", f"<= {RISK:.0%}", share <= RISK)
    over = seconds / runs / planned.seconds
    asked = truth is SAMPLES and factor == 1.0
    yield Row(f"{name}: bench time over the predicted", f"{over:.3f}", "0.9 to 1.1" if asked else "",
              0.9 <= over <= 1.1 if asked else None)  # fmt: skip
    yield Row(f"{name}: runs that left a pair open; sets of each object",
              f"{left / runs:.0%}; {sets / runs / len(objects):.2f}", "", None)  # fmt: skip
