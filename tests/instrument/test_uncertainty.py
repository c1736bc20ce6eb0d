"""Uncertainty budgets: worked examples of the GUM, and the cases in which sums of squares go wrong."""

from __future__ import annotations

import json
import math

import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import Budget, Component, coverage_factor

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
