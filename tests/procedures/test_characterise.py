"""What a sensor can do is found from loads up and down and one that is held; also to a tolerance or within a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import palpate as package
from palpate import EstimateError, RangeError, get_design
from palpate.extend import Target
from palpate.instrument.allocation.lines import budget
from palpate.instrument.allocation.table import MOST_SETS
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.findings import film_forces
from palpate.instrument.quantity import parse_tolerance
from palpate.procedures.measurements.characterise import procedure as characterise
from palpate.procedures.measurements.characterise.procedure import READING, Characterisation, SlopeSets
from palpate.procedures.measurements.characterise.report import LOADING, Characteristic, FilmsPoint, evaluate
from palpate.procedures.steps.flags import CLIPPED
from tests.procedures.conftest import Palpate

SINGLE = get_design("single")
LOADS = (1.5, 2.0, 2.5, 3.0)
NOISE = 1e-5  # V, of a sample
NOISE_U = 0.06 * NOISE
LOAD_U = 0.05  # N
PEAK = 2.8e-5  # V, the greatest of the noise
QUANTITIES = [
    "signal-to-noise ratio", "peak signal-to-noise ratio", "force sensitivity", "resolution", "linearity",
    "zero-based linearity", "hysteresis", "dynamic range", "drift",
]  # fmt: skip


def point(direction: str, load: float, volts: float, time: float = 0.0) -> FilmsPoint:
    noise_u = NOISE * math.sqrt(8 / 250)
    return FilmsPoint(
        direction,
        time,
        load,
        load,
        LOAD_U,
        (0.1 * volts, volts),
        (noise_u,) * 2,
        (NOISE,) * 2,
        (NOISE_U,) * 2,
        20.0,
        (PEAK,) * 2,
        250,
        True,
        (),
    )


def measured(bend: float = 0.0, lag: float = 0.0, drift: float = 0.0) -> list[FilmsPoint]:
    """Points of a film of 70 mV/N with a bend [V/N2], a lag when unloading [V], and a relative drift a minute."""

    def volts(load: float) -> float:
        return 70e-3 * load + bend * load**2

    return [
        *(point("loading", load, volts(load)) for load in LOADS),
        *(point("unloading", load, volts(load) + lag) for load in LOADS[::-1]),
        *(point("holding", 2.0, volts(2.0) * (1 + drift * n / 2), 30.0 * n) for n in range(11)),
    ]


def rows(points: list[FilmsPoint], film: str = "total") -> dict[str, Characteristic]:
    found = evaluate(points, SINGLE, THESIS_LOAD_CELL, 1.0, force_limit=10.0)
    return {row.quantity: row for row in found.rows if row.film == film}


def test_a_straight_quiet_film_has_the_figures_of_its_noise() -> None:
    found = rows(measured())
    assert (list(found), found["force sensitivity"].value) == (QUANTITIES, pytest.approx(70e-3))
    known = THESIS_LOAD_CELL.sensitivity_u / THESIS_LOAD_CELL.sensitivity_mV_per_N
    by_loads = LOAD_U / math.sqrt(sum((load - sum(LOADS) / len(LOADS)) ** 2 for load in LOADS))
    assert found["force sensitivity"].u == pytest.approx(math.hypot(known, by_loads) * 70e-3, rel=0.01)
    resolution = 2 * NOISE * math.sqrt(8 / 250) / 70e-3
    assert (found["resolution"].value, found["dynamic range"].value) == (
        pytest.approx(resolution),
        pytest.approx(20 * math.log10(10.0 / resolution)),
    )
    assert "bench's force limit" in found["dynamic range"].how
    for name in ("linearity", "zero-based linearity", "hysteresis", "drift"):
        assert abs(found[name].value) < 1e-9
        assert found[name].u > 0


def test_a_bend_a_lag_and_a_drift_show_each_in_its_own_figure() -> None:
    span = 70e-3 * 1.5
    assert rows(measured(lag=1e-3))["hysteresis"].value == pytest.approx(1e-3 / span)
    assert rows(measured(lag=1e-3))["linearity"].value < 1e-9
    bent = rows(measured(bend=5e-3))
    assert bent["linearity"].value == pytest.approx(5e-3 * 0.25 / (span + 5e-3 * 4.5 * 1.5), rel=0.02)
    drifting = rows(measured(drift=0.01))["drift"]
    assert drifting.value == pytest.approx(0.01, rel=0.06)


def test_each_row_names_its_equation_and_section_and_is_what_they_say() -> None:
    found = rows(measured(bend=5e-3))
    loads = np.array(LOADS)
    volts = 70e-3 * loads + 5e-3 * loads**2
    slope, level = np.polyfit(loads, volts, 1)
    through_zero = (loads @ volts) / (loads @ loads)
    said = {
        "peak signal-to-noise ratio": ("greatest |residual|", "2.1.1", 20 * math.log10(volts[-1] / 2 / PEAK)),
        "force sensitivity": ("dV/dF", "2.1.2", slope),
        "linearity": ("V - a - b F", "2.1.5", np.abs(volts - level - slope * loads).max() / (slope * np.ptp(loads))),
        "zero-based linearity": (
            "V - c F", "2.1.5", np.abs(volts - through_zero * loads).max() / (through_zero * loads.max()),
        ),
    }  # fmt: skip
    for quantity, (equation, section, value) in said.items():
        assert equation in found[quantity].definition
        assert found[quantity].thesis.startswith(section)
        assert found[quantity].value == pytest.approx(value), quantity
    assert all(row.definition and row.thesis.startswith("2.1") for row in found.values())


def test_a_load_that_was_set_anew_while_holding_is_no_drift() -> None:
    points = measured(drift=0.01)
    held = len(points) - 11
    for n in range(held + 4, len(points)):
        points[n] = replace(points[n], voltages_V=tuple(1.01 * v for v in points[n].voltages_V))
    assert abs(rows(points)["drift"].value - 0.01) > 1e-3
    points[held + 4] = replace(points[held + 4], incidents=1)
    found = rows(points)["drift"]
    assert found.value == pytest.approx(0.01, rel=0.06)
    assert "over 180 s" in found.how


def test_a_cell_is_as_fine_as_a_single_tooth_tells_where() -> None:
    place = rows(measured(), film="")["spatial resolution"]
    assert (place.value, place.u) == (10e-3, pytest.approx(10e-3 / math.sqrt(12)))


def test_without_valid_points_there_is_an_error_that_says_so() -> None:
    flagged = [replace(p, valid=False, flags=(CLIPPED,)) if p.direction == LOADING else p for p in measured()]
    with pytest.raises(
        EstimateError,
        match=r"0 loads up and 11 points under the load that is held are valid, and 3 and 3 are needed\."
        r" clipped \(4\): a film's voltage exceeds the range of its converter; take a smaller load",
    ):
        rows(flagged)


def test_the_command_measures_each_film_and_gives_the_public_names(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(characterise, "DRIFT_POINTS", 3)
    arguments = ("--loads", "2 N, 3 N, 4 N", "--dwell", "0.2 s", "--drift-time", "2 s")
    result = palpate("characterise", *arguments, "--json", "--budget").object
    assert result.keys() >= {"films", "rows", "elsewhere", "points", "plot", "run", "simulated"}
    assert [(each["thesis"], each["command"]) for each in result["elsewhere"]] == [
        ("2.1.4", "palpate sweep frequency"),
        ("2.1.6", "palpate sweep temperature"),
    ]
    assert all(np.greater(p["noise_peak_V"], p["noise_V"]).all() for p in result["points"])
    assert [(row["film"], row["quantity"]) for row in result["rows"]] == [
        *((film, name) for film in ("rigid", "total") for name in QUANTITIES),
        ("", "spatial resolution"),
    ]
    assert [b["u"] for b in result["budgets"]] == [row["u"] for row in result["rows"]]
    assert [b["quantity"] for b in result["budgets"]] == [row["name"] for row in result["predicted_results"]]
    assert result["points"][6]["time_s"] > characterise.STANDING
    total = next(r for r in result["rows"] if (r["film"], r["quantity"]) == ("total", "force sensitivity"))
    assert abs(total["value"] - 68.6e-3) < 4 * max(total["u"], 0.03 * 68.6e-3)
    assert [p["direction"] for p in result["points"]] == [*3 * ["loading"], *3 * ["unloading"], *4 * ["holding"]]


def test_twice_the_input_range_of_the_nodes_adds_six_decibels_to_the_dynamic_range() -> None:
    decibels = [
        budget.value
        for volts in (5.0, 10.0)
        for budget in evaluate(measured(), SINGLE, THESIS_LOAD_CELL, 1.0, force_limit=1e6, widest=volts).budgets
        if budget.quantity == "dynamic range, total"
    ]
    assert decibels[1] - decibels[0] == pytest.approx(20 * math.log10(2))


def test_noise_that_differs_from_load_to_load_counts_by_its_scatter() -> None:
    points = measured()
    for number in range(len(LOADS)):
        larger = 1 + 0.3 * (number % 2)
        points[number] = replace(points[number], voltages_u=tuple(larger * u for u in points[number].voltages_u))
    of = {b.quantity: b for b in evaluate(points, SINGLE, THESIS_LOAD_CELL, 1.0, force_limit=10.0).budgets}
    of_noise = of["resolution, total"].components[-1]
    factors = np.array([1.0, 1.3, 1.0, 1.3])
    assert (of_noise.u, of_noise.degrees_of_freedom) == (
        pytest.approx(factors.std(ddof=1) / factors.mean() / 2),
        len(LOADS) - 1,
    )


@pytest.mark.slow
@pytest.mark.usefixtures("own_store")
def test_figures_of_noise_scatter_as_they_say() -> None:
    found = []
    for seed in range(1, 13):
        with package.open_bench(scene="thesis_single", seed=seed) as bench:
            asked = characterise.Characterisation(loads=(3.5, 4.0, 4.5), drift_time=3.0)
            found.append(package.run(asked, bench).result.rows)
    for rows_of in zip(*found, strict=True):
        if rows_of[0].quantity in ("signal-to-noise ratio", "peak signal-to-noise ratio", "drift"):
            stated = math.sqrt(np.mean([row.u**2 for row in rows_of]))
            scatter = np.std([row.value for row in rows_of], ddof=1)
            assert 0.6 < scatter / stated < 1.5, f"{rows_of[0].quantity}, {rows_of[0].film}: {scatter / stated:.2f}"


# --- `characterise --tolerance` and `--time`: the loads go up until every film's sensitivity is --------


pytestmark = pytest.mark.usefixtures("own_store")

REAL = Target(get_design("single"), 10.0, nodes=1)
ROUND = (2.0, 3.0, 4.0)
ASKED = Characterisation(loads=ROUND, dwell=0.2, drift_time=2.0, tolerance=0.07)


def repeats(tolerance: float | None = 0.07, time: float | None = None) -> Sequence[SlopeSets]:
    found = replace(ASKED, tolerance=tolerance, time=time).plan(replace(REAL, load_cell=THESIS_LOAD_CELL)).basis
    assert found is not None
    return found


def has_enough(points: Sequence[FilmsPoint]) -> bool:
    return ASKED.has_enough(repeats(), points)


def rounds(count: int, apart: float, seconds: float = 3.0) -> list[FilmsPoint]:
    """Rounds of loads whose gains are off by some share, up and down in turn."""
    found = []
    for number in range(count * len(ROUND)):
        load = ROUND[number % len(ROUND)]
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
    at_one_load = [replace(point, valid=point.load_N == ROUND[0]) for point in rounds(12, 0.0)]
    assert not has_enough(at_one_load)
    assert repeats()[0].line(at_one_load) is None


def test_a_plan_for_a_time_has_the_rounds_that_a_run_makes_of_it() -> None:
    each = repeats()[0].costs.set + ASKED.dwell
    two = repeats()[0].costs.start + 2 * len(ROUND) * each
    sets = [repeats(None, two + spare)[0].plan.sets for spare in (0.9, 1.1)]
    assert sets == [len(ROUND), 2 * len(ROUND)]
    least = repeats()[0].costs.start + len(ROUND) * each
    assert repeats(None, least + 1e-6)[0].plan.sets == len(ROUND)
    with pytest.raises(RangeError, match="too short"):
        replace(ASKED, tolerance=None, time=least - 1e-6).plan(REAL)
    with pytest.raises(
        RangeError, match="holds more than 10000 load sets on the way up, the most of a run; give less time"
    ):
        replace(ASKED, tolerance=None, time=7.2e6).plan(REAL)


def test_sets_that_agree_by_chance_leave_what_readings_and_noise_do() -> None:
    asked, points = repeats()[0], rounds(4, 1e-9)
    least = budget([line for line in asked.lines if line.name in (film_forces.NOISE, READING)], 1, len(points), 0.2)
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
    assert (palpate("calibrate", "load-cell", "--tolerance", "0.707 %").status, palpate(*asked).status) == (0, 0)


@pytest.mark.slow
def test_a_run_stops_at_its_tolerance_or_at_its_time_and_says_which(tmp_path: Path) -> None:
    with package.open_bench(scene="thesis_single") as bench:
        whole = package.run(ASKED, bench, out=tmp_path / "whole")
    assert whole.result.stopped == "± 7 % reached"
    assert whole.outcome["achieved_u"] < max(half for _, half in whole.result.sensitivities) <= 0.07
    with package.open_bench(scene="thesis_single") as bench:
        short = package.run(replace(ASKED, time=140.0), bench, out=tmp_path / "short")
    assert short.outcome["achieved_seconds"] is not None
    assert 130 < short.outcome["achieved_seconds"] <= 140
    assert short.result.stopped.startswith("± 7 % NOT REACHED within 140 s: ")


@pytest.mark.slow
def test_sensitivities_and_ratios_hold_the_truth_as_often_as_they_say() -> None:
    from tests.benchmarks.repeats import OFFSETS, TRUTHS, noisy, sloped

    rows = [*sloped(*TRUTHS[0], tolerance=0.03, runs=150), *noisy(*OFFSETS[0], runs=150)]
    assert all(row.met is not False for row in rows), rows
