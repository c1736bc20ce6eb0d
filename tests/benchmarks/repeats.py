"""Monte Carlo of what is measured repeatedly: means to a tolerance, orders to a risk, verdicts, control charts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace

import numpy as np
from scipy.special import ndtr, ndtri

from palpate.instrument.allocation.table import FIRST
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, WeightRun, load_cell_curve
from palpate.instrument.contracts.own import FULL_SCALE_COUNTS, RANGE_VOLTS
from palpate.instrument.models.influence import ERROR, tooth_shares
from palpate.instrument.quantity import counted
from palpate.instrument.sensor.design import USUAL_NOISE
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.sensor.sample import get_sample
from palpate.instrument.signals.estimate import fit_sine
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor
from palpate.instrument.uncertainty.control_chart import checked
from palpate.instrument.uncertainty.decision import PASS, UNDECIDED, Bounds, Estimate, NormalPrior, decide, guard_band
from palpate.procedures.lab.lab import Target
from palpate.procedures.measurements.characterise.procedure import Characterisation
from palpate.procedures.measurements.characterise.report import HOLDING, LOADING, UNLOADING, FilmsPoint, evaluate
from palpate.procedures.measurements.films import FilmSeries, PressedPoint
from palpate.procedures.measurements.load_cell.procedure import LOADS as CELL_LOADS
from palpate.procedures.measurements.load_cell.report import REPEATS
from palpate.procedures.measurements.loads import LoadSweep
from palpate.procedures.measurements.position import PositionPoint, PositionSweep, share_noise
from palpate.procedures.measurements.prospects import DISPLAY_NOISE, reading_u
from palpate.procedures.measurements.softness import Ranking, SoftnessPoint, SoftnessTest
from tests.benchmarks.common import Row, at_least, at_most, between

# --- repeats -------------------------------------------------------------------------------------------

SINGLE, LOADS, SAMPLE = get_design("single"), (2.0, 3.0, 4.0), "4"
PLACES = ((2e-3, 2e-4), (10e-3, 1.8e-4), (22e-3, 1.8e-4))  # m; the tolerance of each is near the best there
BOUNDED = 0.93  # where most of the uncertainty has a bound, intervals hold more often than they say
TRUTHS = (("known scatter", 1.0, False), ("scatter x 1.5", 1.5, False), ("scatter drawn from the prior", 1.0, True))


def repeats(runs: int = 1000) -> Iterator[Row]:
    """Monte Carlo of repeats, for means of samples, films, places and the load cell."""
    for truth in TRUTHS:
        for tolerance in (0.06, 0.02, 0.01):
            yield from repeated(*truth, tolerance, runs)
        yield from pressed(*truth, 0.025, runs)
        for place, tolerance in PLACES:
            yield from located(*truth, place, tolerance, runs)
    for name, off in (("10.1 steps from load to load", 0.0), ("any slope", 0.05)):
        for count in (1, 10):
            yield weighed(name, off, count, 8 * runs)  # what holds is near the goal, and chance is 0.3 %


def _drawn(rng: np.random.Generator, drawn: bool) -> float:
    """True scatter over the stated one, which is known, or a prior of seven degrees of freedom."""
    return math.sqrt(7 / rng.chisquare(7)) if drawn else 1.0


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
    return at_least(what, inside / runs, BOUNDED, "{:.0%}", f"{inside / runs:.1%}")


def repeated(name: str, factor: float, drawn: bool, tolerance: float, runs: int) -> Iterator[Row]:
    """One sample, whose sets scatter about a ratio of 1 in logarithms of 0."""
    rng = np.random.default_rng(21)
    repeats = LoadSweep((SAMPLE,), LOADS, tolerance=tolerance).plan(Target(SINGLE, 10.0, nodes=1)).basis
    assert repeats is not None
    asked = repeats[SAMPLE]
    plan = asked.plan
    deviations, us, inside, seconds = [], [], 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * _drawn(rng, drawn)
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
        each = scatter * _drawn(rng, drawn)
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
        each = factor * _drawn(rng, drawn)
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
        least: least share of them; None: 93 to 97 %.
    """
    covered, achieved = inside / len(us), float(np.std(deviations) / np.mean(us))
    figure, told = f"{what}: 95 % intervals that hold the truth", f"{covered:.1%}"
    if least is None:
        yield between(figure, covered, (0.93, 0.97), "{:.0%}", told)
    else:
        yield at_least(figure, covered, least, "{:.0%}", told)
    figure, told = f"{what}: achieved over predicted uncertainty", f"{achieved:.2f}"
    yield between(figure, achieved, (0.9, 1.2), "{:g}", told)


def timed(what: str, over: float, known: bool) -> Row:
    """Bench time over that of the plan, which is promised where the scatter is as it was `known` before."""
    figure, told = f"{what}: bench time over the plan's", f"{over:.2f}"
    return between(figure, over, (0.9, 1.1), "{:g}", told) if known else Row(figure, told)


