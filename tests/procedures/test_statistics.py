"""Statistics that are written out here are those of scipy.stats and scipy.optimize, and of GTC.

All in one file, since scipy.stats takes a second to import.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import GTC as gtc
import numpy as np
import pytest
import scipy

from palpate.instrument.calibration.films import FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import ASTM_E74_SIGMAS, THESIS_LOAD_CELL, WeightRun, lower_limit_factor
from palpate.instrument.findings.compression import DisplaySeries, LoadLine, displays_u
from palpate.instrument.findings.film_forces import apart, film_forces
from palpate.instrument.models.validation import ValidationLine
from palpate.instrument.sensor.designs import get_design
from palpate.instrument.signals.estimate import mean_power, typical
from palpate.instrument.signals.noise import of_greatest, whittle
from palpate.instrument.thesis import read_table
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor
from palpate.instrument.uncertainty.interpolation import SIGNIFICANCE, best_degree, interpolate
from palpate.procedures.measurements import frequency, softness
from palpate.procedures.measurements.loads import floor_of
from palpate.procedures.reproduce import criterion as bias
from palpate.procedures.reproduce.criterion import cells_of, fitted_line
from palpate.procedures.steps.film_point import FALSE_ALARMS, forces_differ
from palpate.procedures.steps.films import CHARGE_AMPLIFIER
from palpate.procedures.steps.standing import wandered
from tests.instrument.test_film_forces import FREQUENCY, fitted
from tests.procedures.test_characterise import LOADS, measured, rows

SINGLE = get_design("single")
INF = math.inf


def test_coverage_factors_are_students() -> None:
    for coverage in (0.5, 0.6827, 0.95, 0.9999):
        for freedom in (0.7, 1.0, 2.5, 30.0, 1e6):
            expected = scipy.stats.t.ppf((1 + coverage) / 2, freedom)
            assert coverage_factor(freedom, coverage) == pytest.approx(expected, rel=1e-9)
        assert coverage_factor(INF, coverage) == pytest.approx(scipy.stats.norm.ppf((1 + coverage) / 2), rel=1e-12)


# --- lines and curves ------------------------------------------------------------------------------------------

X = np.array([1.0, 1.5, 2.5, 4.0, 5.0, 7.0, 8.0])


def noisy(seed: int, bend: float = 0.0) -> np.ndarray:
    return 2.0 + 10.0 * X + bend * X**2 + np.random.default_rng(seed).normal(0, 0.3, X.size)


def test_a_line_by_its_residuals_is_that_of_a_regression() -> None:
    y = noisy(1)
    found, expected = interpolate(X, y, 0.0), scipy.stats.linregress(X, y)
    assert found.coefficients == pytest.approx([expected.intercept, expected.slope], rel=1e-12)
    u = np.sqrt(np.diagonal(found.covariance))
    assert u == pytest.approx([expected.intercept_stderr, expected.stderr], rel=1e-10)


def test_residuals_count_where_a_chi_squared_test_says_that_they_are_no_chance() -> None:
    y = noisy(3)
    squares = interpolate(X, y, 0.0).residual_sd ** 2 * (X.size - 2)
    limit = math.sqrt(squares / scipy.stats.chi2.isf(SIGNIFICANCE, X.size - 2))
    assert interpolate(X, y, 0.999 * limit).by_scatter
    assert not interpolate(X, y, 1.001 * limit).by_scatter


def test_a_second_degree_is_taken_where_an_f_test_asks_for_it() -> None:
    taken = []
    for seed in range(30):
        y = noisy(seed, bend=0.004 * seed)
        left = [float(((y - np.polynomial.Polynomial.fit(X, y, degree)(X)) ** 2).sum()) for degree in (1, 2)]
        chance = scipy.stats.f.sf((left[0] - left[1]) / (left[1] / (X.size - 3)), 1, X.size - 3)
        taken.append(best_degree(X, y, 0.0))
        assert taken[-1] == (2 if chance < SIGNIFICANCE else 1)
    assert set(taken) == {1, 2}


def test_a_load_line_is_a_regression_whose_scatter_passes_an_f_test() -> None:
    random, positions = np.random.default_rng(4), np.linspace(0, 3e-3, 8)
    by_residuals = []
    for scatter in np.linspace(0.2, 6, 15):  # mV, of a point about the line
        level = 40 + 2e4 * positions + random.normal(0, scatter, positions.size)
        series = DisplaySeries(positions, np.rint(level[:, None] + random.normal(0, 3.0, (positions.size, 10))))
        found = LoadLine.through("line", series, THESIS_LOAD_CELL)
        expected = scipy.stats.linregress(positions, found.loads)
        known, freedom = displays_u(series.displays, THESIS_LOAD_CELL)
        sd = expected.stderr * np.linalg.norm(positions - positions.mean())
        larger = scipy.stats.f.sf((sd / known) ** 2, positions.size - 2, freedom) <= SIGNIFICANCE
        by_residuals.append(bool(larger))
        assert (found.slope, found.slope_u, found.degrees_of_freedom) == (
            pytest.approx(expected.slope, rel=1e-9),
            pytest.approx(expected.stderr * (1 if larger else known / sd), rel=1e-9),
            positions.size - 2 if larger else freedom,
        )
    assert set(by_residuals) == {False, True}


def test_the_lower_limit_factor_is_that_of_a_regression_through_all_readings() -> None:
    random, load = np.random.default_rng(6), np.arange(1.0, 9.0)
    runs = [
        WeightRun(0.0, *(10 * load + random.normal(0, 0.2, (2, load.size)))) for _ in range(3)
    ]  # fmt: skip
    readings = np.concatenate([series for run in runs for series in (run.loading_mV, run.unloading_mV)])
    expected = scipy.stats.linregress(np.tile(load, 6), readings)
    left = readings - expected.intercept - expected.slope * np.tile(load, 6)
    sd = math.sqrt(float(left @ left) / (readings.size - 2))
    mean = np.mean([run.mean_mV() for run in runs], axis=0)
    factor = lower_limit_factor(load, runs, interpolate(load, mean, 0.0))
    assert factor == pytest.approx(ASTM_E74_SIGMAS * sd / expected.slope, rel=1e-9)


def test_the_odds_of_a_table_are_those_of_a_fit() -> None:
    table = read_table("A2.1")
    places, ratios, sound = cells_of(table)
    (start, slope), _ = scipy.optimize.curve_fit(
        lambda x, a, b: (a + b * x) / (1 + a + b * x), places[sound], ratios[sound], (0.2, 0.05), ftol=1e-14, xtol=1e-14
    )
    found = fitted_line(table)
    assert (found.start, found.slope) == pytest.approx((start, slope), rel=1e-6)


# --- films -------------------------------------------------------------------------------------------------------


def test_the_crosstalk_of_films_has_the_standard_error_of_its_mean() -> None:
    design, random = get_design("common_base"), np.random.default_rng(8)
    readings = []
    for tooth in (0, 1):
        for load in (2.0, 3.0, 4.0, 5.0):
            felt = np.array([0.3, 0.3, 1.0]) * [film.sensitivity for film in design.films]
            felt[1 - tooth] *= 0.05
            volts = felt * load * (1 + random.normal(0, 0.01, 3))
            readings.append(FilmReading(tooth, 10.0, load, load, 0.01, volts))
    origin = {"device": "n", "simulated": True, "source": "s", "created": "2026-01-01", "expires": "2027-01-01"}
    found = calibrate_films(design, readings, THESIS_LOAD_CELL, origin)
    for film in (0, 1):
        own = [r.voltage[film] / r.load for r in readings if r.tooth == film]
        heard = [r.voltage[film] / r.load for r in readings if r.tooth != film]
        assert (found.crosstalk[film][1 - film], found.crosstalk_u[film][1 - film]) == (
            pytest.approx(np.mean(heard) / np.mean(own)),
            pytest.approx(scipy.stats.sem(heard) / np.mean(own)),
        )


def test_white_and_falling_noise_are_told_apart_as_likelihood_does() -> None:
    random, lines, slope = np.random.default_rng(10), np.full(12, 40.0), np.geomspace(1, 0.02, 12)
    for white, rising in ((1.0, 3.0), (2.0, 0.5)):
        power = (white + rising * slope) * random.gamma(lines) / lines

        def unlikely(parts: np.ndarray, power: np.ndarray = power) -> float:
            density = np.exp(parts[0]) + np.exp(parts[1]) * slope
            return float(lines @ (np.log(density) + power / density))

        best = scipy.optimize.minimize(unlikely, (0.0, 0.0), tol=1e-12)
        found = [float(part[0]) for part in whittle(power[None], slope, lines)]
        assert found == pytest.approx(np.exp(best.x), rel=1e-3)


def test_the_power_of_noise_of_an_unknown_shape_is_a_mixture_of_inverse_chi_squareds() -> None:
    """Each share of 1/f noise has its own; mean, variance and so degrees of freedom are those of the mixture."""
    log, squares, count = np.log([[0.2, 0.5, 0.3]]), np.array([[30.0, 40.0, 55.0]]), 40
    mean, freedom, _ = mean_power(log, squares, count)
    parts = [scipy.stats.invgamma(count / 2, scale=s / 2) for s in squares[0]]
    weights = np.array([0.2, 0.5, 0.3])
    expected = float(weights @ [part.mean() for part in parts])
    variance = float(weights @ [part.var() + part.mean() ** 2 for part in parts]) - expected**2
    assert mean[0] == pytest.approx(expected, rel=1e-12)
    one = scipy.stats.invgamma(freedom[0] / 2, scale=freedom[0] * typical(mean, freedom)[0] / 2)
    assert (one.mean(), one.var()) == pytest.approx((expected, variance), rel=1e-9)


# --- findings ----------------------------------------------------------------------------------------------------


def test_a_modulus_has_the_uncertainty_of_its_ratio_and_of_its_model() -> None:
    """E goes as the ratio to the power of the sensitivity; the curve's error is a rectangle, validation a factor."""
    mean = Budget("ratio", 0.4, "", (Component("noise", 0.01, 1.0, 6), Component("scatter", 0.02)))
    each = SimpleNamespace(object="x", modulus_Pa=50e3, sensitivity=1.7, curve_error=0.003)
    line = ValidationLine(0.0, 0.24, 6, "six samples")
    *_, on_scale, absolute = softness.budgets_of(each, mean, line)  # type: ignore[arg-type]
    ratio = gtc.ureal(0.4, 0.01, 6) + gtc.ureal(0, 0.02) + gtc.ureal(0, gtc.type_b.uniform(0.003))
    for found, factor in ((on_scale, 1.0), (absolute, gtc.exp(gtc.ureal(0, 0.24, 6)))):
        modulus = 50e3 * (ratio * factor / 0.4) ** 1.7
        assert ((found.value, found.u), found.degrees_of_freedom) == (
            pytest.approx((modulus.x, modulus.u), rel=1e-9),
            pytest.approx(modulus.df, rel=1e-6),
        )


