"""Verdicts of limits: probabilities, guard bands, and the uncertainty that would decide."""

from __future__ import annotations

import itertools
import math

import pytest
from scipy import integrate, stats

from palpate.instrument.errors import EstimateError
from palpate.instrument.uncertainty.decision import Bounds, Estimate, NormalPrior, decide, deciding_u, guard_band


@pytest.mark.parametrize("freedom", [math.inf, 2.5, 7])
def test_without_a_prior_the_risk_is_that_of_students_distribution(freedom: float) -> None:
    own = stats.norm(4.1, 0.2) if math.isinf(freedom) else stats.t(freedom, 4.1, 0.2)
    found = decide(Estimate(4.1, 0.2, freedom), Bounds(3.9, 4.5))
    assert found.below == pytest.approx(own.cdf(3.9), rel=1e-9)
    assert found.above == pytest.approx(own.sf(4.5), rel=1e-9)


@pytest.mark.parametrize("freedom", [math.inf, 2.5, 7])
@pytest.mark.parametrize("prior", [NormalPrior(4.0, 0.3), NormalPrior(4.8, 0.1), NormalPrior(4.0, 5.0)])
@pytest.mark.parametrize("interval", [None, (3.8, 4.9)])
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
