"""`calibrate films --tolerance`: loads are repeated on each tooth until its films are known well enough."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.errors import RangeError
from palpate.instrument.quantity import parse_tolerance
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.films import FilmSeries, PressedPoint

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


def pressed(gains: Sequence[float]) -> list[PressedPoint]:
    """Load sets on the tooth of the single sensor, whose tooth film has these gains [V/N]."""
    return [
        PressedPoint(1, 10.0, load, 20.0, load, 0.01, False, (gain * load, 0.01 * load), (1e-6, 1e-6), True, ())
        for gain, load in zip(gains, itertools.cycle(LOADS), strict=False)
    ]


def test_a_tooth_has_enough_after_a_whole_round_in_which_each_film_is_known() -> None:
    asked = series(0.04)
    assert asked.tolerance is not None
    repeats = asked.plan(replace(REAL, load_cell=THESIS_LOAD_CELL)).basis
    assert repeats is not None
    same = [1e-3, 1.01e-3] * 10
    assert [asked.has_enough(repeats, pressed(same[:count]), REAL.design) for count in (0, 9, 10, 11, 12)] == [
        False
    ] * 4 + [True]
    assert not asked.has_enough(
        repeats, pressed([1e-3, 1.3e-3] * 6), REAL.design
    )  # the tooth's film scatters, the base's does not


def test_what_the_load_cell_alone_exceeds_is_refused_and_what_would_do_is_said() -> None:
    with pytest.raises(RangeError, match="load cell leaves ±") as refused:
        series(0.008).plan(REAL)
    assert "palpate calibrate load-cell --runs 3" in str(refused.value)
    series(parse_tolerance(str(refused.value).split("--tolerance '")[1].split("'")[0])).plan(REAL)
    better = THESIS_LOAD_CELL.model_copy(update={"sensitivity_u": 1e-3, "zero_u": 1e-3, "covariance": 0.0})
    series(0.008).plan(replace(REAL, load_cell=better))


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
