"""Calibrations before a run, and the run: the quickest whole, against trying every plan."""

import math
from collections.abc import Sequence
from dataclasses import replace
from random import Random

import numpy as np
import pytest

from palpate.instrument.allocation.allocate import BelowFloor, allocate
from palpate.instrument.allocation.lines import BudgetLine, Costs, RepeatUnit
from palpate.instrument.allocation.preparations import prepare
from palpate.instrument.allocation.purchase import Preparation, Purchase, RunOption

BENCH = Costs(start=4.0, mounting=75.0, set=0.5, person=60.0)
SCATTER, NOISE = BudgetLine("scatter", 0.08, RepeatUnit.SET), BudgetLine("noise", 0.002, RepeatUnit.SECOND)
VALIDATION, FILMS = BudgetLine("validation", 0.4, RepeatUnit.NOTHING), BudgetLine("films", 0.03, RepeatUnit.NOTHING)
REFERENCES = Preparation("validation", u=0.1, fixed=0.0, each=400.0, rest=0.03)
POINTS = Preparation("films", u=0.07, fixed=90.0, each=3.0, least=3)


def problem(random: Random) -> tuple[list[RunOption], list[Preparation], float]:
    """Ways of a run, such as frequencies, two preparations, and a tolerance that plans of a few units reach."""
    scatter, noise = 10 ** random.uniform(-3, -1), 10 ** random.uniform(-4, -1)
    mounting = random.choice([0.0, 10 ** random.uniform(-3, -1.3)])
    preparations = [
        Preparation("films", 10 ** random.uniform(-2.5, -1), random.uniform(0, 120), random.uniform(1, 10), least=3),
        Preparation(
            "validation", 10 ** random.uniform(-2.5, -1), random.uniform(-300, 60), random.uniform(50, 400), rest=0.005
        ),
    ]
    now = random.choice([0.01, 0.3])
    ways = []
    for _ in range(2):
        lines = [
            BudgetLine("scatter", scatter, RepeatUnit.SET),
            BudgetLine("mounting", mounting, RepeatUnit.MOUNTING),
            BudgetLine("noise", noise * random.uniform(1, 1.4), RepeatUnit.SECOND),
            BudgetLine("films", random.choice([0.002, 0.03]), RepeatUnit.NOTHING),
            BudgetLine("validation", now, RepeatUnit.NOTHING),
        ]
        costs = Costs(random.uniform(0, 30), random.uniform(5, 120), random.uniform(0.5, 5))
        ways.append(RunOption(lines, costs, random.choice([0.05, 0.1])))
    films, references = preparations
    k, n = random.randint(1, 4), random.randint(1, 12)
    left = mounting**2 / k + scatter**2 / (k * n) + noise**2 / (k * n * 10 ** random.uniform(-1, 0.3))
    left += films.u**2 / random.randint(3, 20) + references.u**2 / random.randint(1, 5) + references.rest**2
    return ways, preparations, math.sqrt(left)


def quickest(ways: Sequence[RunOption], preparations: Sequence[Preparation], tolerance: float) -> float:
    """Bench time of the quickest whole, by trying all numbers of units, mountings and sets."""
    films, references = preparations
    k, n = np.arange(1, 11)[:, None, None, None], np.arange(1, 61)[None, :, None, None]
    x, q = np.arange(films.least, 60)[None, None, :, None], np.arange(references.least, 14)[None, None, None, :]
    best = math.inf
    for way in ways:
        u = {line.name: line.u**2 for line in way.lines}
        for points in (x, None):
            for count in (q, None):
                left = tolerance**2 - u["mounting"] / k - u["scatter"] / (k * n)
                left = left - (u["films"] if points is None else films.u**2 / points)
                left = left - (u["validation"] if count is None else references.rest**2 + references.u**2 / count)
                before = 0.0 if points is None else films.fixed + films.each * points
                before = before + (0.0 if count is None else references.fixed + references.each * count)
                with np.errstate(divide="ignore"):
                    dwell = np.maximum(way.shortest, u["noise"] / left / (k * n))
                run = way.costs.start + way.costs.mounting * k + (way.costs.set + dwell) * k * n
                best = min(best, float(np.where(left > 0, before + run, math.inf).min()))
    return best


@pytest.mark.parametrize("seed", [0, 1, 16, 65])  # in the last two the best number of mountings is not the real one's
def test_no_numbers_of_units_mountings_and_sets_are_quicker_in_all(seed: int) -> None:
    ways, preparations, tolerance = problem(Random(seed))
    assert prepare(ways, tolerance, preparations).seconds <= quickest(ways, preparations, tolerance) * (1 + 1e-6)


def test_ways_that_cannot_be_the_quickest_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    ways, preparations, tolerance = problem(Random(1))
    noisier = [
        RunOption([replace(line, u=line.u * by) for line in way.lines], way.costs, way.shortest)
        for way in ways
        for by in (1.0, 1.02, 1.05, 1.1, 1.2)
    ]
    asked: list[int] = []

    def run(purchase: Purchase, mountings: int) -> tuple[float, int, float]:
        asked.append(mountings)
        return whole(purchase, mountings)

    whole = Purchase.run
    monkeypatch.setattr(Purchase, "run", run)
    best = prepare(ways, tolerance, preparations)
    alone = len(asked)
    asked.clear()
    assert prepare(noisier, tolerance, preparations).seconds == best.seconds
    assert len(asked) < 2 * alone  # of five times as many ways


def test_without_preparations_the_run_is_that_of_the_allocation() -> None:
    lines = [SCATTER, NOISE, BudgetLine("mounting", 0.04, RepeatUnit.MOUNTING)]
    found, alone = prepare([RunOption(lines, BENCH)], 0.02), allocate(lines, BENCH, 0.02)
    assert (found.mountings, found.sets, found.numbers) == (alone.mountings, alone.sets, {})
    assert found.seconds == found.run_seconds == pytest.approx(alone.seconds)


def test_what_binds_is_prepared_and_what_does_not_is_left_as_it_is() -> None:
    ways = [RunOption([SCATTER, NOISE, VALIDATION, FILMS], BENCH)]
    found = prepare(ways, 0.1, [REFERENCES, POINTS])
    assert found.numbers == {"validation": 2}
    assert found.seconds == pytest.approx(800 + found.run_seconds)
    assert prepare(ways, 0.5, [REFERENCES, POINTS]).numbers == {}
    both = prepare(ways, 0.055, [REFERENCES, POINTS]).numbers
    assert both["validation"] > 2
    assert both["films"] > 3


def test_the_quicker_of_two_ways_is_gone() -> None:
    lines = [SCATTER, NOISE]
    slow, quick = RunOption(lines, BENCH), RunOption(lines, Costs(4.0, 75.0, 0.2, 60.0))
    assert prepare([slow, quick], 0.01).way == 1
    assert prepare([quick, slow], 0.01).way == 0


def test_what_no_preparation_reaches_is_refused_by_the_line_that_binds() -> None:
    with pytest.raises(BelowFloor, match=r"validation leaves 0\.03") as caught:
        prepare([RunOption([SCATTER, VALIDATION], BENCH)], 0.03, [REFERENCES])
    assert caught.value.line == "validation"