def test_means_that_are_called_apart_are_so_by_welchs_test() -> None:
    """The fewer degrees of freedom of the two count, which is on the safe side of his."""
    for freedom in ((3, 20), (8, 8)):
        u = math.hypot(0.02, 0.03)
        limit = float(scipy.stats.t.ppf(0.975, min(freedom))) * u
        for times in (0.999, 1.001):
            one, other = (
                Budget("ratio", value, "", (Component("noise", each, 1.0, nu),))
                for value, each, nu in ((0.3, 0.02, freedom[0]), (0.3 + times * limit, 0.03, freedom[1]))
            )
            sizes = [nu + 1 for nu in freedom]
            sds = [budget.u * math.sqrt(n) for budget, n in zip((one, other), sizes, strict=True)]
            welch = scipy.stats.ttest_ind_from_stats(one.value, sds[0], sizes[0], other.value, sds[1], sizes[1], False)
            assert apart(one, other) == (times > 1)
            assert not apart(one, other) or welch.pvalue < 0.05


# --- procedures --------------------------------------------------------------------------------------------------


def test_two_forces_differ_where_students_factor_of_their_difference_ends() -> None:
    """The limit is found by halving: there the difference is as great as chance and charge amplifier allow."""
    forces = film_forces(SINGLE, fitted(SINGLE, [0.5, 1.6], noise=8e-3))
    load_u, known, at = 0.02, 5.0, 10.0
    noise_u, total_u = forces.force_total_noise_u, forces.force_total_u
    films = gtc.ureal(0, noise_u, forces.degrees_of_freedom) + gtc.ureal(0, math.sqrt(total_u**2 - noise_u**2))
    difference = films - gtc.ureal(0, load_u, known)
    chance = scipy.stats.t.isf(FALSE_ALARMS / 2, difference.df) * difference.u
    lost = 1 - abs(1 / (1 + 1 / (2j * math.pi * at * CHARGE_AMPLIFIER)))
    agrees, differs = forces.force_total_N, 3 * forces.force_total_N
    for _ in range(60):
        middle = (agrees + differs) / 2
        if forces_differ(forces, at, middle, load_u, known):
            differs = middle
        else:
            agrees = middle
    assert agrees - forces.force_total_N == pytest.approx(chance + lost * agrees, rel=1e-6)


