"""Monte Carlo of repeats, for means of samples, films, places and the load cell: coverage, uncertainty, bench time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields

import numpy as np

from palpate.instrument.allocation.table import FIRST
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, WeightRun, load_cell_curve
from palpate.instrument.models.influence import ERROR, tooth_shares
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.films import FilmSeries, PressedPoint
from palpate.procedures.measurements.load_cell.procedure import LOADS as CELL_LOADS
from palpate.procedures.measurements.load_cell.report import REPEATS
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.measurements.position import PositionPoint, PositionSweep, share_noise
from palpate.procedures.measurements.prospects import DISPLAY_NOISE
from tests.benchmarks.row import Row

RUNS = 1000
CALIBRATIONS = 8000  # of a load cell: what hold is near the goal, and chance is 0.3 %
SINGLE, LOADS, SAMPLE = get_design("single"), (2.0, 3.0, 4.0), "4"
COVERED, ACHIEVED, TIMES = (0.93, 0.97), (0.9, 1.2), (0.9, 1.1)
PLACES = ((2e-3, 2e-4), (10e-3, 1.8e-4), (22e-3, 1.8e-4))  # m; the tolerance of each is near the best there
BOUNDED = 0.93  # where most of the uncertainty has a bound, intervals hold more often than they say
SLOPES = (("10.1 steps from load to load", 0.0), ("any slope", 0.05))
TRUTHS = (("known scatter", 1.0, False), ("scatter x 1.5", 1.5, False), ("scatter drawn from the prior", 1.0, True))


def measure() -> Iterator[Row]:
    for name, factor, drawn in TRUTHS:
        for tolerance in (0.06, 0.02, 0.01):
            yield from repeated(name, factor, drawn, tolerance, RUNS)
    for name, factor, drawn in TRUTHS:
        yield from pressed(name, factor, drawn, 0.025, RUNS)
    for truth in TRUTHS:
        for place, tolerance in PLACES:
            yield from located(*truth, place, tolerance, RUNS)
    for name, off in SLOPES:
        for count in (1, 10):
            yield weighed(name, off, count, CALIBRATIONS)


def weighed(name: str, off: float, count: int, runs: int) -> Row:
    """The thesis' load cell, calibrated by so many runs of its weights; `off`: how far its slope may be off."""
    rng, load, step = np.random.default_rng(24), np.array(CELL_LOADS), THESIS_LOAD_CELL.resolution_mV
    inside = 0
    for _ in range(runs):
        slope = THESIS_LOAD_CELL.sensitivity_mV_per_N * rng.uniform(1 - off, 1 + off)
        true = slope * load + rng.uniform(0, step)
        shown = step * np.rint(
            (true + DISPLAY_NOISE * step * rng.standard_normal((count, 2, REPEATS, load.size))) / step
        )
        calibrated = [
            WeightRun(
                0.0, *up_down.mean(axis=1), repeats=REPEATS, scatter_mV=math.sqrt(up_down.var(axis=1, ddof=1).mean())
            )
            for up_down in shown
        ]
        found = load_cell_curve(load, calibrated, step, 1).sensitivity
        inside += abs(found.value - slope) <= coverage_factor(found.degrees_of_freedom) * found.u
    what = f"load cell, {name}, {counted(count, 'run')}: 95 % intervals that hold the sensitivity"
    return Row(what, f"{inside / runs:.1%}", f">= {BOUNDED:.0%}", inside / runs >= BOUNDED)


