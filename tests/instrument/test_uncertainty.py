"""Uncertainty budgets: worked examples of the GUM, and the cases in which sums of squares go wrong."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.budget import COVERAGE, Budget, Component, coverage_factor

NAN, INF = math.nan, math.inf


def test_independent_components_add_in_squares() -> None:
    budget = Budget("x", 1.0, "N", (Component("a", 3.0), Component("b", 2.0, sensitivity=-2.0)))
    assert budget.u == pytest.approx(5.0, rel=1e-15)
    assert [row["share"] for row in budget.rows()] == pytest.approx([0.36, 0.64], rel=1e-14)


def test_the_gums_example_of_effective_degrees_of_freedom() -> None:
    """JCGM 100, G.4.1: relative 0.25 %, 0.57 %, 0.82 % of 10, 5, 15 repeats give 19.0."""
    parts = zip((0.25, 0.57, 0.82), (9, 4, 14), strict=True)
    components = tuple(Component(f"x{i}", u, 1.0, dof, "A") for i, (u, dof) in enumerate(parts))
    budget = Budget("y", 100.0, "%", components)
    assert budget.u == pytest.approx(1.03, abs=0.005)
    assert budget.degrees_of_freedom == pytest.approx(19.0, abs=0.05)
    assert budget.expanded() == pytest.approx(2.09 * 1.03, abs=0.01)


def test_the_gums_end_gauge_has_sixteen_degrees_of_freedom() -> None:
    """JCGM 100, H.1: combined 32 nm, 16 degrees of freedom, 93 nm at 99 %."""
    given = {"standard": (25.0, 18.0), "difference": (9.7, 25.6), "expansion": (2.9, 50.0), "temperature": (16.6, 2.0)}
    budget = Budget("length", 50e6, "nm", tuple(Component(n, u, 1.0, dof) for n, (u, dof) in given.items()))
    assert budget.u == pytest.approx(32, abs=0.5)
    assert math.floor(budget.degrees_of_freedom) == 16
    assert budget.expanded(0.99) == pytest.approx(93, abs=1.5)


def test_the_gums_resistance_needs_its_correlations() -> None:
    """JCGM 100, H.2: R = V cos(phi) / I of five sets of readings; 0.071 ohm, where independent ones give 0.2."""
    readings = np.array([
        [5.007, 4.994, 5.005, 4.990, 4.999],
        [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3],
        [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
    ])  # fmt: skip
    volt, ampere, phase = readings.mean(axis=1).tolist()
    resistance = volt / ampere * math.cos(phase)
    slopes = (math.cos(phase) / ampere, -resistance / ampere, -volt / ampere * math.sin(phase))
    names, u = ("V", "I", "phi"), readings.std(axis=1, ddof=1) / math.sqrt(5)
    components = tuple(Component(n, float(v), c, 4, "A") for n, v, c in zip(names, u, slopes, strict=True))
    r = np.corrcoef(readings)
    together = {(names[i], names[j]): float(r[i, j]) for i, j in ((0, 1), (0, 2), (1, 2))}
    budget = Budget("R", resistance, "ohm", components, together)
    assert resistance == pytest.approx(127.732, abs=0.001)
    assert budget.u == pytest.approx(0.071, abs=0.0005)
    assert Budget("R", resistance, "ohm", components).u == pytest.approx(0.2, abs=0.01)
    assert budget.degrees_of_freedom == pytest.approx(4, rel=1e-12)  # five sets of readings
    assert sum(row["share"] for row in budget.rows()) == pytest.approx(1, rel=1e-12)


def test_fully_correlated_inputs_cancel_to_the_last_digit() -> None:
    """Sums of squares and products would leave the square root of round-off, 1e-8."""
    components = (Component("top", 0.1, 7.0), Component("bottom", 0.7, -1.0), Component("noise", 1e-12))
    budget = Budget("ratio", 1.0, "", components, {("top", "bottom"): 1.0})
    assert budget.u == pytest.approx(1e-12, rel=1e-3)


def test_many_inputs_of_one_source_cancel_as_well() -> None:
    names = tuple("abcdefg")
    together = {(p, q): 1.0 for p in names for q in names if p < q}
    parts = (1.0, 2.0, 3.0, 4.0, 5.0, -7.0, -8.0)
    budget = Budget("x", 0.0, "", tuple(Component(n, 1.0, c) for n, c in zip(names, parts, strict=True)), together)
    assert budget.u < 1e-13


def test_three_inputs_of_one_source_add_up_plainly() -> None:
    names = ("a", "b", "c")
    together = {(p, q): 1.0 for p in names for q in names if p < q}
    budget = Budget("sum", 0.0, "N", tuple(Component(n, 1.0, 1.0, 5) for n in names), together)
    assert budget.u == pytest.approx(3.0, rel=1e-9)
    assert budget.degrees_of_freedom == pytest.approx(5, rel=1e-9)


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


def test_the_factor_of_the_usual_interval_is_scipys_to_the_last_digit() -> None:
    from scipy.special import ndtri

    assert coverage_factor(math.inf) == float(ndtri((1 + COVERAGE) / 2))