def test_figures_of_a_sensor_have_the_uncertainty_of_their_equations() -> None:
    """The film's gain scatters so much that residuals, not readings, give the uncertainty of the lines."""
    points = [
        replace(p, voltages_V=tuple(v * (1 + 0.35 * math.sin(7 * n + 3 * i)) for i, v in enumerate(p.voltages_V)))
        for n, p in enumerate(measured())
    ]
    found, up = rows(points), [p for p in points if p.direction == "loading"]
    loads, volts = np.array(LOADS), np.array([p.voltages_V[1] for p in up])
    line = scipy.stats.linregress(loads, volts)
    slope = gtc.ureal(line.slope, line.stderr)
    slope *= gtc.ureal(1, THESIS_LOAD_CELL.sensitivity_u / THESIS_LOAD_CELL.sensitivity_mV_per_N)
    top = up[-1]
    amplitude = gtc.ureal(top.voltages_V[1], top.voltages_u[1])
    noise = gtc.ureal(top.noise_V[1], top.noise_u[1])
    about = np.linalg.norm(volts - line.intercept - line.slope * loads) / math.sqrt(len(loads) - 2)
    gain = gtc.ureal(1, float(about / math.sqrt(np.mean(volts**2))))
    ratio = 20 * gtc.log10(amplitude * gain / math.sqrt(8) / noise)
    held = [p for p in points if p.direction == "holding"]
    volts_held = np.array([p.voltages_V[1] for p in held])
    drift = scipy.stats.linregress([p.time_s / 60 for p in held], volts_held / volts_held.mean())
    for name, value, u in (
        ("force sensitivity", slope.x, slope.u),
        ("signal-to-noise ratio", ratio.x, ratio.u),
        ("drift", drift.slope, drift.stderr),
    ):
        assert (found[name].value, found[name].u) == pytest.approx((value, u), rel=1e-6), name


