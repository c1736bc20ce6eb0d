"""Monte Carlo of a characterisation: sensitivities to a tolerance, figures of noise, and what the plan expects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, RANGE_VOLTS
from palpate.instrument.sensor.design import USUAL_NOISE
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.uncertainty.budget import Budget, Component
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.characterise.procedure import Characterisation
from palpate.procedures.measurements.characterise.report import HOLDING, LOADING, UNLOADING, FilmsPoint, evaluate
from palpate.procedures.measurements.prospects import reading_u
from tests.benchmarks.repeats import TRUTHS, held, timed
from tests.benchmarks.row import Row

RUNS = 1000
SINGLE, RIGID, TOTAL = get_design("single"), 0, 1
FORCE_LIMIT = 10.0  # N
TARGET = Target(SINGLE, FORCE_LIMIT, nodes=1)
CELL = THESIS_LOAD_CELL.sensitivity_u / THESIS_LOAD_CELL.sensitivity_mV_per_N
TIME = np.arange(250) / 250  # s, of a record
FREQUENCY = 10.0  # Hz
WHITE = USUAL_NOISE * math.sqrt(250 / 2)  # V, noise of a sample
STEPS = np.array([[min(RANGE_VOLTS)], [max(RANGE_VOLTS)]]) / FULL_SCALE_COUNTS  # V, of each film's range
FIGURES = "signal-to-noise ratio", "resolution"
EXPECTED = 0.8, 1.25  # stated over expected uncertainty, where offsets decay, as a plan expects it
OFFSETS = (("offsets stand still", 0.0), ("offsets decay", 0.01))  # over the amplitude


def measure() -> Iterator[Row]:
    for truth in TRUTHS:
        for tolerance in (0.06, 0.02):
            yield from sloped(*truth, tolerance, RUNS)
    for offset in OFFSETS:
        yield from noisy(*offset, RUNS)


def sloped(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """Rounds of loads until both films have a tolerance. Gains, readings of the loads and the load cell are drawn."""
    rng = np.random.default_rng(24)
    series = Characterisation(tolerance=tolerance)
    asked = series.plan(replace(TARGET, load_cell=THESIS_LOAD_CELL)).basis
    assert asked is not None
    plan, conditions = asked[0].plan, asked[0].of
    loads, off = np.array(conditions.loads), reading_u(THESIS_LOAD_CELL, 1.0)
    slopes = np.array([film.sensitivity * conditions.force(film, 1.0) for film in SINGLE.films])
    noise = np.array([conditions.noise(film) for film in SINGLE.films]).T
    scatter = factor * np.array([film.scatter for film in SINGLE.films])
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = scatter * (math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0)
        cell, up = CELL * rng.standard_normal(), list[FilmsPoint]()
        while not series.has_enough(asked, up) and len(up) < asked[0].most:
            seen = loads * (1 + cell) + off * rng.standard_normal(loads.size)
            felt = loads[:, np.newaxis] * (1 + each * rng.standard_normal(noise.shape))
            volts = slopes * (felt + noise * rng.standard_normal(noise.shape))
            up += [_point(*of) for of in zip(loads.tolist(), seen.tolist(), volts, strict=True)]
        found = _evaluated(up, [line for each in asked if (line := each.line(up))])
        for film in (RIGID, TOTAL):
            sensitivity = found[f"force sensitivity, {SINGLE.films[film].name}"]
            deviations.append(sensitivity.value / slopes[film] - 1)
            us.append(sensitivity.u / sensitivity.value)
            inside += abs(sensitivity.value - slopes[film]) <= sensitivity.expanded()
        seconds += asked[0].costs.seconds(1, len(up), plan.dwell)
    what = f"sensitivity, {name}, {tolerance:.1%}"
    yield from held(what, deviations, us, inside)
    yield timed(what, seconds / runs / plan.seconds, factor == 1.0 and not drawn)


def noisy(name: str, decay: float, runs: int) -> Iterator[Row]:
    """Records of both films under each load, in the converter's steps.

    Args:
        name: what offsets do.
        decay: standard deviation of an offset that decays, over the film's amplitude.
        runs: number of runs.
    """
    rng = np.random.default_rng(25)
    asked = Characterisation()
    conditions = asked.conditions(SINGLE, THESIS_LOAD_CELL)
    loads, off = np.array(conditions.loads), reading_u(THESIS_LOAD_CELL, 1.0)
    slopes = np.array([film.sensitivity * conditions.force(film, 1.0) for film in SINGLE.films])
    scatter = np.array([film.scatter for film in SINGLE.films])
    expected = {row["name"]: row["u"] for row in asked.plan(TARGET).predicted.details["predicted_results"]}
    found: dict[str, list[Budget]] = {}
    for _ in range(runs):
        up = []
        for load in loads.tolist():
            amplitude = slopes * load * (1 + scatter * rng.standard_normal(2)) / 2
            angle = 2 * math.pi * FREQUENCY * TIME + rng.uniform(0, 2 * math.pi)
            volts = amplitude[:, np.newaxis] * np.cos(angle) + WHITE * rng.standard_normal((2, TIME.size))
            volts += decay * amplitude[:, np.newaxis] * rng.standard_normal((2, 1)) * np.exp(-TIME)
            volts += STEPS * rng.uniform(size=(2, 1))
            fit = fit_sine(TIME, STEPS * np.round(volts / STEPS), FREQUENCY)
            point = _point(load, load + off * rng.standard_normal(), 2 * fit.amplitude)
            rapid = {"noise_V": fit.rapid.rms, "noise_u": fit.rapid.rms_u, "noise_peak_V": fit.rapid.greatest}
            given = {field: tuple(values.tolist()) for field, values in rapid.items()}
            up.append(replace(point, voltages_u=tuple((2 * fit.amplitude_u).tolist()), **given))
        for quantity, budget in _evaluated(up).items():
            found.setdefault(quantity, []).append(budget)
    for quantity in (f"{figure}, {film.name}" for figure in FIGURES for film in SINGLE.films):
        budgets = found[quantity]
        truth = float(np.mean([budget.value for budget in budgets]))
        scale = 1.0 if budgets[0].unit == "dB" else truth
        us = [budget.u / scale for budget in budgets]
        inside = sum(abs(budget.value - truth) <= budget.expanded() for budget in budgets)
        yield from held(f"{quantity}, {name}", [budget.value / scale for budget in budgets], us, inside)
        over = math.sqrt(float(np.mean(np.square(us)))) / expected[quantity]
        goal, met = (f"{EXPECTED[0]:g} to {EXPECTED[1]:g}", EXPECTED[0] <= over <= EXPECTED[1]) if decay else ("", None)
        yield Row(f"{quantity}, {name}: stated over expected uncertainty", f"{over:.2f}", goal, met)


def _evaluated(up: list[FilmsPoint], lines: Sequence[Component] = ()) -> dict[str, Budget]:
    """The figures of merit of both films by load sets on the way up; the others repeat the first of these."""
    points = [*up, replace(up[0], direction=UNLOADING)]
    points += [replace(up[0], direction=HOLDING, time_s=30.0 * number) for number in range(3)]
    result = evaluate(points, SINGLE, THESIS_LOAD_CELL, 1.0, FORCE_LIMIT, lines=lines)
    return {budget.quantity: budget for budget in result.budgets}


def _point(load: float, seen: float, volts: np.ndarray) -> FilmsPoint:
    """A valid point on the way up, with usual noise."""
    noise_u = WHITE * math.sqrt(8 / TIME.size)
    return FilmsPoint(
        LOADING, 0.0, load, seen, 0.0, tuple(volts.tolist()), (noise_u,) * 2, (WHITE,) * 2, (0.05 * WHITE,) * 2, 20.0,
        (3 * WHITE,) * 2, TIME.size, True, (),
    )  # fmt: skip
