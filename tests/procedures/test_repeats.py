"""A tolerance that no load set can have is one of the mean of a sample: its loads are repeated until it is reached."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.stats import t

import palpate
from palpate import LoadSweep, RangeError, UsageError, get_design
from palpate.extend import Target
from palpate.instrument.findings.film_forces import PRIOR_FREEDOM
from palpate.instrument.quantity import parse_tolerance
from palpate.testing import steps
from tests.procedures.conftest import Palpate, resumed_digest

pytestmark = pytest.mark.usefixtures("own_store")

SINGLE = get_design("single")
REAL = Target(SINGLE, 10.0, nodes=1)


def sweep(tolerance: float, samples: tuple[str, ...] = ("2",)) -> LoadSweep:
    return LoadSweep(samples, (3.0, 4.0), tolerance=tolerance)


def test_a_tolerance_above_what_a_load_set_scatters_is_one_of_each_point() -> None:
    half = t.ppf(0.975, PRIOR_FREEDOM) * SINGLE.ratio_scatter  # of one load set whose noise counts for nothing
    point, mean = sweep(1.01 * half).plan(REAL), sweep(0.99 * half).plan(REAL)
    assert (point.predicted.details["tolerance_for"], len(point.steps), point.steps[0].dwell_s) == ("point", 2, None)
    assert mean.predicted.details["tolerance_for"] == "mean"
    assert mean.predicted.details["planned"]["2"]["sets"] == 10  # whole rounds of two loads
    assert mean.predicted.details["planned"]["2"]["binds"] == "gain scatter"
    assert [step.load_N for step in mean.steps[:4]] == [3.0, 4.0, 3.0, 4.0]


@pytest.mark.parametrize("tolerance", [0.02, 0.01, 0.005])
def test_as_many_sets_are_planned_as_students_interval_needs_whose_scatter_the_first_half_tells(
    tolerance: float,
) -> None:
    plan = sweep(tolerance).plan(REAL).predicted.details["planned"]["2"]
    of_set = plan["u"] * math.sqrt(plan["sets"])
    assert of_set == pytest.approx(SINGLE.ratio_scatter, rel=0.01)  # noise counts for 1 % of the variance

    def half(sets: int) -> float:
        return float(t.ppf(0.975, max(10, math.ceil(sets / 2)) - 1) * of_set / math.sqrt(sets))

    assert plan["half"] == pytest.approx(half(plan["sets"]), rel=1e-6)  # U is Student's factor times u
    least = next(sets for sets in range(10, 1000, 2) if half(sets) <= tolerance)
    assert least <= plan["sets"] <= 1.02 * least + 2


def test_films_whose_calibration_is_worse_than_the_tolerance_are_named_with_what_would_do() -> None:
    covariance = tuple(tuple(2e-4 if i == j else 0.0 for j in range(2)) for i in range(2))
    known = replace(REAL, design=replace(SINGLE, film_covariance=covariance, film_freedom=5.0))
    half = math.ceil(1000 * t.ppf(0.975, 5) * 0.02) / 10  # of two films of 1.41 % each, together 2 %
    with pytest.raises(RangeError, match=f"films' calibration leaves ± {half:g} %, which no longer run") as refused:
        sweep(0.04).plan(known)
    best = parse_tolerance(str(refused.value).split("--tolerance '")[1].split("'")[0])
    sweep(best).plan(known)
    assert "palpate calibrate films" in str(refused.value)


def test_pick_up_that_is_worse_than_the_tolerance_is_named_with_what_would_do() -> None:
    moving = replace(REAL, design=SINGLE.with_pickup(0.005))
    sweep(0.06).plan(moving)
    with pytest.raises(RangeError, match="pick-up in step with the load leaves ± 5 %") as refused:
        sweep(0.04).plan(moving)
    assert "tie the films' cables down" in str(refused.value)


@pytest.mark.slow
def test_a_run_repeats_the_loads_until_the_mean_has_the_tolerance_and_resumes_to_the_same(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        whole = palpate.run(sweep(0.03), bench, out=tmp_path / "whole")
    (mean,) = whole.result.samples
    assert mean.relative_u == whole.result.achieved_u == whole.outcome["achieved_u"]
    (budget,) = whole.result.budgets
    assert budget.expanded() / budget.value == whole.result.reached <= 0.03
    assert mean.valid_points == len(whole.result.points)
    assert (whole.result.tolerance_for, whole.outcome["predicted_u"]) == ("mean", pytest.approx(0.0130, rel=0.01))
    assert whole.run.header["settings"]["tolerance_of"] == "U95"
    assert resumed_digest(sweep(0.03), "thesis_single", 3, tmp_path) == whole.run.digest()


def test_a_run_that_was_begun_with_a_tolerance_of_u_is_not_resumed_as_if_it_were_one_of_the_interval(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An older version's records do not say what a tolerance is under this name."""

    def stop(done: int, _all: int, _what: str) -> None:
        if done == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("palpate.procedures.engine.run.TOLERANCE_OF", "older")
    with pytest.raises(KeyboardInterrupt), palpate.open_bench(scene="thesis_single") as bench:
        palpate.run(sweep(0.03), bench, out=tmp_path / "old", listeners=[steps(stop)])
    monkeypatch.undo()
    with pytest.raises(UsageError, match='tolerance_of: null in the record, "U95" now'):
        palpate.resume(tmp_path / "old")


def test_the_command_says_of_what_the_tolerance_is(palpate: Palpate) -> None:
    words = ("sweep", "loads", "--samples", "2", "--loads", "3 N", "--tolerance")
    said = palpate(*words, "2 %", "--dry-run").out
    assert "± 2 % of the mean ratio of each sample; one load set scatters by u = 4.1 %" in said
    assert palpate(*words, "2 %", "--dry-run", "--json").object["tolerance_for"] == "mean"
    assert palpate(*words, "12 %", "--dry-run", "--json").object["tolerance_for"] == "point"


@pytest.mark.slow
def test_means_of_repeated_sets_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import TRUTHS, repeated

    rows = list(repeated(*TRUTHS[0], tolerance=0.02, runs=200))
    assert all(row.met is not False for row in rows), rows
