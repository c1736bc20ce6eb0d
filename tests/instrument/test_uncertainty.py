"""Budgets, propagation, rounding, groups and verdicts: worked examples, and where sums of squares go wrong."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
import scipy
from scipy import integrate, stats

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError, RangeError
from palpate.instrument.uncertainty.budget import (
    LINEAR,
    MONTE_CARLO,
    Between,
    Budget,
    Component,
    Function,
    Input,
    Propagated,
    between_groups,
    coverage_factor,
    mean_u,
    propagate,
    sums_u,
)
from palpate.instrument.uncertainty.decision import Bounds, Estimate, NormalPrior, decide, deciding_u, guard_band

NAN, INF = math.nan, math.inf


def test_the_gums_end_gauge_has_sixteen_degrees_of_freedom() -> None:
    """JCGM 100, H.1: combined 32 nm, 16 degrees of freedom, 93 nm at 99 %."""
    given = {"standard": (25.0, 18.0), "difference": (9.7, 25.6), "expansion": (2.9, 50.0), "temperature": (16.6, 2.0)}
    budget = Budget("length", 50e6, "nm", tuple(Component(n, u, 1.0, dof) for n, (u, dof) in given.items()))
    assert budget.u == pytest.approx(32, abs=0.5)
    assert math.floor(budget.degrees_of_freedom) == 16
    assert budget.expanded(0.99) == pytest.approx(93, abs=1.5)


def test_fully_correlated_inputs_cancel_to_the_last_digit() -> None:
    """Sums of squares and products would leave the square root of round-off, 1e-8."""
    components = (Component("top", 0.1, 7.0), Component("bottom", 0.7, -1.0), Component("noise", 1e-12))
    budget = Budget("ratio", 1.0, "", components, {("top", "bottom"): 1.0})
    assert budget.u == pytest.approx(1e-12, rel=1e-3)


def test_a_tiny_uncertainty_beside_a_huge_offset_keeps_its_digits() -> None:
    budget = Budget("x", 1e8, "V", (Component("a", 3e-9), Component("b", 4e-9)))
    assert budget.u == pytest.approx(5e-9, rel=1e-14)


def test_extreme_sizes_neither_overflow_nor_vanish() -> None:
    for scale in (1e-300, 1e300):
        budget = Budget("x", 0.0, "", (Component("a", 3 * scale, 1.0, 4), Component("b", 4 * scale, 1.0, 4)))
        assert budget.u == pytest.approx(5 * scale, rel=1e-12)
        assert budget.degrees_of_freedom == pytest.approx(4 / (0.6**4 + 0.8**4), rel=1e-12)


def test_one_degree_of_freedom_widens_the_interval_twelvefold() -> None:
    assert coverage_factor(1) == pytest.approx(12.706, abs=1e-3)
    assert coverage_factor(INF) == pytest.approx(1.95996, abs=1e-5)
    assert Budget("x", 0.0, "", (Component("a", 1.0, 1.0, 1),)).expanded() == pytest.approx(12.706, abs=1e-3)


def test_nothing_uncertain_is_no_division_by_zero() -> None:
    budget = Budget("x", 2.0, "N", (Component("a", 0.0, 1.0, 3), Component("b", 1.0, 0.0)))
    assert (budget.u, budget.degrees_of_freedom, budget.interval()) == (0.0, INF, (2.0, 2.0))
    assert [row["share"] for row in budget.rows()] == [0.0, 0.0]


def test_a_budget_is_json_and_says_infinity_by_absence() -> None:
    said = json.loads(json.dumps(Budget("x", 2.0, "N", (Component("a", 1.0),)).summary(), allow_nan=False))
    assert set(said) == {
        "quantity", "value", "unit", "u", "degrees_of_freedom", "coverage", "expanded", "components", "correlations",
    }  # fmt: skip
    assert said["degrees_of_freedom"] is None and said["components"][0]["degrees_of_freedom"] is None


@pytest.mark.parametrize(
    "make, part",
    [
        (lambda: Component("gain", NAN), "gain"),
        (lambda: Input("gain", INF, 1.0), "gain is"),
        (lambda: Input("gain", 1.0, NAN), "gain"),
        (lambda: Component("gain", -1.0), "zero or more"),
        (lambda: Component("gain", 1.0, INF), "finite"),
        (lambda: Component("gain", 1.0, 1.0, 0), "more than 0"),
        (lambda: Component("gain", 1.0, 1.0, NAN), "more than 0"),
        (lambda: Budget("load", NAN, "N", ()), "load is nan"),
        (lambda: Budget("load", 1.0, "N", (Component("a", 1.0), Component("a", 1.0))), "one name"),
        (lambda: Budget("load", 1.0, "N", (Component("a", 1.0),), {("a", "b"): 0.5}), "'b'"),
        (lambda: _pair({("a", "b"): 1.5}), "outside -1 to 1"),
        (lambda: _pair({("a", "b"): NAN}), "outside -1 to 1"),
        (lambda: _pair({("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9}), "cannot be true together"),
        (lambda: coverage_factor(5, 1.0), "coverage 1.0"),
    ],
)
def test_what_makes_no_budget_is_refused(make: object, part: str) -> None:
    with pytest.raises(EstimateError, match=part):
        make()  # type: ignore[operator]


def _pair(correlations: dict[tuple[str, str], float]) -> Budget:
    return Budget("load", 1.0, "N", tuple(Component(n, 1.0) for n in "abc"), correlations)


# --- Propagation: linear where a line will do, Monte Carlo where it will not, and the reason for either


def of(function: Function, *inputs: Input, **rest: object) -> Propagated:
    return propagate("result", "N", function, inputs, seed=7, **rest)  # type: ignore[arg-type]


def test_a_ratio_of_precise_inputs_is_linear_and_says_so() -> None:
    found = of(lambda v, s: v / s, Input("v", 0.2, 1e-3), Input("s", 0.07, 1e-4))
    assert found.method == LINEAR and "straight line" in found.why
    assert found.u / found.value == pytest.approx(math.hypot(1e-3 / 0.2, 1e-4 / 0.07), rel=1e-3)
    assert [c.sensitivity for c in found.budget.components] == pytest.approx([1 / 0.07, -0.2 / 0.07**2], rel=1e-4)


def test_where_the_sensitivity_is_zero_the_second_order_counts() -> None:
    """x² at zero: a linear budget has no uncertainty at all, the truth is a chi-square of mean 1."""
    found = of(lambda x: x**2, Input("x", 0.0, 1.0))
    assert found.budget.u == 0.0
    assert found.method == MONTE_CARLO and "curved" in found.why
    assert (found.value, found.u) == pytest.approx((1.0, math.sqrt(2)), rel=0.02)
    assert found.low == pytest.approx(9.8e-4, rel=0.15)  # the trials tell it to 4 %
    assert found.high == pytest.approx(5.02, rel=0.03)


def test_a_product_of_two_zeros_is_seen_between_its_inputs() -> None:
    """Along each input it is flat."""
    found = of(lambda x, y: x * y, Input("x", 0.0, 1.0), Input("y", 0.0, 1.0))
    assert found.method == MONTE_CARLO
    assert found.u == pytest.approx(1.0, rel=0.03)


def test_the_mass_calibration_of_jcgm_101_needs_its_monte_carlo() -> None:
    """JCGM 101, 9.3: linear 0.054 mg, in truth 0.075 mg, 95 % from 1.084 to 1.384 mg."""

    def deviation(mass: Floats, added: Floats, air: Floats, density: Floats, reference: Floats) -> Floats:
        return (mass + added) * (1 + (air - 1.2) * (1 / density - 1 / reference)) - 100_000

    found = of(
        deviation,
        Input("mass", 100_000.0, 0.05),
        Input("added", 1.234, 0.02),
        Input("air", 1.2, 0.1 / math.sqrt(3), shape="rectangular"),
        Input("density", 8000.0, 1000 / math.sqrt(3), shape="rectangular"),
        Input("reference", 8000.0, 50 / math.sqrt(3), shape="rectangular"),
    )
    assert found.budget.u == pytest.approx(0.0539, abs=5e-4)
    assert found.method == MONTE_CARLO
    assert found.value == pytest.approx(1.234, abs=1e-3)
    assert found.u == pytest.approx(0.0754, abs=5e-4)
    assert (found.low, found.high) == pytest.approx((1.084, 1.384), abs=3e-3)


def test_a_sum_of_four_rectangular_inputs_is_normal_enough_and_one_alone_is_not() -> None:
    """JCGM 101, 9.2.3: 95 % of four reach 3.88, where a normal reaches 3.92."""
    parts = [Input(name, 0.0, 1.0, shape="rectangular") for name in "abcd"]
    four = of(lambda *x: sum(x), *parts)
    assert four.method == LINEAR and four.high == pytest.approx(3.92, abs=0.005)
    one = of(lambda x: x, parts[0])
    assert one.method == MONTE_CARLO and "rectangular" in one.why
    assert one.high == pytest.approx(0.95 * math.sqrt(3), rel=2e-3)


def test_a_slight_curvature_is_tried_and_found_harmless() -> None:
    found = of(lambda x: x + 0.02 * x**2 * (np.abs(x) > 1.97), Input("x", 0.0, 1.0))
    assert found.method == LINEAR and "same interval" in found.why


@pytest.mark.parametrize("method", [LINEAR, MONTE_CARLO])
def test_fully_correlated_inputs_cancel(method: str) -> None:
    found = of(
        lambda a, b: a / b, Input("a", 3.0, 0.03), Input("b", 1.0, 0.01), correlations={("a", "b"): 1.0}, method=method
    )
    assert found.u == pytest.approx(0.0, abs=3e-6)
    assert found.value == pytest.approx(3.0, rel=1e-6)


def test_a_tiny_uncertainty_on_a_huge_offset_keeps_its_digits() -> None:
    small = Input("x", 1e8, 1e-6), Input("zero", 1e8, 1e-6)
    found = of(lambda x, zero: 3.0 * (x - zero), *small)
    assert found.method == LINEAR
    assert found.u == pytest.approx(3e-6 * math.sqrt(2), rel=1e-2)
    lost = of(lambda x: 2.0 * x, Input("x", 1e8, 1e-9))  # below the last digit of the estimate
    assert lost.u == pytest.approx(2e-9, rel=1e-2)


def test_a_sharp_bend_is_followed_at_the_scale_of_its_uncertainty() -> None:
    """A step in proportion to the estimate would leave the parabola's bottom 600 m behind."""
    found = of(lambda x: (x - 1e8) ** 2, Input("x", 1e8 + 1e-2, 1e-5))
    assert found.u == pytest.approx(2e-7, rel=1e-2)