@pytest.mark.parametrize("samples", [250, 10_000])
def test_the_greatest_of_normal_noise_scatters_as_its_order_statistics_say(samples: int) -> None:
    """The greatest of n is below x with the probability of one to the power n; palpate takes the limit of that."""
    x = np.linspace(0, 8, 20_001)
    density = np.gradient(scipy.stats.halfnorm.cdf(x) ** samples, x)
    mean = scipy.integrate.trapezoid(x * density, x)
    sd = math.sqrt(scipy.integrate.trapezoid((x - mean) ** 2 * density, x))
    assert of_greatest(samples) == pytest.approx(sd / mean, rel=0.06)


def test_the_gain_of_a_film_at_a_frequency_is_as_uncertain_as_its_parts() -> None:
    fit = fitted(SINGLE, [0.5, 1.6], noise=5e-3)
    point = SimpleNamespace(
        fit=fit, load_measured_N=1.6, load_measured_u=0.03, valid=True, dwell_s=1.0, settling_s=0.0, attempts=1,
        flags=(),
    )  # fmt: skip
    found = frequency.point_of(SINGLE, FREQUENCY, point, 0.2)  # type: ignore[arg-type]
    load = gtc.ureal(1.6, 0.03)
    for film, amplitude, u, told in zip(SINGLE.films, fit.amplitude, fit.amplitude_u, found.films, strict=True):
        gain = 2 * gtc.ureal(float(amplitude), float(u)) / load * gtc.ureal(1, film.scatter)
        assert (told.gain_V_per_N, told.gain_u) == pytest.approx((gain.x, gain.u), rel=1e-9)
    phases = [gtc.ureal(float(p), float(u)) for p, u in zip(fit.phase, fit.phase_u, strict=True)]
    assert found.films[0].phase_u == pytest.approx(math.degrees((phases[0] - phases[1]).u), rel=0.02)


