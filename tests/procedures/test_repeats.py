"""A tolerance that no load set can have is one of the mean of a sample: its loads are repeated until it is reached."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.loads.procedure import LoadSweep
from tests.procedures.conftest import Palpate

pytestmark = pytest.mark.usefixtures("own_store")

SINGLE = get_design("single")
REAL = Target(SINGLE, 10.0, nodes=1)


def sweep(tolerance: float, samples: tuple[str, ...] = ("2",)) -> LoadSweep:
    return LoadSweep(samples, (3.0, 4.0), tolerance=tolerance)


def test_a_tolerance_above_what_a_load_set_scatters_is_one_of_each_point() -> None:
    point, mean = sweep(0.05).plan(REAL), sweep(0.04).plan(REAL)
    assert point.predicted.details["tolerance_of"] == "point"
    assert (len(point.steps), point.steps[0].dwell_s) == (2, None)
    assert mean.predicted.details["tolerance_of"] == "mean"
    assert mean.predicted.details["planned"]["2"]["sets"] == 10  # whole rounds of two loads
    assert mean.predicted.details["planned"]["2"]["binds"] == "gain scatter"
    assert [step.load_N for step in mean.steps[:4]] == [3.0, 4.0, 3.0, 4.0]


def test_four_times_the_sets_halve_the_uncertainty() -> None:
    counts = [sweep(u).plan(REAL).predicted.details["planned"]["2"]["sets"] for u in (0.01, 0.005, 0.0025)]
    assert counts == [18, 68, 272]


def test_films_whose_calibration_is_worse_than_the_tolerance_are_named_with_what_would_do() -> None:
    covariance = tuple(tuple(2e-4 if i == j else 0.0 for j in range(2)) for i in range(2))
    known = replace(REAL, design=replace(SINGLE, film_covariance=covariance, film_freedom=5.0))
    sweep(0.03).plan(known)
    with pytest.raises(RangeError, match="calibration leaves 2 % of its mean ratio, which no load set") as refused:
        sweep(0.02).plan(known)
    assert "palpate calibrate films" in str(refused.value)


def test_pick_up_that_is_worse_than_the_tolerance_is_named_with_what_would_do() -> None:
    moving = replace(REAL, design=SINGLE.with_pickup(0.005))
    sweep(0.03).plan(moving)
    with pytest.raises(RangeError, match="pick-up in step with the load leaves 2") as refused:
        sweep(0.02).plan(moving)
    assert "tie the films' cables down" in str(refused.value)


def test_the_time_of_the_plan_is_that_of_the_steps_of_the_planned_sets() -> None:
    plan = sweep(0.01, ("2", "5")).plan(REAL)
    planned = plan.predicted.details["planned"]
    first = [s.seconds_expected for s in plan.steps if int(s.what.rpartition(" ")[2]) <= planned[s.sample]["sets"]]
    assert len(first) == sum(each["sets"] for each in planned.values())
    assert plan.predicted.seconds == pytest.approx(sum(first), rel=1e-9)


@pytest.mark.slow
def test_a_run_repeats_the_loads_until_the_mean_has_the_tolerance_and_resumes_to_the_same(tmp_path: Path) -> None:
    def stop(done: int, _all: int, _what: str) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with palpate.open_bench(scene="thesis_single") as bench:
        whole = palpate.run(sweep(0.03), bench, out=tmp_path / "whole")
    (mean,) = whole.result.samples
    assert mean.relative_u == whole.result.achieved_u == whole.outcome["achieved_u"] <= 0.03
    assert mean.valid_points == 10 == len(whole.result.points)
    assert (whole.result.tolerance_of, whole.outcome["predicted_u"]) == ("mean", pytest.approx(0.0131, rel=0.01))
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(scene="thesis_single") as bench:
        palpate.run(sweep(0.03), bench, out=tmp_path / "cut", progress=stop)
    assert palpate.resume(tmp_path / "cut").run.digest() == whole.run.digest()


def test_the_command_says_of_what_the_tolerance_is(palpate: Palpate) -> None:
    words = ("sweep", "loads", "--samples", "2", "--loads", "3 N", "--tolerance")
    said = palpate(*words, "1 %", "--dry-run").out
    assert "1 % of the mean ratio of each sample, below the 4.1 % that one load set scatters" in said
    assert palpate(*words, "1 %", "--dry-run", "--json").object["tolerance_of"] == "mean"
    assert palpate(*words, "6 %", "--dry-run", "--json").object["tolerance_of"] == "point"


@pytest.mark.slow
def test_means_of_repeated_sets_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import TRUTHS, repeated

    rows = list(repeated(*TRUTHS[0], tolerance=0.01, runs=200))
    assert all(row.met is not False for row in rows), rows
