"""Uncertainties that are propagated here by hand are those of GTC, a library that propagates them by itself.

Each test writes down the measurement as an equation of uncertain numbers, and GTC differentiates it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import GTC as gtc
import numpy as np
import pytest
from GTC import rp

from palpate.instrument.calibration.films import FilmReading, calibrate_films
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL, Curvature, LoadCellCalibration, load_budget
from palpate.instrument.findings.compression import LoadLine, compress
from palpate.instrument.findings.film_forces import film_forces, mean_ratio, pickup_u
from palpate.instrument.sensor.design import FILM_KINDS, Design
from palpate.instrument.sensor.designs import DESIGNS, get_design
from palpate.instrument.signals.estimate import SineFit
from palpate.instrument.uncertainty import budget as budgets
from palpate.instrument.uncertainty.budget import LINEAR, Budget, Component, Input, propagate
from tests.instrument.test_compression import AREA, three
from tests.instrument.test_film_forces import fitted

INF = math.inf
ZERO_U, SENSITIVITY_U, CURVATURE_U = THESIS_LOAD_CELL.zero_u, THESIS_LOAD_CELL.sensitivity_u, 0.01
CURVED = THESIS_LOAD_CELL.model_copy(
    update={
        "degrees_of_freedom": 9,
        "curvature": Curvature(
            mV_per_N2=-0.05,
            u=CURVATURE_U,
            with_sensitivity=-0.9 * SENSITIVITY_U * CURVATURE_U,
            with_zero=0.75 * ZERO_U * CURVATURE_U,
        ),
    }
)


def together(values: Sequence[float], covariance: np.ndarray, freedom: float = INF) -> list[Any]:
    """Uncertain numbers that were estimated together."""
    u = np.sqrt(np.diagonal(covariance))
    numbers = gtc.multiple_ureal([float(v) for v in values], [float(each) for each in u], freedom)
    for i in range(len(u)):
        for j in range(i):
            if u[i] * u[j] > 0:
                gtc.set_correlation(
                    max(-1.0, min(1.0, float(covariance[i, j] / (u[i] * u[j])))), numbers[i], numbers[j]
                )
    return list(numbers)


def same(budget: Budget, result: Any) -> None:
    assert budget.value == pytest.approx(result.x, rel=1e-9)
    assert budget.u == pytest.approx(result.u, rel=1e-7)
    assert budget.degrees_of_freedom == pytest.approx(result.df, rel=1e-6)
    if math.isfinite(result.df):
        assert budget.expanded() == pytest.approx(rp.k_factor(result.df) * result.u, rel=1e-4)


@pytest.mark.parametrize("freedom", [3.0, 12.0, INF])
def test_a_budget_of_inputs_that_were_estimated_together_is_that_of_gtc(freedom: float) -> None:
    random = np.random.default_rng(5)
    root = random.normal(0, 1, (3, 3))
    covariance, slopes = root @ root.T, (1.0, -2.0, 0.5)
    x = together((0, 0, 0), covariance, freedom)
    other = gtc.ureal(0, 1.5, 7)
    u = np.sqrt(np.diagonal(covariance))
    names = ("a", "b", "c")
    components = tuple(Component(n, float(v), c, freedom) for n, v, c in zip(names, u, slopes, strict=True))
    correlations = {(names[i], names[j]): float(covariance[i, j] / (u[i] * u[j])) for i in range(3) for j in range(i)}
    budget = Budget("y", 0.0, "N", (*components, Component("other", 1.5, 1.0, 7)), correlations)
    same(budget, sum(c * each for c, each in zip(slopes, x, strict=True)) + other)


@pytest.mark.parametrize(
    "function",
    [
        lambda lib, a, b, c: a / b + c,
        lambda lib, a, b, c: a * lib.exp(-b) / (1 + c**2),
        lambda lib, a, b, c: lib.sqrt(a**2 + b**2) * lib.cos(c),
    ],
    ids=["quotient", "exponential", "length"],
)
def test_a_linear_propagation_has_the_derivatives_of_gtc(function: Any) -> None:
    values, u, r = (1.2, 2.5, 0.4), (1e-3, 2e-3, 5e-4), 0.6
    x = [gtc.ureal(v, each, independent=False) for v, each in zip(values[:2], u[:2], strict=True)]
    gtc.set_correlation(r, *x)
    inputs = tuple(Input(n, v, each) for n, v, each in zip("abc", values, u, strict=True))
    found = propagate("y", "", lambda *v: function(np, *v), inputs, {("a", "b"): r}, seed=1, method=LINEAR)
    same(found.budget, function(gtc, *x, gtc.ureal(values[2], u[2])))


# --- load cell -----------------------------------------------------------------------------------------


def calibrated(calibration: LoadCellCalibration) -> list[Any]:
    """Zero, sensitivity and curvature."""
    values = [calibration.zero_mV, calibration.sensitivity_mV_per_N]
    covariance = np.array([
        [calibration.zero_u**2, calibration.covariance], [calibration.covariance, calibration.sensitivity_u**2]
    ])  # fmt: skip
    if bent := calibration.curvature:
        values.append(bent.mV_per_N2)
        column = np.array([bent.with_zero, bent.with_sensitivity])
        covariance = np.block([[covariance, column[:, None]], [column, np.array([bent.u**2])]])
    return together(values, covariance, calibration.degrees_of_freedom or INF)


def by_calibration(numbers: Sequence[Any], reading: Any) -> Any:
    """The load that gives a reading."""
    zero, sensitivity, *bend = numbers
    if not bend:
        return (reading - zero) / sensitivity
    return (gtc.sqrt(sensitivity**2 + 4 * bend[0] * (reading - zero)) - sensitivity) / (2 * bend[0])


@pytest.mark.parametrize("calibration", [THESIS_LOAD_CELL, CURVED], ids=["straight", "curved"])
@pytest.mark.parametrize("load", [1.5, 6.0])
def test_a_load_by_the_cell_is_that_of_gtc(calibration: LoadCellCalibration, load: float) -> None:
    reading = gtc.ureal(calibration.reading(load), calibration.reading_u(3))
    result = by_calibration(calibrated(calibration), reading)
    found, u = calibration.load(reading.x, 3)
    assert (found, u) == pytest.approx((result.x, result.u), rel=1e-9)
    same(load_budget(calibration, load, 3), result)
    assert calibration.curve_u(load) == pytest.approx(by_calibration(calibrated(calibration), reading.x).u, rel=1e-9)


def test_the_mean_of_several_loads_by_one_curve_is_that_of_gtc() -> None:
    """The curve is wrong alike at all loads, but not by the same share of each."""
    for calibration in (THESIS_LOAD_CELL, CURVED):
        curve, loads = calibrated(calibration), (1.5, 3.0, 6.0)
        told = [by_calibration(curve, calibration.reading(load)) / load for load in loads]
        assert calibration.mean_curve_u(np.array(loads)) == pytest.approx((sum(told) / 3).u, rel=1e-9)


# --- films ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parts:
    """Which parts of the uncertainty of forces are looked at."""

    noise: bool = False
    scatter: bool = False
    calibration: bool = False
    pickup: bool = False


def forces_by_gtc(design: Design, fit: SineFit, parts: Parts) -> list[Any]:
    """Forces of the films, with these parts uncertain."""
    n, none = len(design.films), np.zeros((len(design.films),) * 2)
    noise = 4 * fit.amplitude_correlation * np.outer(fit.amplitude_u, fit.amplitude_u)
    volts = together(2 * fit.unbiased, noise if parts.noise else none, fit.degrees_of_freedom)
    known = none if design.film_covariance is None else np.array(design.film_covariance)
    sensitivity = together([1.0] * n, known if parts.calibration else none)
    gain = together([1.0] * n, np.array(design.scatter_covariance) if parts.scatter else none)
    total = sum(
        v.x / film.sensitivity for v, film in zip(volts, design.films, strict=True) if film.kind == FILM_KINDS[1]
    )
    cable = [gtc.ureal(0, pickup_u(design) * total if parts.pickup else 0.0) for _ in range(n)]
    films = [film.sensitivity for film in design.films]
    return [v / s * g / c + p for v, s, g, c, p in zip(volts, films, gain, sensitivity, cable, strict=True)]


def ratio_by_gtc(design: Design, forces: Sequence[Any]) -> Any:
    """Mean over the bases of what their teeth take."""
    films = list(zip(design.films, forces, strict=True))
    bases = [(film, force) for film, force in films if film.kind == FILM_KINDS[1]]
    shares = [
        sum(own for film, own in films if film.kind == FILM_KINDS[0] and film.teeth[0] in base.teeth) / force
        for base, force in bases
    ]
    return sum(shares) / len(bases)


def sum_by_gtc(design: Design, forces: Sequence[Any], kind: str) -> Any:
    return sum(force for film, force in zip(design.films, forces, strict=True) if film.kind == kind)


@pytest.mark.parametrize(
    ("name", "newtons"),
    [
        ("single", [0.471, 1.501]),
        ("common_base", [0.236, 0.191, 1.493]),
        ("different_base", [0.513, 1.475, 0.518, 1.489]),
    ],
)
def test_forces_and_ratio_of_any_design_are_those_of_gtc(name: str, newtons: list[float]) -> None:
    design = get_design(name)
    n = len(design.films)
    root = np.random.default_rng(3).normal(0, 0.01, (n, n))
    design = replace(design, film_covariance=tuple(map(tuple, (root @ root.T).tolist())), film_freedom=8.0).with_pickup(
        0.004
    )
    fit = fitted(design, newtons, noise=2e-3)
    found = film_forces(design, fit)
    for parts, u in (
        (Parts(noise=True), found.noise_u),
        (Parts(calibration=True), found.calibration_u),
        (Parts(pickup=True), found.pickup_u),
    ):
        assert ratio_by_gtc(design, forces_by_gtc(design, fit, parts)).u == pytest.approx(u, rel=1e-6)
    forces = forces_by_gtc(design, fit, Parts(True, True, True, True))
    ratio = ratio_by_gtc(design, forces)
    assert found.force_ratio_u == pytest.approx(ratio.u, rel=1e-6)
    assert found.force_ratio == pytest.approx(ratio.x, rel=1e-3)  # less the quotient's bias
    assert found.force_rigid_u == pytest.approx(sum_by_gtc(design, forces, FILM_KINDS[0]).u, rel=1e-6)
    assert found.force_total_u == pytest.approx(sum_by_gtc(design, forces, FILM_KINDS[1]).u, rel=1e-6)
    noisy = sum_by_gtc(design, forces_by_gtc(design, fit, Parts(noise=True)), FILM_KINDS[1])
    assert found.force_total_noise_u == pytest.approx(noisy.u, rel=1e-6)
    assert found.degrees_of_freedom == pytest.approx(noisy.df)
    each = dict(zip(design.films, forces, strict=True))
    for tooth in found.teeth:
        film = next(f for f in design.films if f.kind == FILM_KINDS[0] and f.teeth == (tooth.tooth - 1,))
        base = next(f for f in design.films if f.kind == FILM_KINDS[1] and tooth.tooth - 1 in f.teeth)
        assert (tooth.force_u, tooth.base_force_u) == pytest.approx((each[film].u, each[base].u), rel=1e-6)
        assert tooth.force_ratio_u == pytest.approx((each[film] / each[base]).u, rel=1e-4)


@pytest.mark.parametrize("name", DESIGNS)
def test_the_scatter_of_a_ratio_and_of_each_tooth_is_that_of_gtc(name: str) -> None:
    design = get_design(name)
    forces = together([1.0] * len(design.films), np.array(design.scatter_covariance))
    sensor = ratio_by_gtc(design, forces)
    assert design.ratio_scatter == pytest.approx(sensor.u / sensor.x, rel=1e-9)
    films = list(zip(design.films, forces, strict=True))
    teeth = [
        own / next(base for film, base in films if film.kind == FILM_KINDS[1] and tooth.teeth[0] in film.teeth)
        for tooth, own in films
        if tooth.kind == FILM_KINDS[0]
    ]
    found = [[gtc.get_covariance(one, other) for other in teeth] for one in teeth]
    assert np.array(design.tooth_covariance) == pytest.approx(np.array(found), rel=1e-9, abs=1e-15)


@dataclass(frozen=True)
class Point:
    force_ratio: float
    force_ratio_u: float
    noise_u: float
    calibration_u: float
    pickup_u: float
    degrees_of_freedom: float | None


def test_a_mean_ratio_is_that_of_gtc() -> None:
    """What is the same in all points is one input, what is new in each is one for each.

    The gains are new in each point, and one estimate, of seven degrees of freedom, tells the scatter of all.
    """
    noises, scatters = (0.003, 0.002, 0.004), (0.01, 0.012, 0.011)
    gains = together([0.0, 0.0, 0.0], np.diag(np.square(scatters)), 7)
    calibration, cable = gtc.ureal(0, 1.0, 6), gtc.ureal(0, 1.0)
    points, terms = [], []
    for noise, scatter, gain, freedom in zip(noises, scatters, gains, (5.0, 8.0, 40.0), strict=True):
        u = math.hypot(noise, scatter, 0.006, 0.002)
        points.append(Point(0.3 + noise, u, noise, 0.006, 0.002, freedom))
        own = gtc.ureal(0.3 + noise, noise, freedom) + gain
        terms.append(own + 0.006 * calibration + 0.002 * cable)
    same(mean_ratio("force ratio", points, 6.0), sum(terms) / 3)


def test_a_film_calibration_is_that_of_gtc() -> None:
    """The sensitivities are means of voltage over load. Films scatter together, and one cell measured all loads."""
    design, random = get_design("single"), np.random.default_rng(2)
    loads = np.array([2.0, 3.0, 4.0, 5.0, 6.0])
    gains = np.array([film.sensitivity for film in design.films])
    common = random.normal(0, 0.02, loads.size)
    volts = gains * loads[:, None] * (1 + common[:, None] + random.normal(0, 0.01, (loads.size, 2)))
    readings = [FilmReading(0, 10.0, float(load), float(load), 0.01, v) for load, v in zip(loads, volts, strict=True)]
    origin = {"device": "n", "simulated": True, "source": "s", "created": "2026-01-01", "expires": "2027-01-01"}
    found = calibrate_films(design, readings, THESIS_LOAD_CELL, origin)
    ratios = (volts / loads[:, None]).T
    means = gtc.type_a.multi_estimate_real([list(map(float, each)) for each in ratios])
    cell = calibrated(THESIS_LOAD_CELL)
    told = [by_calibration(cell, THESIS_LOAD_CELL.reading(float(load))) for load in loads]
    for i, film in enumerate(found.films):
        assert film.sensitivity_mV_per_N == pytest.approx(1e3 * means[i].x, rel=1e-12)
        assert film.scatter_u == pytest.approx(1e3 * means[i].u, rel=1e-9)
        assert film.degrees_of_freedom == means[i].df
        by_cell = sum(float(v) / load for v, load in zip(volts[:, i], told, strict=True)) / loads.size
        # Here each load counts by what the film gave there, which scatters; in the calibration all count alike.
        assert film.load_cell_u == pytest.approx(1e3 * by_cell.u, rel=0.01)
    parts = [found.films[i].load_cell_u for i in range(2)]
    expected = 1e6 * gtc.get_covariance(*means) + parts[0] * parts[1]
    assert found.covariance[0][1] == pytest.approx(expected, rel=1e-9)


# --- compression ---------------------------------------------------------------------------------------


class Pushed:
    """A line through loads that were measured at positions, which are known."""

    def __init__(self, line: LoadLine) -> None:
        self.positions: list[float] = line.positions.tolist()
        n = len(self.positions)
        self.loads = together(line.loads, line.scatter**2 * np.eye(n), line.degrees_of_freedom)
        self.middle = math.fsum(self.positions) / n
        away = [x - self.middle for x in self.positions]
        self.mean = sum(self.loads) / n
        self.slope = sum(d * load for d, load in zip(away, self.loads, strict=True)) / math.fsum(d**2 for d in away)


def test_moduli_of_a_pad_are_those_of_gtc(monkeypatch: pytest.MonkeyPatch) -> None:
    """GTC begins at the single loads, so that it finds by itself how a load and the line through it correlate."""
    monkeypatch.setattr(budgets, "TRIALS", 2000)
    calibration = THESIS_LOAD_CELL.model_copy(update={"degrees_of_freedom": 7})
    series = three(noise=1.5)
    found = compress(*series, calibration, AREA, 2e-6)
    names = ("bare", "loading", "unloading")
    bare, up, down = (
        Pushed(LoadLine.through(name, each, calibration)) for name, each in zip(names, series, strict=True)
    )
    scale = calibration.sensitivity_mV_per_N
    covariance = np.array([
        [calibration.zero_u**2, calibration.covariance], [calibration.covariance, calibration.sensitivity_u**2]
    ])  # fmt: skip
    zero, sensitivity = together((0.0, 1.0), covariance / scale**2, calibration.degrees_of_freedom)
    area, steps = gtc.ureal(AREA, 2e-6), gtc.ureal(0, 1e-6 / math.sqrt(6))
    contact = up.middle - (up.mean - zero) / up.slope
    thickness = bare.middle - (bare.mean - zero) / bare.slope - contact + steps
    compliance = sensitivity / bare.slope

    def stress(load: Any) -> Any:
        return (load - zero) / sensitivity / area

    def strain(load: Any, position: float) -> Any:
        return (position - contact - (load - zero) / sensitivity * compliance) / thickness

    def work(line: Pushed) -> Any:
        points = sorted(zip(line.positions, line.loads, strict=True), key=lambda each: each[0])
        curve = [(0.0, 0.0), *((stress(load), strain(load, position)) for position, load in points)]
        return sum((after[0] + before[0]) / 2 * (after[1] - before[1]) for before, after in pairwise(curve))

    last = up.positions.index(max(up.positions))
    results: Mapping[str, Any] = {
        "tangent": thickness / ((sensitivity / up.slope - compliance) * area),
        "unloading": thickness / ((sensitivity / down.slope - compliance) * area),
        "secant": stress(up.loads[last]) / strain(up.loads[last], up.positions[last]),
        "thickness": thickness,
        "compliance": compliance,
        "energy_loss": 1 - work(down) / work(up),
    }
    for name, result in results.items():
        budget = getattr(found, name).budget
        assert (budget.value, budget.u) == pytest.approx((result.x, result.u), rel=1e-4), name
        assert budget.degrees_of_freedom == pytest.approx(result.df, rel=1e-3), name
    points = [*zip(up.positions, up.loads, strict=True), *zip(down.positions, down.loads, strict=True)]
    for point, (position, load) in zip(found.points, points, strict=True):
        assert point.stress_u == pytest.approx(stress(load).u, rel=1e-4)
        assert point.strain_u == pytest.approx(strain(load, position).u, rel=1e-4)
        secant = stress(load) / strain(load, position)
        if secant.u < 0.1 * secant.x:  # else the quotient is bent within its uncertainty
            assert point.secant_modulus_u == pytest.approx(secant.u, rel=1e-3)
