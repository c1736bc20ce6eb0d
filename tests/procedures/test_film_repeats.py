"""`calibrate films --tolerance`: loads are repeated on each tooth until its films are known well enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import palpate
from palpate.instrument.calibration.load_cell_fit import THESIS_LOAD_CELL
from palpate.instrument.errors import RangeError
from palpate.instrument.sensor.designs import get_design
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.films.procedure import FilmSeries

pytestmark = pytest.mark.usefixtures("own_store")

REAL = Target(get_design("single"), 10.0, nodes=1)
LOADS = (2.0, 3.0, 4.0)


def series(tolerance: float, frequencies: tuple[float, ...] = (10.0,)) -> FilmSeries:
    return FilmSeries(LOADS, frequencies, 0.2, tolerance=tolerance)


def test_sets_come_in_whole_rounds_and_are_shared_among_frequencies() -> None:
    one, two = (series(0.01, f).plan(REAL).predicted.told["planned"]["sets"] for f in ((10.0,), (10.0, 20.0)))
    assert (one, two) == (15, 24)  # ten at least at each frequency, in rounds of three
    assert series(0.007).plan(REAL).predicted.told["planned"]["sets"] == 45
    assert series(0.01).plan(REAL).predicted.told["planned"]["binds"] == "scatter from one load set to the next"


def test_what_the_load_cell_alone_exceeds_is_refused_and_what_would_do_is_said() -> None:
    with pytest.raises(RangeError, match="calibration of the load cell leaves") as refused:
        series(0.004).check(REAL)
    assert "palpate calibrate load-cell --runs 3" in str(refused.value)
    better = THESIS_LOAD_CELL.model_copy(update={"sensitivity_u": 1e-3, "zero_u": 1e-3, "covariance": 0.0})
    series(0.004).check(replace(REAL, load_cell=better))
    with pytest.raises(RangeError, match="above the limit of 10000"):
        series(0.0003).check(replace(REAL, load_cell=better))


@pytest.mark.slow
def test_a_run_ends_when_both_films_are_known_well_enough(tmp_path: Path) -> None:
    with palpate.open_bench(scene="thesis_single") as bench:
        done = palpate.run(series(0.015), bench, out=tmp_path / "run")
    assert len(done.result.points) == 12
    assert done.outcome["achieved_u"] == done.result.achieved_u <= 0.015
    assert done.outcome["predicted_u"] == pytest.approx(0.0107, rel=0.01)


@pytest.mark.slow
def test_sensitivities_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import TRUTHS, pressed

    rows = list(pressed(*TRUTHS[0], tolerance=0.012, runs=400))
    assert all(row.met is not False for row in rows), rows
