"""References fix a model's constant and tell its spread; what contradicts is refused by name."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.instrument.calibration.model_calibration import MeasuredReference, ModelCalibration, expected_u, fit_model
from palpate.instrument.errors import ConfigError, EstimateError
from palpate.instrument.findings.object_modulus import ByReferences, estimate
from palpate.instrument.models.response import RatioQuestion
from palpate.instrument.models.validation import Validation, validate, validation_u
from tests.benchmarks.coverage import covered

ORIGIN = {
    "design": "single", "model": "surface", "parameters": "physical", "thickness_m": 3e-3, "film_calibration": None,
    "device": "SN-1", "scene": None, "simulated": False, "source": "run", "created": "2026-11-23",
    "expires": "2027-11-23",
}  # fmt: skip
SURFACE = validate("single", "physical", "surface")
UNTOLD = Validation("single", "physical", "experiment", "input")
SCATTER = 0.0167


def reference(name: str, error: float, u: float = 0.02, films_u: float = 0.0) -> MeasuredReference:
    """A reference of which the model's ratio is e^error times the measured one, with a sensitivity of 2."""
    return MeasuredReference(name, 48e3, u, "stated", 0.25 * math.exp(-error), SCATTER, films_u, 0.0, 0.25, 2.0)


def fitted(*errors: float, known: Validation = SURFACE, films_u: float = 0.0) -> ModelCalibration:
    return fit_model([reference(f"R{n}", error, films_u=films_u) for n, error in enumerate(errors)], known, ORIGIN)


def test_the_thesis_tells_mean_spread_and_rms_of_a_models_ln_ratio() -> None:
    logs = [math.log1p(value / 100) for value in SURFACE.percent.values()]
    assert (SURFACE.ln_mean, SURFACE.ln_spread) == pytest.approx((np.mean(logs), np.std(logs, ddof=1)))
    line = validation_u("single", "physical", "surface")
    assert (line.u, line.degrees_of_freedom) == (pytest.approx(np.sqrt(np.mean(np.square(logs)))), 6)
    assert UNTOLD.ln_mean is UNTOLD.ln_spread is UNTOLD.ln_rms is None


def test_equal_references_leave_spread_and_their_own_uncertainty_over_their_number() -> None:
    """u² = τ²(1 + 1/q) + (u_ref/S)²/q + σ²/q, τ pooled with the thesis' 5 degrees of freedom."""
    errors = (0.20, 0.30, 0.22)
    found, prior = fitted(*errors), SURFACE.ln_spread
    assert prior is not None
    own = 0.01**2 + SCATTER**2
    freedom = 2 * (prior**2 / (prior**2 + own)) ** 2  # noise takes some of the two
    assert 1.3 < freedom < 2
    spread = math.sqrt((5 * prior**2 + freedom * (np.var(errors, ddof=1) - own)) / (5 + freedom))
    assert (found.spread, found.spread_degrees_of_freedom) == (pytest.approx(spread), pytest.approx(5 + freedom))
    line = found.line(same_films=True)
    assert line.constant == pytest.approx(np.mean(errors))
    assert line.u == pytest.approx(math.sqrt(spread**2 * (1 + 1 / 3) + own / 3))
    assert line.degrees_of_freedom == pytest.approx(line.u**4 / (spread**2 * (1 + 1 / 3)) ** 2 * (5 + freedom))


def test_a_better_known_reference_counts_more() -> None:
    found = fit_model([reference("good", 0.2), reference("rough", 0.3, u=0.4)], SURFACE, ORIGIN)
    assert 0.2 < found.constant < 0.22


def test_the_films_calibration_that_references_and_object_share_cancels_in_both() -> None:
    films_u = 0.0146
    found = fitted(0.2, 0.25, 0.22, films_u=films_u).model_copy(update={"film_calibration": "ab12"})
    shared, apart = found.line(same_films=True), found.line(same_films=False)
    assert shared.u is not None and apart.u is not None
    assert shared.source.endswith("the films' calibration is the same and cancels")
    assert apart.source.endswith("their films' calibration counts")
    assert apart.u**2 - shared.u**2 == pytest.approx(films_u**2)  # it does not average out
    question, ratio, u = RatioQuestion("single", "surface"), 0.2, 0.2 * math.hypot(films_u, SCATTER)
    (cancelled,) = estimate(question, [ratio], u, references=ByReferences(found, True, films_u * ratio))
    (counted,) = estimate(question, [ratio], u, references=ByReferences(found))
    assert cancelled["scale_u"] == counted["scale_u"]
    assert cancelled["absolute_u"] == pytest.approx(
        cancelled["sensitivity"] * math.hypot(SCATTER, shared.u), rel=1e-4
    )  # fmt: skip
    assert counted["absolute_u"] == pytest.approx(counted["sensitivity"] * math.hypot(u / ratio, apart.u), rel=1e-4)


def test_references_that_scatter_more_than_the_thesis_samples_drop_them() -> None:
    errors = (0.05, 0.25, 0.45, 0.15, 0.38)
    found = fitted(*errors)
    assert found.prior.startswith("their own spread, which refutes the thesis' 5.3 % (5 degrees of freedom)")
    assert found.prior.endswith("; 'R0' lies farthest from the others")
    assert found.spread_degrees_of_freedom == 4
    assert found.spread == pytest.approx(np.std(errors, ddof=1))
    assert found.line(True).u == pytest.approx(np.std(errors, ddof=1) * math.sqrt(1 + 1 / 5))  # it holds their own