def test_a_signal_that_walks_goes_on_as_uncertainly_as_its_steps_say() -> None:
    steps = np.random.default_rng(12).normal(0.1, 0.5, 7)
    drift = np.concatenate([[0.0], np.cumsum(steps)]).tolist()
    known = [gtc.ureal(float(step), float(np.std(steps, ddof=1))) for step in steps]
    ahead = [gtc.ureal(0, float(np.std(steps, ddof=1))) for _ in range(5)]
    assert wandered(drift, 5.0) == pytest.approx((5 * sum(known) / len(known) + sum(ahead)).u, rel=1e-9)


def test_a_plan_counts_the_pick_up_of_two_cables_in_a_ratio() -> None:
    design, ratio = SINGLE.with_pickup(0.01), 0.3
    top, bottom = gtc.ureal(ratio, 0.01 / math.sqrt(2)), gtc.ureal(1, 0.01 / math.sqrt(2))
    scatter, cables = floor_of(design, ratio)
    assert (scatter.u, cables.u) == pytest.approx((SINGLE.ratio_scatter, (top / bottom).u / ratio), rel=1e-9)


# --- beside the thesis -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 7, 40])
def test_the_farthest_of_several_means_has_sidaks_limit(count: int) -> None:
    beyond = 2 * scipy.stats.norm.sf(bias.limit(count))
    assert (1 - beyond) ** count == pytest.approx(1 - bias.BY_CHANCE, rel=1e-9)


def test_the_mean_of_rows_that_share_a_part_is_that_of_gtc() -> None:
    shared = gtc.ureal(0, 1)
    loads, terms = [], []
    for distance, common in ((0.5, 0.3), (-1.0, 0.6), (2.0, 0.0)):
        loads.append([SimpleNamespace(bias_distance=distance, common=common, u=0.1)] * 2)
        terms.append(gtc.ureal(distance, math.sqrt(1 - common**2)) + common * shared)
    found = bias.mean_difference("table", "force", None, loads)  # type: ignore[arg-type]
    mean = sum(terms) / 3
    assert (found.mean, found.u) == pytest.approx((mean.x, mean.u), rel=1e-12)
    apart_ = [replace(found, mean=1.0, u=0.5, of=str(n)) for n in range(4)]
    (together,) = bias.together("all", apart_)
    assert together.u == pytest.approx((sum(gtc.ureal(1, 0.5) for _ in range(4)) / 4).u, rel=1e-12)
