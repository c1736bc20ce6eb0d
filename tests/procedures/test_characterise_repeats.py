"""`characterise --tolerance` and `--time`: the loads go up until every film's sensitivity is known well enough."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate import RangeError, get_design
from palpate.extend import Target
from palpate.instrument.allocation.lines import budget
from palpate.instrument.allocation.table import MOST_SETS
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings.film_forces import NOISE
from palpate.instrument.quantity import parse_tolerance
from palpate.procedures.measurements.characterise.procedure import READING, Characterisation, SlopeSets
from palpate.procedures.measurements.characterise.report import FilmsPoint
from tests.procedures.conftest import Palpate

pytestmark = pytest.mark.usefixtures("own_store")

REAL = Target(get_design("single"), 10.0, nodes=1)
LOADS = (2.0, 3.0, 4.0)
ASKED = Characterisation(loads=LOADS, dwell=0.2, drift_time=2.0, tolerance=0.07)


def repeats(tolerance: float | None = 0.07, time: float | None = None) -> Sequence[SlopeSets]:
    found = replace(ASKED, tolerance=tolerance, time=time).plan(replace(REAL, load_cell=THESIS_LOAD_CELL)).basis
    assert found is not None
    return found


def has_enough(points: Sequence[FilmsPoint]) -> bool:
    return ASKED.has_enough(repeats(), points)


def rounds(count: int, apart: float, seconds: float = 3.0) -> list[FilmsPoint]:
    """Rounds of loads whose gains are off by some share, up and down in turn."""
    found = []
    for number in range(count * len(LOADS)):
        load = LOADS[number % len(LOADS)]
        volts = 0.07 * load * (1 + apart * (-1) ** (number // 2))
        found.append(FilmsPoint(
            "loading", 0.0, load, load, 0.03, (volts, volts), (1e-5,) * 2, (1e-5,) * 2, (1e-6,) * 2, 20.0,
            (3e-5,) * 2, 50, True, (), seconds=seconds,
        ))  # fmt: skip
    return found


def test_a_smaller_tolerance_takes_more_rounds_and_tells_each_figure() -> None:
    plans = [replace(ASKED, tolerance=u).plan(REAL).predicted for u in (0.1, 0.05, 0.025)]
    planned = [plan.details["planned"] for plan in plans]
    assert planned[0]["rounds"] == 4  # ten sets at least
    assert 3 * planned[1]["rounds"] < planned[2]["rounds"] < 5 * planned[1]["rounds"]  # four times, half the interval
    told = {row["name"]: row["u"] for row in plans[1].details["predicted_results"]}
    worst = max(told[f"force sensitivity, {film}"] for film in ("rigid", "total"))
    assert worst == pytest.approx(plans[1].u)
    assert 2 * worst < planned[1]["half"] <= 0.05
    details = Characterisation.plan(replace(ASKED, tolerance=None), REAL).predicted.details
    once = {row["name"]: row["u"] for row in details["predicted_results"]}
    assert told.keys() == once.keys()
    halved = told["peak signal-to-noise ratio, rigid"] / once["peak signal-to-noise ratio, rigid"]
    assert halved == pytest.approx(1 / math.sqrt(planned[1]["rounds"]), rel=0.1)
    worst = max(told[f"resolution, {film}"] for film in ("rigid", "total"))
    assert f"u of each resolution {100 * worst:.3g} %," in " ".join(plans[1].lines)


def test_the_first_rounds_decide_and_no_round_is_broken_off() -> None:
    assert has_enough(rounds(5, 0.02))
    assert not has_enough(rounds(5, 0.02)[:-1])
    assert not has_enough(rounds(3, 0.02))
    assert not has_enough(rounds(5, 0.1))
    assert has_enough(rounds(80, 0.1))
    assert not has_enough([replace(point, valid=False) for point in rounds(5, 0.02)])
    at_one_load = [replace(point, valid=point.load_N == LOADS[0]) for point in rounds(12, 0.0)]
    assert not has_enough(at_one_load)
    assert repeats()[0].line(at_one_load) is None


def test_a_plan_for_a_time_has_the_rounds_that_a_run_makes_of_it() -> None:
    each = repeats()[0].costs.set + ASKED.dwell
    two = repeats()[0].costs.start + 2 * len(LOADS) * each
    sets = [repeats(None, two + spare)[0].plan.sets for spare in (0.9, 1.1)]
    assert sets == [len(LOADS), 2 * len(LOADS)]
    least = repeats()[0].costs.start + len(LOADS) * each
    assert repeats(None, least + 1e-6)[0].plan.sets == len(LOADS)
    with pytest.raises(RangeError, match="too short"):
        replace(ASKED, tolerance=None, time=least - 1e-6).plan(REAL)
    with pytest.raises(
        RangeError, match="holds more than 10000 load sets on the way up, the most of a run; give less time"
    ):
        replace(ASKED, tolerance=None, time=7.2e6).plan(REAL)


def test_sets_that_agree_by_chance_leave_what_readings_and_noise_do() -> None:
    asked, points = repeats()[0], rounds(4, 1e-9)
    least = budget([line for line in asked.lines if line.name in (NOISE, READING)], 1, len(points), 0.2)
    found = asked.line(points)
    assert found is not None
    assert found.u == pytest.approx(least.u)
    assert asked.line(points[:2]) is None


def test_what_the_load_cell_alone_exceeds_is_refused_and_what_would_do_is_said() -> None:
    with pytest.raises(RangeError, match=r"load cell leaves ± 1\.1 %") as error:  # 1.96 · 0.54 %
        replace(ASKED, tolerance=0.01).plan(REAL)
    assert "palpate calibrate load-cell --tolerance '0.707 %'" in str(error.value)
    best = parse_tolerance(str(error.value).split("best now  --tolerance '")[1].split("'")[0])
    replace(ASKED, tolerance=best).plan(REAL)
    assert repeats(best)[0].most <= MOST_SETS
    better = THESIS_LOAD_CELL.model_copy(update={"sensitivity_u": 1e-3, "covariance": 0.0})
    replace(ASKED, tolerance=0.01).plan(replace(REAL, load_cell=better))


@pytest.mark.slow
def test_a_plan_counts_the_calibration_of_the_load_cell_that_its_refusal_asks_for(palpate: Palpate) -> None:
    asked = ("characterise", "--tolerance", "1 %", "--dry-run")
    told = palpate(*asked)
    assert told.status == 2
    assert "palpate calibrate load-cell --tolerance '0.707 %'" in told.complaint
    assert palpate("calibrate", "load-cell", "--tolerance", "0.707 %").status == 0
    assert palpate(*asked).status == 0


@pytest.mark.slow
def test_a_run_stops_at_its_tolerance_or_at_its_time_and_says_which(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        whole = palpate.run(ASKED, bench, out=tmp_path / "whole")
    assert whole.result.stopped == "± 7 % reached"
    assert whole.outcome["achieved_u"] < max(half for _, half in whole.result.sensitivities) <= 0.07
    with palpate.open_bench(scene="thesis_single") as bench:
        short = palpate.run(replace(ASKED, time=140.0), bench, out=tmp_path / "short")
    assert short.outcome["achieved_seconds"] is not None
    assert 130 < short.outcome["achieved_seconds"] <= 140
    assert short.result.stopped.startswith("± 7 % NOT REACHED within 140 s: ")


@pytest.mark.slow
def test_sensitivities_and_ratios_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import OFFSETS, TRUTHS, noisy, sloped

    rows = [*sloped(*TRUTHS[0], tolerance=0.03, runs=150), *noisy(*OFFSETS[0], runs=150)]
    assert all(row.met is not False for row in rows), rows
