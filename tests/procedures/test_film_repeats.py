"""`calibrate films --tolerance`: loads are repeated on each tooth until its films are known well enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate import FilmSeries, get_design
from palpate.extend import Target
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL

pytestmark = pytest.mark.usefixtures("own_store")

SINGLE = get_design("single")
REAL = Target(SINGLE, 10.0, nodes=1)
LOADS = (2.0, 3.0, 4.0)


def series(tolerance: float, frequencies: tuple[float, ...] = (10.0,)) -> FilmSeries:
    return FilmSeries(LOADS, frequencies, 0.2, tolerance=tolerance)


def test_sets_come_in_whole_rounds_and_are_shared_among_frequencies() -> None:
    one, two = (series(0.04, f).plan(REAL).predicted.details["planned"]["sets"] for f in ((10.0,), (10.0, 20.0)))
    assert (one, two) == (12, 24)  # ten at least at each frequency, in rounds of three
    assert series(0.015).plan(REAL).predicted.details["planned"]["binds"] == "scatter from one load set to the next"


@pytest.mark.parametrize("frequencies", [(10.0,), (20.0, 5.0)])
def test_the_time_of_the_plan_is_that_of_the_steps_of_the_planned_sets(frequencies: tuple[float, ...]) -> None:
    pair = Target(get_design("common_base"), 10.0, nodes=1)
    plan = series(0.02, frequencies).plan(pair)
    sets = plan.predicted.details["planned"]["sets"] // len(frequencies)
    first = [step.seconds_expected for step in plan.steps if int(step.what.rpartition(" ")[2]) <= sets]
    assert len(first) == 2 * len(frequencies) * sets
    assert plan.predicted.seconds == pytest.approx(sum(first), rel=1e-9)


@pytest.mark.slow
def test_a_run_ends_when_both_films_are_known_well_enough(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        done = palpate.run(series(0.03), bench, out=tmp_path / "run")
    asked = series(0.03)
    repeats = asked.plan(replace(REAL, load_cell=THESIS_LOAD_CELL)).basis
    assert repeats is not None
    ends = range(len(LOADS), len(done.result.points) + 1, len(LOADS))
    enough = [asked.has_enough(repeats, done.result.points[:end], REAL.design) for end in ends]
    assert enough == [False] * (len(ends) - 1) + [True]
    assert done.outcome["achieved_u"] == done.result.achieved_u < done.result.reached <= 0.03
    assert done.outcome["predicted_u"] == pytest.approx(0.0107, rel=0.01)


@pytest.mark.slow
def test_sensitivities_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import TRUTHS, pressed

    rows = list(pressed(*TRUTHS[0], tolerance=0.025, runs=200))
    assert all(row.met is not False for row in rows), rows