@pytest.mark.parametrize("dof", [1, 3, 20])
def test_few_degrees_of_freedom_give_the_same_interval_by_either_method(dof: int) -> None:
    inputs = Input("x", 5.0, 0.1, dof, "A")
    linear, drawn = (of(lambda x: 2 * x, inputs, method=method) for method in (LINEAR, MONTE_CARLO))
    assert drawn.high - drawn.low == pytest.approx(linear.high - linear.low, rel=0.05)
    assert drawn.value == pytest.approx(10.0, abs=0.01)
    assert 0.15 < drawn.u < 0.5


def test_correlated_inputs_with_few_degrees_of_freedom_share_them() -> None:
    inputs = Input("a", 0.0, 1.0, 4, "A"), Input("b", 0.0, 1.0, 4, "A")
    linear, drawn = (
        of(lambda a, b: a + b, *inputs, correlations={("a", "b"): 0.5}, method=m) for m in (LINEAR, MONTE_CARLO)
    )
    assert linear.budget.degrees_of_freedom == pytest.approx(4)
    assert drawn.high == pytest.approx(linear.high, rel=0.03)


def test_given_sensitivities_are_used() -> None:
    assert of(lambda x: x, Input("x", 1.0, 1.0), sensitivities=[2.0], method=LINEAR).u == 2.0