def _set_at(place: float, left: float, right: float) -> PositionPoint:
    """A valid load set at a place [m], of which the shares alone count."""
    numbers = {each.name: 0.0 for each in fields(PositionPoint)}
    told = {"position_mm": 1e3 * place, "share_left": left, "share_right": right, "valid": True, "flags": ()}
    return PositionPoint(**(numbers | told))  # type: ignore[arg-type]


# --- characterise --------------------------------------------------------------------------------------

SINGLE, RIGID, TOTAL = get_design("single"), 0, 1
FORCE_LIMIT = 10.0  # N
TARGET = Target(SINGLE, FORCE_LIMIT, nodes=1)
CELL = THESIS_LOAD_CELL.sensitivity_u / THESIS_LOAD_CELL.sensitivity_mV_per_N
TIME = np.arange(250) / 250  # s, of a record
FREQUENCY = 10.0  # Hz
WHITE = USUAL_NOISE * math.sqrt(250 / 2)  # V, noise of a sample
STEPS = np.array([[min(RANGE_VOLTS)], [max(RANGE_VOLTS)]]) / FULL_SCALE_COUNTS  # V, of each film's range
FIGURES = "signal-to-noise ratio", "resolution"
OFFSETS = (("offsets stand still", 0.0), ("offsets decay", 0.01))  # over the amplitude


def characterise(runs: int = 1000) -> Iterator[Row]:
    """Monte Carlo of a characterisation: sensitivities to a tolerance, figures of noise, and what the plan expects."""
    for truth in TRUTHS:
        for tolerance in (0.06, 0.02):
            yield from sloped(*truth, tolerance, runs)
    for offset in OFFSETS:
        yield from noisy(*offset, runs)


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
        each = scatter * _drawn(rng, drawn)
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
        figure, told = f"{quantity}, {name}: stated over expected uncertainty", f"{over:.2f}"
        # offsets that decay are what a plan expects
        yield between(figure, over, (0.8, 1.25), "{:g}", told) if decay else Row(figure, told)


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


# --- order ---------------------------------------------------------------------------------------------