def test_one_reference_takes_the_spread_of_the_thesis_or_tells_none() -> None:
    assert fitted(0.24).spread == SURFACE.ln_spread
    alone = fitted(0.24, known=UNTOLD).line(True)
    assert (alone.constant, alone.u) == (pytest.approx(0.24), None)
    assert "palpate calibrate model --model surface, two or more" in alone.source
    two = fitted(0.24, 0.30, known=UNTOLD).line(True)
    assert (two.u, two.degrees_of_freedom) == (pytest.approx(0.03 * math.sqrt(2) * math.sqrt(1.5)), 1)


def test_what_references_are_expected_to_leave_is_what_they_leave_where_they_have_the_spread_of_the_thesis() -> None:
    prior = SURFACE.ln_spread
    assert prior is not None
    apart = math.hypot(prior, 0.01, SCATTER)  # two at this distance from their mean have just the thesis' spread
    found = fitted(0.24 - apart / math.sqrt(2), 0.24 + apart / math.sqrt(2))
    assert found.line(True).u == pytest.approx(expected_u(SURFACE, [0.01, 0.01], SCATTER))
    assert expected_u(UNTOLD, [0.01], SCATTER) is None


def test_another_reference_is_worth_what_it_then_brings() -> None:
    found = fitted(0.20, 0.26, 0.23)
    told = found.with_more(4)
    assert told is not None and told.u is not None and found.spread is not None
    own = 0.01**2 + SCATTER**2
    assert told.u == pytest.approx(math.sqrt(found.spread**2 * 1.25 + own / 4))
    freedom = (found.spread_degrees_of_freedom or 0.0) + (found.spread**2 / (found.spread**2 + own)) ** 2
    assert told.degrees_of_freedom == pytest.approx(told.u**4 / (found.spread**2 * 1.25) ** 2 * freedom)
    assert fitted(0.2, known=UNTOLD).with_more(2) is None


@pytest.mark.parametrize(
    ("errors", "named"),
    [
        ((0.2, 0.22, 0.9, 0.21), "reference 'R2' and the others contradict each other"),
        ((-0.2, 0.8), "references 'R0' and 'R1' contradict each other"),
        ((0.2, 1.4), "reference 'R1' contradicts the curve: its ratio is 0.06165, and the model gives 0.25 for 48 kPa"),
        ((-1.2,), "reference 'R0' contradicts the curve"),
    ],
)
def test_what_contradicts_is_refused_by_name_and_chi2(errors: tuple[float, ...], named: str) -> None:
    with pytest.raises(EstimateError, match=r"chi2 \d+\.\d is above \d+\.\d") as refused:
        fitted(*errors)
    assert str(refused.value).startswith(named)
    assert "take another model" in str(refused.value)


def test_beyond_the_references_the_interval_holds_the_models_own_answer() -> None:
    """A constant ratio would call an object of 1.4 MPa harder than 200 MPa, where all ratios end at 1."""
    by = ByReferences(fitted(0.24, 0.26))
    own = estimate(RatioQuestion("single", "surface"), [0.85], 0.01)
    near, far = estimate(RatioQuestion("single", "surface"), [0.25, 0.85], 0.01, references=by)
    assert near["note"] == ""
    assert far["scale_low_Pa"] == pytest.approx(own[0]["scale_low_Pa"], rel=1e-9)
    assert (far["kind"], far["scale_high_Pa"], far["modulus_Pa"]) == ("at least", None, None)
    assert "beyond the references" in far["note"]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"device": "SN-2"}, r"made on hardware with device SN-1 \(single, surface, physical, 3 mm\), not for this"),
        ({"scene": "ab12", "simulated": True}, r"not for this bench's SN-1 \(.*\) of scene ab12"),
        ({"of": ("array", "surface", "physical", "3 mm")}, r"not for this bench's SN-1 \(array"),
    ],
)
def test_a_calibration_of_another_sensor_is_refused(changed: dict[str, Any], message: str) -> None:
    found = fitted(0.2)
    with pytest.raises(ConfigError, match=message):
        found.check_owner(replace(found.owner, **changed))


def test_films_that_were_calibrated_in_between_end_the_constant() -> None:
    fitted(0.2).check_films(None)
    with pytest.raises(ConfigError, match="made with no calibration of the films, and now there is one"):
        fitted(0.2).check_films("abc")


@pytest.mark.parametrize(
    "question",
    [
        RatioQuestion("single", "surface", settings={"sensed_thickness": 5e-3}),
        RatioQuestion("single", "surface", settings={"sensed_poisson": 0.49}),
        RatioQuestion("single", "surface", settings={"compliant_modulus": 33e3}),
        RatioQuestion("single", "column"),
        RatioQuestion("single_round", "surface"),
        RatioQuestion("single", "surface", "thesis"),
    ],
)
def test_a_calibration_is_not_used_for_another_question(question: RatioQuestion) -> None:
    model = question.model
    with pytest.raises(ConfigError, match="calibration of a model by run is for"):
        fitted(0.2).check_question(question, model)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("spread", [0.02, 0.053])
def test_intervals_by_references_hold_as_often_as_they_say(count: int, spread: float) -> None:
    share, over = covered(800, count, spread, told=True)
    assert 0.925 < share < 0.975
    assert 0.9 < over < 1.1


@pytest.mark.slow
def test_without_the_thesis_the_references_own_spread_suffices() -> None:
    share, _ = covered(800, 3, 0.05, told=False)
    assert share > 0.93