def test_the_same_seed_gives_the_same_result() -> None:
    def once() -> Propagated:
        return of(np.exp, Input("x", 0.0, 0.5))

    assert once() == once()


@pytest.mark.parametrize(
    ("function", "inputs", "rest", "part"),
    [
        (lambda x: x, [Input("x", 1.0, 1.0)], {"method": "bootstrap"}, "no method 'bootstrap'"),
        (lambda x: 1 / x, [Input("x", 0.0, 1.0)], {}, "result is inf"),
        (np.log, [Input("x", 1.0, 1.0)], {}, "not finite at x = 1 ± 1"),
        (np.log, [Input("x", 1.0, 0.4)], {}, "result is not finite in .* of 100000 trials"),
        (lambda x: x[:1], [Input("x", 1.0, 1.0)], {}, "shape"),
        (
            lambda x, y: x + y,
            [Input("x", 1.0, 1.0, shape="rectangular"), Input("y", 1.0, 1.0)],
            {"correlations": {("x", "y"): 0.5}, "method": MONTE_CARLO},
            "correlated and rectangular",
        ),
    ],
)
def test_what_has_no_interval_is_refused(
    function: Function, inputs: list[Input], rest: dict[str, object], part: str
) -> None:
    with pytest.raises(EstimateError, match=part):
        of(function, *inputs, **rest)


# --- Means of rounded readings are as uncertain as simulation shows, with noise and without ------------