RISK, MOST = 0.05, 5
SINGLE = get_design("single")
SAMPLES = dict(SINGLE.thesis_force_ratio)
ALIKE = {name: 0.2 * (1 + 1e-9 * number) for number, name in enumerate(SAMPLES)}
PAIRS = {name: 0.15 * 1.3 ** (number // 2) * (1 + 1e-9 * number) for number, name in enumerate(SAMPLES)}
ORDER_TRUTHS: tuple[tuple[str, Mapping[str, float], float, bool], ...] = (
    ("the thesis' six samples", SAMPLES, 1.0, False),
    ("the same, scatter x 1.5", SAMPLES, 1.5, False),
    ("the same, scatter x 0.67", SAMPLES, 0.67, False),
    ("the same, scatter drawn from the prior", SAMPLES, 1.0, True),
    ("six equal objects", ALIKE, 1.0, False),
    ("three pairs of equal objects", PAIRS, 1.0, False),
    ("three pairs of equal objects, scatter x 1.5", PAIRS, 1.5, False),
)


def order(runs: int = 500) -> Iterator[Row]:
    """Monte Carlo of `softness --risk`: wrong orders, sets and bench time, by the sets of a bench in one line each."""
    for name, ratios, factor, drawn in ORDER_TRUTHS:
        yield from ranked(name, ratios, factor, drawn, runs)


def ranked(name: str, truth: Mapping[str, float], factor: float, drawn: bool, runs: int) -> Iterator[Row]:
    """Runs whose sets scatter about the true ratios. Planned are those of the samples by the thesis' means."""
    rng = np.random.default_rng(20)
    objects = tuple(get_sample(each) for each in truth)
    test = SoftnessTest(objects, (3.0,), 1.0, 10.0, risk=RISK, sets=MOST)
    ranking = Ranking(SINGLE, test, RISK)
    planned = ranking.predicted()
    wrong, left, sets, seconds = 0, 0, 0, 0.0
    for _ in range(runs):
        each = factor * SINGLE.ratio_scatter * _drawn(rng, drawn)
        points: list[SoftnessPoint] = []
        for number in range(len(objects) * MOST):
            thing = objects[number // MOST].name
            if not ranking.has_enough(thing, points):
                ratio = truth[thing] * math.exp(each * rng.standard_normal())
                points.append(SoftnessPoint(thing, 3.0, 3.0, 0.01, ratio, each * ratio, 0.0, True, ()))
        found = ranking.ranked(points)
        pairs = {frozenset(pair.objects) for pair in found.not_told}
        means = {t: np.mean([math.log(p.force_ratio) for p in points if p.object == t]) for t in truth}
        names = sorted(truth, key=lambda t: truth[t])
        told = [(a, b) for n, a in enumerate(names) for b in names[n + 1 :] if frozenset((a, b)) not in pairs]
        wrong += any(means[a] > means[b] for a, b in told)
        left += bool(pairs)
        sets += len(points)
        seconds += math.fsum(ranking.costs.seconds(1, count, test.dwell) for count in found.sets.values())
    yield at_most(f"{name}: runs with a wrong pair", wrong / runs, RISK, "{:.0%}", f"{wrong / runs:.1%}")
    yield timed(name, seconds / runs / planned.seconds, truth is SAMPLES and factor == 1.0)
    yield Row(
        f"{name}: runs that left a pair open; sets of each object",
        f"{left / runs:.0%}; {sets / runs / len(objects):.2f}",
    )


# --- history -------------------------------------------------------------------------------------------

STEADY = 101  # runs of a series without drift: 100 checks


def history(series: int = 10_000) -> Iterator[Row]:
    """Monte Carlo of the control charts of `palpate history`: how soon a drift is found, and how often none is."""
    rng = np.random.default_rng(40)
    begins = {"the first of all among them": np.arange(3), "after a year without drift": np.arange(-12, 4).clip(0)}
    for what, months in begins.items():
        drift = 0.01 * months
        found = sum(alarmed(1 + drift, rng)[-3:].any() for _ in range(series)) / series
        yield at_least(f"1 % a month, u 0.3 %, found within three runs, {what}", found, 0.95, "{:.0%}", f"{found:.1%}")
    for name, u in (("equal u", np.full(STEADY, 0.003)), ("u of 0.1 to 1 %", np.geomspace(1e-3, 1e-2, STEADY))):
        alarms = np.mean([alarmed(np.ones(STEADY), rng, rng.permutation(u))[1:].mean() for _ in range(series // 10)])
        yield at_most(f"false alarms in 100 checks, {name}", 100 * alarms, 1, "{:.2f}")


def alarmed(true: np.ndarray, rng: np.random.Generator, u: np.ndarray | None = None) -> np.ndarray:
    """Which runs of a series give an alarm, whose values are off by their uncertainty."""
    us = np.full(true.size, 0.003) if u is None else u
    values = true + us * rng.standard_normal(true.size)
    return np.array([bool(each.alarms) for each in checked(values.tolist(), us.tolist())])


# --- verdicts ------------------------------------------------------------------------------------------

RISKS = (0.01, 0.05, 0.2)
LIMIT, U = 1.5, 0.3  # of objects whose values are normal, with mean 0 and standard deviation 1
WIDE = math.hypot(1.0, U)  # standard deviation of the measured values
KINDS = {"normal": (math.inf, False), "7 degrees of freedom": (7.0, False), "prior of the production": (math.inf, True)}


def verdicts(runs: int = 10_000) -> Iterator[Row]:
    """Monte Carlo of verdicts: false acceptances by the stated risk, and undecided ones by the guard band."""
    for number, (name, (freedom, known)) in enumerate(KINDS.items()):
        for risk in RISKS:
            bounds = Bounds(-LIMIT, LIMIT, risk, NormalPrior(0.0, 1.0) if known else None)
            yield from judged(f"{name}, risk {risk:.0%}", bounds, freedom, runs, np.random.default_rng(100 + number))


def judged(name: str, bounds: Bounds, freedom: float, runs: int, rng: np.random.Generator) -> Iterator[Row]:
    """Objects of a production, then objects on the limit: half of them might as well be just outside."""
    true = rng.standard_normal(runs)
    estimates = measured(true, freedom, rng)
    found = [decide(each, bounds).outcome for each in estimates]
    passed = [bounds.hold(value) for outcome, value in zip(found, true, strict=True) if outcome == PASS]
    wrong, undecided = 1 - sum(passed) / len(passed), found.count(UNDECIDED) / runs
    yield at_most(f"{name}: false among accepted", wrong, bounds.risk, "{:.0%}", f"{wrong:.2%}")
    if bounds.prior is None:
        there = measured(np.full(runs, LIMIT), freedom, rng)
        accepted = sum(decide(each, bounds).outcome == PASS for each in there) / runs
        most = bounds.risk + 3 * math.sqrt(bounds.risk * (1 - bounds.risk) / runs)
        yield at_most(f"{name}: accepted of those on the limit, noise counted", accepted, most, "{:.2%}")
    band = predicted(estimates, bounds)
    yield between(f"{name}: undecided", undecided, (band - 0.02, band + 0.02), "{:.1%}")


def measured(true: np.ndarray, freedom: float, rng: np.random.Generator) -> list[Estimate]:
    """Measured values with their uncertainty, which is itself estimated where its degrees of freedom are finite."""
    values = true + U * rng.standard_normal(true.size)
    u = np.full(true.size, U) if math.isinf(freedom) else U * np.sqrt(rng.chisquare(freedom, true.size) / freedom)
    return [Estimate(float(value), float(each), freedom) for value, each in zip(values, u, strict=True)]


def predicted(estimates: list[Estimate], bounds: Bounds) -> float:
    """Share of measured values within the guard bands of the two limits; a prior moves and narrows them."""
    if bounds.prior is None:
        centre, half = np.full(len(estimates), LIMIT), np.array([guard_band(each, bounds) for each in estimates])
    else:  # the value with the prior is the measured one over 1 + U², its standard deviation U over the root of that
        centre, half = np.array([LIMIT * WIDE**2]), np.array([-ndtri(bounds.risk) * U * WIDE])
    return float(2 * np.mean(ndtr((centre + half) / WIDE) - ndtr((centre - half) / WIDE)))
