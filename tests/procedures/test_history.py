"""`palpate history`: control charts, drift and the date of the next calibration, over the runs of a store."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from palpate import read
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.records.record import Recorder
from tests.procedures.conftest import Palpate

STORE = Path("runs")
FIRST = datetime(2025, 1, 10, 8, tzinfo=UTC)
MONTH = timedelta(days=365.25 / 12)
RATIO = "force ratio of sample 1"
STEADY = (0.3, 0.301, 0.2995, 0.3002)
SERIAL = {"strain indicator at COM1 unit 1": "A-1"}


def stored(name: str, month: float, value: float, u: float = 1e-3, quantity: str = RATIO, **header: Any) -> None:
    """A complete run in the store, with one result."""
    began = {"started": (FIRST + month * MONTH).isoformat()}
    given = {"procedure": "sweep-loads", "simulated": False, "bench": 'name = "lab"', "devices": SERIAL, "settings": {}}
    budget = Budget(quantity, value, "", (Component("noise", u),))
    Recorder.create(STORE / name, given | began | header).finish("complete", {"budgets": [budget.summary()]})


def monthly(*values: float, **header: Any) -> None:
    for month, value in enumerate(values):
        stored(f"run-{month}", month, value, **header)


def series(palpate: Palpate, *words: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(palpate("history", RATIO, *words, "--json").out)["series"]
    return found


def test_a_steady_quantity_has_no_alarm_and_no_date(palpate: Palpate) -> None:
    monthly(*STEADY)
    (found,) = series(palpate)
    assert found["alarms"] == 0
    assert found["recalibrate"] is None
    assert found["drift_low"] < 0 < found["drift_high"]
    assert found["recalibrate_earliest"] > "2025-01-10"
    assert "no drift is shown" in palpate("history", RATIO).out


def test_a_drift_of_one_percent_a_month_is_alarmed_at_the_third_run(palpate: Palpate) -> None:
    monthly(0.3, 0.303, 0.306)
    (found,) = series(palpate, "--tolerance", "2 %")
    assert [bool(run["alarms"]) for run in found["runs"]] == [False, False, True]
    assert found["drift_per_month"] == pytest.approx(0.003, rel=1e-6)
    assert found["drift_u"] == pytest.approx(1e-3 / 2**0.5, rel=1e-6)  # of a line through three points: u over sqrt(2)
    assert found["tolerance"] == pytest.approx(0.02 * 0.303, rel=1e-9)
    due = FIRST + 0.02 * 0.303 / 0.003 * MONTH  # a sweep calibrates nothing, so the drift counts from the first run
    assert found["recalibrate"] == str(due.date())
    assert found["recalibrate_earliest"] < found["recalibrate"]
    assert "alarm" in palpate("history", RATIO).out


def test_the_residuals_count_the_uncertainty_of_each_run(palpate: Palpate) -> None:
    for month, (value, u) in enumerate([(0.3, 0.003), (0.306, 0.004), (0.312, 0.001)]):
        stored(f"run-{month}", month, value, u)
    (found,) = series(palpate)
    mean, weight = (0.3 / 9 + 0.306 / 16) / (1 / 9 + 1 / 16), 1 / 9 + 1 / 16
    expected = [0.0, 0.006 / 0.005, (0.312 - mean) / (1e-6 * (1 + 1 / weight)) ** 0.5]
    assert [run["residual"] for run in found["runs"]] == pytest.approx(expected, rel=1e-9)
    sums = [0.0, expected[1] - 1, expected[1] - 1 + expected[2] - 1]
    assert [run["high"] for run in found["runs"]] == pytest.approx(sums, rel=1e-9)


def test_a_fall_is_alarmed_by_the_other_sum(palpate: Palpate) -> None:
    monthly(0.3, 0.297, 0.294, 0.291)
    runs = series(palpate)[0]["runs"]
    assert "CUSUM" in runs[2]["alarms"]
    assert runs[2]["low"] > runs[2]["high"] == 0
    assert runs[3]["low"] == pytest.approx(-runs[3]["residual"] - 1)  # after an alarm the sum begins anew


def test_scatter_beyond_the_uncertainties_widens_the_interval(palpate: Palpate) -> None:
    monthly(0.3, 0.31, 0.29, 0.31, 0.30)
    (found,) = series(palpate)
    assert found["drift_high"] - found["drift_low"] > 2 * 1.96 * 4 * 1e-3 / 10**0.5
    assert found["recalibrate"] is None


def test_a_calibration_begins_anew_with_its_last_run(palpate: Palpate) -> None:
    monthly(0.3, 0.303, 0.306, procedure="calibrate-load-cell")
    (found,) = series(palpate, "--tolerance", "0.003")
    assert found["since"] == (FIRST + 2 * MONTH).isoformat()
    assert found["recalibrate"] == str((FIRST + 3 * MONTH).date())


@pytest.mark.parametrize(
    "other",
    [
        {"simulated": True, "scene": {"name": "lab"}},
        {"bench": 'name = "other"'},
        {"devices": {"strain indicator at COM1 unit 1": "A-2"}},
        {"settings": {"dwell": 2.0}},
        {"about": {"object": "lens"}},
        {"procedure": "measure-modulus"},
    ],
)
def test_unlike_runs_are_never_in_one_series(palpate: Palpate, other: dict[str, Any]) -> None:
    monthly(*STEADY)
    for month in range(2):
        stored(f"other-{month}", month, 0.5, **other)
    assert sorted(len(each["runs"]) for each in series(palpate)) == [2, 4]
    stored("third", 3.0, 0.5, **other)
    assert sorted(len(each["runs"]) for each in series(palpate)) == [3, 4]


def test_ports_of_the_same_devices_may_change(palpate: Palpate) -> None:
    stored("one", 0, 0.3)
    stored("two", 1, 0.3, devices={"strain indicator at COM7 unit 1": "A-1"})
    assert len(series(palpate)[0]["runs"]) == 2


def test_only_complete_runs_that_fit_count_and_a_single_one_is_told(palpate: Palpate) -> None:
    monthly(*STEADY, about={"batch": "B7"})
    Recorder.create(
        STORE / "begun",
        {"procedure": "sweep-loads", "simulated": False, "started": FIRST.isoformat(), "about": {"batch": "B7"}},
    ).close()
    stored("single", 5, 0.5, bench='name = "other"', about={"batch": "B7"})
    stored("else", 6, 0.9, about={"batch": "B8"})
    found = palpate("history", RATIO, "--where", "batch = B7", "--json").object
    assert [len(each["runs"]) for each in found["series"]] == [4]
    assert [each["run"] for each in found["left_out"]] == ["single"]


def test_a_column_counts_by_the_mean_of_its_points_and_only_where_all_are_valid(palpate: Palpate) -> None:
    words = ("--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.1 s", "--out", "swept", "--quiet")
    assert palpate("sweep", "loads", *words).status == 0
    run = read("swept")
    points = [{key: value for key, value in each.items() if key not in ("id", "bench_ns")} for each in run.points()]
    for month, valid in enumerate((True, True, False)):
        began = {"started": (FIRST + month * MONTH).isoformat()}
        recorder = Recorder.create(STORE / f"run-{month}", {**run.header, **began})
        for each in points:
            recorder.point({**each, "valid": valid}, {}, 1)
        recorder.finish("complete", {"budgets": []})
    found = palpate("history", "force_ratio", "--json").object
    assert [each["why"] for each in found["left_out"]] == ["2 points not valid"]
    for name in ("value", "u"):
        told = [each["force_ratio" if name == "value" else "force_ratio_u"] for each in points]
        assert [each[name] for each in found["series"][0]["runs"]] == pytest.approx([sum(told) / 2] * 2, rel=1e-12)
    assert "SIMULATED" in palpate("history", "force_ratio").out


# --- bad input -----------------------------------------------------------------------------------------


def test_an_unknown_quantity_is_refused_with_the_nearest_one(palpate: Palpate) -> None:
    monthly(*STEADY)
    said = palpate("history", "force ratio of sample 2")
    assert said.status == 2
    assert f"did you mean '{RATIO}'" in said.err


def test_a_condition_that_no_run_fulfils_is_told_as_such(palpate: Palpate) -> None:
    monthly(*STEADY)
    said = palpate("history", RATIO, "--where", "started > 2030")
    assert said.status == 2
    assert "no complete run is chosen" in said.err and "--where" in said.err and "unknown" not in said.err


def test_one_run_is_no_history(palpate: Palpate) -> None:
    stored("only", 0, 0.3)
    said = palpate("history", RATIO)
    assert said.status == 2
    assert "takes two complete runs under like conditions" in said.err
    assert "only: no other run" in said.err


def test_runs_of_one_moment_are_no_history(palpate: Palpate) -> None:
    stored("one", 0, 0.3)
    stored("two", 0, 0.3)
    assert "at another time" in palpate("history", RATIO).err


def test_without_uncertainty_there_is_no_history(palpate: Palpate) -> None:
    stored("one", 0, 0.3, u=0.0)
    stored("two", 1, 0.3, u=0.0)
    said = palpate("history", RATIO)
    assert said.status == 2
    assert "no standard uncertainty" in said.err


def test_a_run_of_a_time_to_come_is_refused(palpate: Palpate) -> None:
    monthly(*STEADY)
    stored("ahead", 12 * 500, 0.3)
    said = palpate("history", RATIO)
    assert said.status == 2
    assert "later than this computer's clock" in said.err
    assert len(series(palpate, "--where", "started <= 2026-01-01")[0]["runs"]) == 4


def test_a_run_that_began_before_its_calibration_was_made_is_left_out(palpate: Palpate) -> None:
    monthly(*STEADY, calibration={"created": "2025-01-10T08:00:00+00:00"})
    stored("back", 3.5, 0.3, calibration={"created": "2025-01-10T08:00:00+00:00"})
    stored("odd", 3.6, 0.3, calibration={"created": "not recorded"})
    assert len(series(palpate)[0]["runs"]) == 6
    stored("set-back", 3.7, 0.3, film_calibration={"created": "2026-01-10T08:00:00+00:00"})
    (left,) = palpate("history", RATIO, "--json").object["left_out"]
    assert left["run"] == "set-back" and "film calibration" in left["why"] and "clock was set back" in left["why"]


def test_runs_within_seconds_tell_no_drift_of_a_month(palpate: Palpate) -> None:
    minute = 60 / MONTH.total_seconds()
    for number, value in enumerate((0.3, 0.301, 0.2995)):
        stored(f"run-{number}", minute * number, value)
    (found,) = series(palpate)
    assert found["span_s"] == 120
    assert {found[name] for name in found if name.startswith(("drift", "recalibrate"))} == {None}
    said = palpate("history", RATIO).out
    assert "too short a span, 2 min 00 s" in said and "recalibrate    not known" in said


@pytest.mark.parametrize(("u", "tolerance", "told"), [(0.21, "1 %", True), (0.22, "1 %", False), (0.22, "0.31", True)])
def test_a_drift_is_told_if_its_interval_is_within_the_value_or_the_tolerance(
    palpate: Palpate, u: float, tolerance: str, told: bool
) -> None:
    """Of runs a month and two apart, the u of a line is theirs over the root of 2, and 95 % are 1.96 of it."""
    monthly(0.3, 0.3, 0.3, u=u)
    (found,) = series(palpate, "--tolerance", tolerance)
    assert (found["drift_high"] is not None) is told


@pytest.mark.parametrize(("tolerance", "why"), [("0", "not above 0"), ("1 N", "plain number"), ("200 %", "200 %")])
def test_a_tolerance_that_cannot_be_one_is_refused(palpate: Palpate, tolerance: str, why: str) -> None:
    monthly(*STEADY)
    said = palpate("history", RATIO, "--tolerance", tolerance)
    assert said.status == 2
    assert why in said.err


# --- the picture ---------------------------------------------------------------------------------------


def test_the_picture_has_bars_limits_and_alarms(palpate: Palpate, figures: list[Figure]) -> None:
    monthly(0.3, 0.303, 0.306)
    assert palpate("history", RATIO, "--out", "h.png", "--json").object["picture"] == str(Path("h.png").absolute())
    left, right = figures[0].axes
    assert [len(each.get_segments()) for each in left.collections] == [3]  # a bar for each value
    named = right.get_legend_handles_labels()[1]
    assert named == ["w", "CUSUM, high", "CUSUM, low", "alarm", "limits of w", "limits of CUSUM"]
    (alarms,) = [line for line in right.lines if line.get_label() == "alarm"]
    assert len(np.asarray(alarms.get_xdata())) == 1


def test_the_picture_names_each_history_once_and_tells_the_day(palpate: Palpate, figures: list[Figure]) -> None:
    for name, value in (("one", 0.3), ("two", 0.2)):
        for second in range(2):
            stored(f"{name}-{second}", second / 2.6e6, value, about={"object": name})
    palpate("history", RATIO, "--out", "h.png")
    left, right = figures[0].axes
    assert sorted(left.get_legend_handles_labels()[1]) == [
        f"sweep-loads on lab, object {name}" for name in ("one", "two")
    ]
    assert len(right.get_legend_handles_labels()[1]) == 6
    figures[0].draw_without_rendering()
    assert left.xaxis.get_offset_text().get_text().startswith("2025-Jan-10")


def test_a_picture_of_another_format_is_refused_before_the_runs_are_read(palpate: Palpate) -> None:
    assert "h.gif does not end in .png or .svg" in palpate("history", RATIO, "--out", "h.gif").complaint
