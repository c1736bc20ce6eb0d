"""`measure modulus` keeps what it states: a small share of `tests/benchmarks/modulus_budget.py`."""

from __future__ import annotations

import pytest

from palpate.instrument.allocation.table import FIRST
from tests.benchmarks.modulus_bench import fast
from tests.benchmarks.modulus_budget import KINDS, asked, block
from tests.benchmarks.modulus_figures import Run
from tests.benchmarks.modulus_wire import compared
from tests.chance import plausible


@pytest.mark.slow
def test_drawn_ratios_are_those_of_the_bench_and_take_its_time() -> None:
    deviates, seconds, drawn = compared("mounting scatter 1 %", 0.06, 60e3, 5)
    assert plausible(deviates)
    assert seconds == pytest.approx(drawn, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "modulus"), [("scatter drawn", 500e3), ("mounting scatter 1 %", 120e3)])
def test_a_course_that_is_asked_seldom_ends_as_one_that_is_asked_after_every_set(kind: str, modulus: float) -> None:
    truth = KINDS[kind].truth(modulus, 4)
    measuring = asked(KINDS[kind], 0.04, truth)
    seldom, every = fast(measuring, truth), fast(measuring, truth, every=True)
    assert (seldom.points, seldom.seconds) == (every.points, every.seconds)


@pytest.mark.slow
def test_answers_scatter_as_they_state_and_take_no_longer_than_was_told() -> None:
    runs = [Run(*run) for run in block("scatter learned", 0.1, 500e3, range(40)).runs]
    freedom = FIRST - 1  # of the scatter of the first sets, which each run states
    assert plausible([run.error / run.stated for run in runs], freedom)
    assert sum(run.seconds <= run.bound_seconds for run in runs) >= 33  # of 40 at 95 %, less once in a thousand times


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["scatter x 1.5", "off the curve, references"])
def test_intervals_hold_a_truth_that_is_not_what_the_plan_assumes(kind: str) -> None:
    runs = [Run(*run) for run in block(kind, 0.2, 60e3, range(20)).runs]
    held = [run.absolute if kind.startswith("off") else run.scale for run in runs]
    assert sum(held) >= 15  # of 20 at 95 %, less once in three thousand times
