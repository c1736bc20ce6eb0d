"""Propagation: linear where a line will do, Monte Carlo where it will not, and the reason for either."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate.instrument.arrays import Floats
from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import LINEAR, MONTE_CARLO, Function, Input, Propagated, propagate

NAN, INF = math.nan, math.inf


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


@pytest.mark.parametrize("value", [NAN, INF])
def test_an_input_that_is_not_finite_is_refused(value: float) -> None:
    with pytest.raises(EstimateError, match="gain is"):
        Input("gain", value, 1.0)
    with pytest.raises(EstimateError, match="gain"):
        Input("gain", 1.0, value)
