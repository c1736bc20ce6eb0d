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
from tests.runs import made

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
    assert (found["alarms"], found["recalibrate"]) == (0, None)
    assert found["drift_low"] < 0 < found["drift_high"]
    assert found["recalibrate_earliest"] > "2025-01-10"
    assert "no drift is shown" in palpate("history", RATIO).out


@pytest.mark.parametrize("sign", [1, -1])
def test_a_drift_of_one_percent_a_month_is_alarmed_at_the_third_run(palpate: Palpate, sign: int) -> None:
    monthly(0.3, 0.3 + sign * 0.003, 0.3 + sign * 0.006, 0.3 + sign * 0.009)
    (found,) = series(palpate, "--tolerance", "2 %")
    runs, middle = found["runs"], 0.3 + sign * 0.0045
    assert [bool(run["alarms"]) for run in runs[:3]] == [False, False, True] and "CUSUM" in runs[2]["alarms"]
    assert found["drift_per_month"] == pytest.approx(sign * 0.003, rel=1e-6)
    assert found["drift_u"] == pytest.approx(1e-3 / 5**0.5, rel=1e-6)  # of a line through four points: u over sqrt(5)
    assert found["tolerance"] == pytest.approx(0.02 * middle, rel=1e-9)
    due = FIRST + 0.02 * middle / 0.003 * MONTH  # a sweep calibrates nothing, so the drift counts from the first run
    assert found["recalibrate_earliest"] < found["recalibrate"] == str(due.date())
    toward, other = ("high", "low") if sign > 0 else ("low", "high")
    assert runs[2][toward] > runs[2][other] == 0
    assert runs[3][toward] == pytest.approx(sign * runs[3]["residual"] - 1)  # after an alarm the sum begins anew
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


def test_scatter_beyond_the_uncertainties_widens_the_interval(palpate: Palpate) -> None:
    monthly(0.3, 0.31, 0.29, 0.31, 0.30)
    (found,) = series(palpate)
    assert found["drift_high"] - found["drift_low"] > 2 * 1.96 * 4 * 1e-3 / 10**0.5
    assert found["recalibrate"] is None


def test_a_calibration_begins_anew_with_its_last_run(palpate: Palpate) -> None:
    monthly(0.3, 0.303, 0.306, procedure="calibrate-load-cell")
    (found,) = series(palpate, "--tolerance", "0.003")
    due = str((FIRST + 3 * MONTH).date())
    assert (found["since"], found["recalibrate"]) == ((FIRST + 2 * MONTH).isoformat(), due)


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


def test_only_complete_runs_that_fit_count_and_a_single_one_is_told(palpate: Palpate) -> None:
    own = {"about": {"batch": "B7"}}
    monthly(*STEADY[:-1], **own)
    stored("moved", 3, 0.3, devices={"strain indicator at COM7 unit 1": "A-1"}, **own)  # its port may change
    begun = {"procedure": "sweep-loads", "simulated": False, "started": FIRST.isoformat(), **own}
    Recorder.create(STORE / "begun", begun).close()
    stored("single", 5, 0.5, bench='name = "other"', **own)
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
        made(STORE / f"run-{month}", {**run.header, **began}, [({**each, "valid": valid}, {}) for each in points])
    found = palpate("history", "force_ratio", "--json").object
    assert [each["why"] for each in found["left_out"]] == ["2 points not valid"]
    for name, column in (("value", "force_ratio"), ("u", "force_ratio_u")):
        mean = sum(each[column] for each in points) / 2
        assert [each[name] for each in found["series"][0]["runs"]] == pytest.approx([mean] * 2, rel=1e-12)
    assert "SIMULATED" in palpate("history", "force_ratio").out


# --- bad input -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("force ratio of sample 2",), f"did you mean '{RATIO}'"),
        ((RATIO, "--where", "started > 2030"), "no complete run is chosen"),
        ((RATIO, "--tolerance", "0"), "not above 0"),
        ((RATIO, "--tolerance", "1 N"), "plain number"),
        ((RATIO, "--tolerance", "200 %"), "200 %"),
        ((RATIO, "--out", "h.gif"), "h.gif does not end in .png or .svg"),
    ],
)
def test_what_cannot_be_asked_is_refused(palpate: Palpate, words: tuple[str, ...], told: str) -> None:
    monthly(*STEADY)
    said = palpate("history", *words).refusal
    assert told in said and ("--where" in said) == ("--where" in words)


@pytest.mark.parametrize(
    ("runs", "told"),
    [
        ({"only": (0, 0.3)}, "takes two complete runs under like conditions"),
        ({"only": (0, 0.3)}, "only: no other run"),
        ({"one": (0, 0.3), "two": (0, 0.3)}, "at another time"),
        ({"one": (0, 0.3, 0.0), "two": (1, 0.3, 0.0)}, "no standard uncertainty"),
    ],
)
def test_one_run_or_runs_of_one_moment_or_without_uncertainty_are_no_history(
    palpate: Palpate, runs: dict[str, tuple[float, ...]], told: str
) -> None:
    for name, given in runs.items():
        stored(name, *given)
    assert told in palpate("history", RATIO).refusal


def test_a_run_of_a_time_to_come_is_refused(palpate: Palpate) -> None:
    monthly(*STEADY)
    stored("ahead", 12 * 500, 0.3)
    assert "later than this computer's clock" in palpate("history", RATIO).refusal
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
    told = {found[name] for name in found if name.startswith(("drift", "recalibrate"))}
    assert (found["span_s"], told) == (120, {None})
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
    names = ("one", "two")
    for name in names:
        for second in range(2):
            stored(f"{name}-{second}", second / 2.6e6, 0.3, about={"object": name})
    palpate("history", RATIO, "--out", "h.png")
    left, right = figures[0].axes
    assert sorted(left.get_legend_handles_labels()[1]) == [f"sweep-loads on lab, object {name}" for name in names]
    assert len(right.get_legend_handles_labels()[1]) == 6
    figures[0].draw_without_rendering()
    assert left.xaxis.get_offset_text().get_text().startswith("2025-Jan-10")
