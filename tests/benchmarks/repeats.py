"""Monte Carlo of repeated load sets, for means of samples and for films: coverage, uncertainty, bench time."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from palpate.instrument.calibration.load_cell_fit import THESIS_LOAD_CELL
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.measurements.films.repeats import FilmRepeats
from palpate.procedures.measurements.films.result import PressedPoint
from palpate.procedures.measurements.loads.repeats import Repeats
from tests.benchmarks.row import Row

RUNS = 1000
SINGLE, LOADS, SAMPLE = get_design("single"), (2.0, 3.0, 4.0), "4"
COVERED, ACHIEVED, TIMES = (0.93, 0.97), (0.9, 1.2), (0.9, 1.1)
TRUTHS = (("known scatter", 1.0, False), ("scatter x 1.5", 1.5, False), ("scatter drawn from the prior", 1.0, True))


def measure() -> Iterator[Row]:
    for name, factor, drawn in TRUTHS:
        for tolerance in (0.03, 0.01, 0.005):
            yield from repeated(name, factor, drawn, tolerance, RUNS)
    for name, factor, drawn in TRUTHS:
        yield from pressed(name, factor, drawn, 0.012, RUNS)


def repeated(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """One sample, whose sets scatter about a ratio of 1 in logarithms of 0."""
    rng = np.random.default_rng(21)
    asked = Repeats(SINGLE, LOADS, 10.0, tolerance)
    plan = asked.allocation(SAMPLE)
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        ratios: list[float] = []
        while not (ratios and asked.has_enough(SAMPLE, len(ratios), ratios)) and len(ratios) < asked.most(SAMPLE):
            ratios += np.exp(each * rng.standard_normal(len(LOADS))).tolist()
        found = asked.answer(SAMPLE, ratios)
        deviations.append(math.log(found.ratio))
        us.append(found.u)
        inside += abs(deviations[-1]) <= found.budget.expanded()
        seconds += asked.costs.seconds(1, len(ratios), plan.dwell)
    what, covered = f"{name}, {tolerance:.1%}", inside / runs
    yield Row(f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}", f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
              COVERED[0] <= covered <= COVERED[1])  # fmt: skip
    achieved = float(np.std(deviations) / np.mean(us))
    yield Row(f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}", f"{ACHIEVED[0]:g} to {ACHIEVED[1]:g}",
              ACHIEVED[0] <= achieved <= ACHIEVED[1])  # fmt: skip
    over, known = seconds / runs / plan.seconds, factor == 1.0 and not drawn
    yield Row(f"{what}: bench time over the plan's", f"{over:.2f}", f"{TIMES[0]:g} to {TIMES[1]:g}" if known else "",
              TIMES[0] <= over <= TIMES[1] if known else None)  # fmt: skip


def pressed(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """A tooth that is pressed until its films' sensitivities have a tolerance; the load cell is drawn, too."""
    rng = np.random.default_rng(22)
    asked = FilmRepeats(SINGLE, THESIS_LOAD_CELL, LOADS, (10.0,), 1.0, tolerance)
    plan, cell, readings = asked.allocation(), asked.cell_u, np.array(LOADS)
    scatter = np.array([film.scatter for film in SINGLE.films]) * factor
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        common, points = cell * rng.standard_normal(), list[PressedPoint]()
        while not asked.has_enough(points) and len(points) < asked.most():
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
    covered, achieved = inside / runs, float(np.std(deviations) / np.mean(us))
    what = f"films, {name}, {tolerance:.1%}"
    yield Row(f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}", f"{COVERED[0]:.0%} to {COVERED[1]:.0%}",
              COVERED[0] <= covered <= COVERED[1])  # fmt: skip
    yield Row(f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}", f"{ACHIEVED[0]:g} to {ACHIEVED[1]:g}",
              ACHIEVED[0] <= achieved <= ACHIEVED[1])  # fmt: skip
    yield Row(f"{what}: bench time over the plan's", f"{seconds / runs / plan.seconds:.2f}", "", None)