def repeated(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """One sample, whose sets scatter about a ratio of 1 in logarithms of 0."""
    rng = np.random.default_rng(21)
    repeats = LoadSweep((SAMPLE,), LOADS, tolerance=tolerance).plan(Target(SINGLE, 10.0, nodes=1)).basis
    assert repeats is not None
    asked = repeats[SAMPLE]
    plan = asked.plan
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        ratios: list[float] = []
        while not asked.is_enough(len(ratios), ratios) and len(ratios) < asked.most:
            ratios += np.exp(each * rng.standard_normal(len(LOADS))).tolist()
        found = asked.answer(ratios)
        deviations.append(math.log(found.ratio))
        us.append(found.u)
        inside += abs(deviations[-1]) <= found.budget.expanded()
        seconds += asked.costs.seconds(1, len(ratios), plan.dwell)
    what = f"{name}, {tolerance:.1%}"
    yield from held(what, deviations, us, inside)
    yield timed(what, seconds / runs / plan.seconds, factor == 1.0 and not drawn)


def pressed(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """A tooth that is pressed until its films' sensitivities have a tolerance; the load cell is drawn, too."""
    rng = np.random.default_rng(22)
    series = FilmSeries(LOADS, tolerance=tolerance)
    asked = series.plan(Target(SINGLE, 10.0, nodes=1, load_cell=THESIS_LOAD_CELL)).basis
    assert asked is not None
    plan, cell, readings = asked.plan, THESIS_LOAD_CELL.mean_curve_u(np.array(LOADS)), np.array(LOADS)
    scatter = np.array([film.scatter for film in SINGLE.films]) * factor
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        common, points = cell * rng.standard_normal(), list[PressedPoint]()
        while not series.has_enough(asked, points, SINGLE) and len(points) < asked.most:
            for load in readings:
                gains = tuple((load * (1 + each * rng.standard_normal(2))).tolist())
                points.append(PressedPoint(1, 10.0, load, 0.0, load, 0.0, False, gains, (0.0, 0.0), True, ()))
        gains = np.array([np.array(p.voltages_V) / p.load_N for p in points])[:, 0]
        by_scatter = float(gains.std(ddof=1)) / math.sqrt(len(gains))
        budget = Budget("sensitivity", 1.0, "", (
            Component("scatter", by_scatter, degrees_of_freedom=len(gains) - 1),
            Component("load cell", cell, degrees_of_freedom=THESIS_LOAD_CELL.degrees_of_freedom or math.inf),
        ))  # fmt: skip
        deviations.append(float(gains.mean()) - 1 + common)
        us.append(budget.u)
        inside += abs(deviations[-1]) <= budget.expanded()
        seconds += asked.costs.seconds(1, len(points), 1.0)
    what = f"films, {name}, {tolerance:.1%}"
    yield from held(what, deviations, us, inside)
    yield timed(what, seconds / runs / plan.seconds, False)


def located(name: str, factor: float, drawn: bool, place: float, tolerance: float, runs: int) -> Iterator[Row]:
    """A load at a place [m] that is found to a tolerance [m]: gains of all films and the table's errors are drawn.

    The gains correlate as the design says. The errors of the table are anywhere within their bound.
    """
    rng = np.random.default_rng(23)
    design, sample = get_design("common_base"), get_sample("1")
    sweep = PositionSweep((place,), tolerance=tolerance)
    repeats = sweep.plan(Target(design, 10.0, nodes=1)).basis
    assert repeats is not None
    asked = repeats[place]
    plan, expected = asked.plan, np.array(tooth_shares(design, sample, (place, design.cell[1] / 2)))
    noise = np.array(share_noise(design, expected.tolist(), 2.0)) / math.sqrt(plan.dwell)
    gains = np.array(design.scatter_triangle)
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = factor * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        true, points = np.maximum(expected + rng.uniform(-ERROR, ERROR, 2), 0.0), list[PositionPoint]()
        while not asked.are_enough(points) and len(points) < asked.most:
            for _ in range(1 if points else FIRST):
                left, right, base = 1 + each * gains @ rng.standard_normal(3)
                shares = true * (left, right) / base + noise * rng.standard_normal(2)
                points.append(_set_at(place, *shares.tolist()))
        found = asked.place(points)
        assert found is not None
        deviations.append(found.found_mm - 1e3 * place)
        us.append(found.found_u)
        inside += found.found_low_mm <= 1e3 * place <= found.found_high_mm
        seconds += asked.costs.seconds(1, len(points), plan.dwell)
    what = f"place {1e3 * place:g} mm, {name}, {1e3 * tolerance:g} mm"
    yield from held(what, deviations, us, inside, BOUNDED)
    yield timed(what, seconds / runs / plan.seconds, factor == 1.0 and not drawn)


def held(
    what: str, deviations: Sequence[float], us: Sequence[float], inside: int, least: float | None = None
) -> Iterator[Row]:
    """How many intervals hold the truth, and deviations from it over the stated uncertainties.

    Args:
        what: what was measured.
        deviations: result less truth, of each run.
        us: stated standard uncertainty of each run.
        inside: number of runs whose 95 % interval holds the truth.
        least: least share of them; None: `COVERED`.
    """
    covered, achieved = inside / len(us), float(np.std(deviations) / np.mean(us))
    goal = f"{COVERED[0]:.0%} to {COVERED[1]:.0%}" if least is None else f">= {least:.0%}"
    met = COVERED[0] <= covered <= COVERED[1] if least is None else covered >= least
    yield Row(f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}", goal, met)
    goal = f"{ACHIEVED[0]:g} to {ACHIEVED[1]:g}"
    met = ACHIEVED[0] <= achieved <= ACHIEVED[1]
    yield Row(f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}", goal, met)


def timed(what: str, over: float, known: bool) -> Row:
    """Bench time over that of the plan, which is promised where the scatter is as it was `known` before."""
    goal, met = (f"{TIMES[0]:g} to {TIMES[1]:g}", TIMES[0] <= over <= TIMES[1]) if known else ("", None)
    return Row(f"{what}: bench time over the plan's", f"{over:.2f}", goal, met)


def _set_at(place: float, left: float, right: float) -> PositionPoint:
    """A valid load set at a place [m], of which the shares alone count."""
    numbers = {each.name: 0.0 for each in fields(PositionPoint)}
    told = {"position_mm": 1e3 * place, "share_left": left, "share_right": right, "valid": True, "flags": ()}
    return PositionPoint(**(numbers | told))  # type: ignore[arg-type]