@pytest.mark.parametrize("noise", [0.25, 0.3, 0.6, 3.0])
@pytest.mark.parametrize("count", [1, 20])
def test_the_uncertainty_of_a_mean_is_its_spread_about_the_truth(noise: float, count: int) -> None:
    rng = np.random.default_rng(9)
    true = rng.uniform(-10, 10, size=4000)
    step = 0.5
    displays = step * np.rint((true + step * noise * rng.normal(size=(20, 4000))) / step)
    scatter = math.sqrt(displays.var(axis=0, ddof=1).mean())
    spread = math.sqrt(np.mean((displays[:count].mean(axis=0) - true) ** 2))
    assert mean_u(scatter, step, count) == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 0.25, 0.4])
@pytest.mark.parametrize("apart", [0.0, 0.1, 0.5, 1.02])
def test_sums_of_means_are_as_uncertain_as_what_their_rounding_shares(noise: float, apart: float) -> None:
    step, weights = 0.5, np.array([[-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
    readings = step * (7 + apart) * np.arange(3)
    # The mean of what a display shows of a reading: each of its steps with its probability.
    true = readings + step * np.linspace(0, 1, 200, endpoint=False)[:, np.newaxis]
    edges = np.arange(-2, 31) + 0.5
    passed = (
        scipy.special.ndtr((true[..., np.newaxis] / step - edges) / noise)
        if noise
        else true[..., np.newaxis] / step > edges
    )
    off = step * (edges[0] - 0.5 + passed.sum(axis=-1)) - true
    spread = np.sqrt(np.mean((off @ weights) ** 2, axis=0))
    # The variance of a count is the sum of its odd numbers' chances less the square of its mean.
    odd = 2 * np.arange(1, edges.size + 1) - 1
    scatter = step * math.sqrt(np.mean((odd * passed).sum(axis=-1) - passed.sum(axis=-1) ** 2))
    assert sums_u(weights, readings[np.newaxis], scatter, step)[0] == pytest.approx(spread, rel=0.01, abs=1e-3 * step)


def test_without_scatter_the_step_alone_is_left() -> None:
    assert mean_u(0.0, 0.1, 100) == pytest.approx(0.1 / math.sqrt(12))


def test_noise_that_hardly_shows_is_taken_for_none() -> None:
    assert mean_u(0.02, 0.1, 1000) == pytest.approx(0.1 / math.sqrt(12), rel=1e-3)


# --- The scatter of groups beyond that of their repeats: what is left of the repeats passes for no scatter of groups

WITHIN, GROUPS, REPEATS, SEEDS = 0.041, 3, 10, 600


def found(scatter: float) -> list[Between]:
    rng = np.random.default_rng(20)
    shifts = scatter * rng.standard_normal((SEEDS, GROUPS, 1))
    drawn = np.exp(shifts + WITHIN * rng.standard_normal((SEEDS, GROUPS, REPEATS)))
    return [between_groups(groups.tolist()) for groups in drawn]


def test_groups_that_are_alike_are_told_apart_in_one_of_twenty_cases_and_their_scatter_is_right_on_average() -> None:
    alike = found(0.0)
    assert np.mean([each.significant for each in alike]) == pytest.approx(0.05, abs=0.02)
    assert np.mean([each.means_u**2 - each.within_u**2 for each in alike]) == pytest.approx(0.0, abs=2e-5)
    assert np.mean([each.u == 0 for each in alike]) > 0.5


def test_groups_that_scatter_by_more_are_told_and_do_not_exceed_the_bound_in_95_percent() -> None:
    for scatter in (0.01, 0.05):
        apart = found(scatter)
        assert np.mean([each.bound_u >= scatter for each in apart]) >= 0.94
        assert np.mean([each.means_u**2 - each.within_u**2 for each in apart]) == pytest.approx(scatter**2, rel=0.15)
    assert np.mean([each.significant for each in apart]) > 0.7


@pytest.mark.parametrize("groups", [[[1.0, 2.0]], [[1.0, 2.0], [1.0]]])
def test_one_group_or_one_value_tells_no_scatter(groups: list[list[float]]) -> None:
    with pytest.raises(RangeError, match="two groups or more, of two values or more"):
        between_groups(groups)


# --- Verdicts of limits: probabilities, guard bands, and the uncertainty that would decide -------------


@pytest.mark.parametrize("freedom", [math.inf, 2.5, 7])
def test_without_a_prior_the_risk_is_that_of_students_distribution(freedom: float) -> None:
    own = stats.norm(4.1, 0.2) if math.isinf(freedom) else stats.t(freedom, 4.1, 0.2)
    found = decide(Estimate(4.1, 0.2, freedom), Bounds(3.9, 4.5))
    assert found.below == pytest.approx(own.cdf(3.9), rel=1e-9)
    assert found.above == pytest.approx(own.sf(4.5), rel=1e-9)


@pytest.mark.parametrize(("freedom", "interval"), [(math.inf, None), (2.5, (3.8, 4.9))])
@pytest.mark.parametrize("prior", [NormalPrior(4.0, 0.3), NormalPrior(4.8, 0.1), NormalPrior(4.0, 5.0)])
def test_a_prior_multiplies_the_distribution(
    freedom: float, prior: NormalPrior, interval: tuple[float, float] | None
) -> None:
    measured = Estimate(4.1, 0.2, freedom, interval)
    low, high = prior.mean - 9 * prior.sd, prior.mean + 9 * prior.sd

    def density(x: float) -> float:
        width = measured.sides[0 if x < 4.1 else 1]
        away = (x - 4.1) / width
        own = stats.norm.pdf(away) if math.isinf(freedom) else stats.t.pdf(away, freedom)
        return float(own / width * stats.norm.pdf(x, prior.mean, prior.sd))

    def mass(start: float, stop: float) -> float:
        ends = sorted({start, stop, *(each for each in (3.0, 3.9, 4.1, 4.5, 5.5) if start < each < stop)})
        return math.fsum(integrate.quad(density, *pair)[0] for pair in itertools.pairwise(ends))

    found = decide(measured, Bounds(3.9, 4.5, prior=prior))
    assert found.below == pytest.approx(mass(low, 3.9) / mass(low, high), rel=2e-5, abs=1e-7)
    assert found.above == pytest.approx(mass(4.5, high) / mass(low, high), rel=2e-5, abs=1e-7)


def test_an_interval_that_is_not_symmetric_has_a_fortieth_beyond_each_end() -> None:
    found = decide(Estimate(4.1, 0.2, 7, (3.8, 4.9)), Bounds(3.8, 4.9))
    assert (found.below, found.above) == (pytest.approx(0.025), pytest.approx(0.025))


@pytest.mark.parametrize("risk", [0.01, 0.05, 0.2])
@pytest.mark.parametrize(
    ("inwards", "outcome"), [(1.01, "pass"), (0.99, "undecided"), (-0.99, "undecided"), (-1.01, "fail")]
)
def test_a_value_is_undecided_within_the_guard_band(risk: float, inwards: float, outcome: str) -> None:
    band = guard_band(Estimate(3.0, 0.1, 5), Bounds(high=4.0, risk=risk))
    assert band == pytest.approx(stats.t.isf(risk, 5) * 0.1)
    for bounds, value in (
        (Bounds(high=4.0, risk=risk), 4.0 - inwards * band),
        (Bounds(4.0, risk=risk), 4.0 + inwards * band),
    ):
        assert decide(Estimate(value, 0.1, 5), bounds).outcome == outcome


@pytest.mark.parametrize(("value", "outcome"), [(4.05, "fail"), (3.9, "pass")])
@pytest.mark.parametrize("prior", [None, NormalPrior(3.9, 0.5)])
def test_the_uncertainty_that_would_decide_does_decide(value: float, outcome: str, prior: NormalPrior | None) -> None:
    bounds = Bounds(3.6, 4.0, prior=prior)
    least = deciding_u(Estimate(value, 0.2, 7), bounds)
    assert least is not None
    assert decide(Estimate(value, 1.001 * least, 7), bounds).outcome == "undecided"
    assert decide(Estimate(value, 0.999 * least, 7), bounds).outcome == outcome


def test_no_uncertainty_decides_a_value_on_its_limit() -> None:
    assert deciding_u(Estimate(4.0, 0.2), Bounds(high=4.0)) is None


def test_limits_closer_than_the_uncertainty_fail_nothing_that_lies_between_them() -> None:
    assert decide(Estimate(4.0, 10.0), Bounds(3.9, 4.1)).outcome == "undecided"


def test_a_value_without_uncertainty_is_decided_by_itself() -> None:
    assert [decide(Estimate(value, 0.0), Bounds(3.9, 4.1)).outcome for value in (3.8, 3.9, 4.1, 4.2)] == [
        "fail", "pass", "pass", "fail",
    ]  # fmt: skip


def test_a_value_that_contradicts_its_prior_is_undecided() -> None:
    found = decide(Estimate(100.0, 0.1), Bounds(high=4.0, prior=NormalPrior(3.0, 0.1)))
    assert (found.outcome, math.isnan(found.outside)) == ("undecided", True)


@pytest.mark.parametrize("given", [(math.nan, 0.1), (1.0, -0.1), (1.0, math.inf), (1.0, 0.1, 7, (1.1, 1.2))])
def test_what_is_no_distribution_is_refused(given: tuple[float, ...]) -> None:
    with pytest.raises(EstimateError, match="is no estimate"):
        Estimate(*given)  # type: ignore[arg-type]
