"""Moduli from force ratios: against closed forms, against brute force, and where only a bound is left."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.instrument.errors import EstimateError, RangeError, UnknownName
from palpate.instrument.findings.object_modulus import modulus_of_ratio
from palpate.instrument.models import price_list
from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.curves import curve_on
from palpate.instrument.models.curve import RatioCurve, curve_through, pole_curve, ratio_curve, sampled_curve
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import PHYSICAL, RoundParameters
from palpate.instrument.models.price_list import ModelChoice
from palpate.instrument.models.response import response
from palpate.instrument.sensor.designs import get_design

Array = NDArray[np.float64]

SINGLE, LOAD = get_design("single"), PHYSICAL.load(1e5)
AREA_SHARE = 1.4**2 / (1.4**2 + 5**2 - 1.5**2)
STEEP = np.array([0.09, 0.15, 0.31, 0.5, 0.7, 0.9, 0.95])
K = 1.959963984540054


def column_modulus(ratio: Array | float) -> Array:
    """E = E_c (T_s / T_c) (R - a) / (a (1 - R))."""
    given = np.asarray(ratio)
    return 24e3 * 3 / 3.88 * (given - AREA_SHARE) / (AREA_SHARE * (1 - given))


@pytest.fixture(scope="module")
def column() -> RatioCurve:
    return ratio_curve(SINGLE, LOAD, "column")


# --- where ratio and modulus belong together -----------------------------------------------------------


def test_the_column_is_inverted_as_its_closed_form_says(column: RatioCurve) -> None:
    found = modulus_of_ratio(column, STEEP)
    assert found.modulus == pytest.approx(column_modulus(STEEP), rel=1e-9)
    assert found.sensitivity == pytest.approx(STEEP * (1 - AREA_SHARE) / ((STEEP - AREA_SHARE) * (1 - STEEP)), rel=1e-8)
    assert set(found.kind) == {"interval"}


@pytest.mark.slow
@pytest.mark.parametrize("model", ["column", "beam", "beam_printed", "experiment"])
def test_a_modulus_comes_back_from_its_own_ratio(model: str) -> None:
    moduli = [25e3, 43e3, 81e3, 112e3]
    ratios = [response(SINGLE, PHYSICAL.load(modulus), model).force_ratio for modulus in moduli]
    found = modulus_of_ratio(ratio_curve(SINGLE, LOAD, model), ratios)
    assert found.modulus == pytest.approx(moduli, rel=1e-9)
    assert all(found.low <= found.modulus)
    assert all(found.modulus <= found.high)


def test_a_finite_element_model_is_covered_by_the_interval_of_its_surface() -> None:
    ratio = axisymmetric.solve(RoundParameters(sensed_modulus=1e5), 2).force_ratio
    found = modulus_of_ratio(ratio_curve(get_design("single_round"), LOAD, "surface"), ratio, u=1e-4)
    assert found.low < 1e5 < found.high < 1.01 * found.low


def test_the_error_of_the_model_widens_the_interval() -> None:
    wrong = sampled_curve(lambda modulus: (_column_ratio(modulus), 0.02), 1e2, 1e9, "wrong", 1e-11)
    found = modulus_of_ratio(wrong, 0.5, u=0.01)
    spread = 0.02 + K * 0.01
    expected = column_modulus(np.array([0.5 - spread, 0.5 + spread]))
    assert np.array([found.low, found.high]) == pytest.approx(expected, rel=1e-3)


def test_many_ratios_have_the_answers_of_each(column: RatioCurve) -> None:
    ratios = np.linspace(0.0801, 0.9999, 100_000).reshape(250, 400)
    uncertainty = 0.01 * ratios
    found = modulus_of_ratio(column, ratios, uncertainty)
    assert found.low.shape == found.kind.shape == (250, 400)
    assert np.all(np.diff(found.low.ravel()) >= 0)
    for place in ((0, 0), (100, 17), (249, 399)):
        one = modulus_of_ratio(column, ratios[place], uncertainty[place])
        assert (one.low, one.high, str(one.kind)) == (found.low[place], found.high[place], found.kind[place])


# --- where they hardly do ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio", "u", "kind", "within"),
    [
        *((ratio, 0.01, "interval", 1e-9) for ratio in STEEP[1:-1]),
        *((0.96, u, "interval", 1e-9) for u in (0.0, 1e-4, 0.005)),
        *((ratio, u, "at least", 1e-7) for ratio in (0.971, 0.99, 0.999) for u in (0.0, 1e-4, 0.005)),  # saturation
        (AREA_SHARE + 0.001, 1e-4, "at most", 1e-6),  # next to the softest
        (0.1, 1e-4, "interval", 1e-9),
        (0.1, 0.02, "at most", 1e-9),  # reaches beyond the model
        (0.9, 0.06, "at least", 1e-9),
        (0.5, 0.5, "any", 1e-9),
    ],
)
def test_an_interval_has_those_ends_that_a_ratio_tells_carried_over(
    column: RatioCurve, ratio: float, u: float, kind: str, within: float
) -> None:
    found = modulus_of_ratio(column, ratio, u=u)
    low = column_modulus(ratio - K * u) if kind in ("interval", "at least") else 0.0
    high = column_modulus(ratio + K * u) if kind in ("interval", "at most") else math.inf
    assert (str(found.kind), math.isnan(found.modulus)) == (kind, kind != "interval")
    assert (float(found.low), float(found.high)) == pytest.approx((low, high), rel=within)


def test_a_ratio_that_the_model_never_gives_is_said_to_be_outside() -> None:
    found = modulus_of_ratio(ratio_curve(SINGLE, LOAD, "experiment"), [0.1, 0.2, 0.6], u=0.005)
    assert list(found.outside) == [True, False, True]
    assert list(found.kind) == ["at most", "interval", "at least"]
    assert found.high[0] == pytest.approx(24131.65)
    assert found.low[2] == pytest.approx(112609.9)
    assert np.isnan(found.modulus[[0, 2]]).all()
    assert np.isnan(found.sensitivity[[0, 2]]).all()


def test_where_several_moduli_give_a_ratio_the_answer_holds_all_of_them() -> None:
    curve = curve_through([1e3, 2e3, 4e3, 8e3, 16e3, 32e3], [0.1, 0.4, 0.3, 0.3, 0.5, 0.9], "wavy")
    moduli = np.geomspace(1e3, 32e3, 400_001)
    forward = curve.force_ratio(moduli)
    ratios, u = np.array([0.2, 0.32, 0.35, 0.6]), 0.01
    found = modulus_of_ratio(curve, ratios, u)
    assert len(curve.turns) > 2
    for index, ratio in enumerate(ratios):
        hit = moduli[np.abs(forward - ratio) <= K * u]
        assert (found.low[index], found.high[index]) == pytest.approx((hit.min(), hit.max()), rel=1e-4)
    assert list(found.ambiguous) == [False, True, True, False]
    assert np.isnan(found.modulus[1:3]).all()


def test_level_ground_is_in_the_interval_from_end_to_end() -> None:
    curve = curve_through([1e3, 2e3, 4e3, 8e3], [0.1, 0.3, 0.3, 0.5], "step")
    found = modulus_of_ratio(curve, 0.3, u=0.001)
    assert found.low < 2e3
    assert found.high > 4e3


def test_a_valley_between_two_slopes_holds_no_ratio_below_it() -> None:
    curve = curve_through([1e3, 2e3, 4e3], [0.5, 0.3, 0.6], "valley")
    found = modulus_of_ratio(curve, 0.2)
    assert (bool(found.outside), str(found.kind)) == (True, "any")


def test_level_ground_in_the_middle_keeps_both_bounds() -> None:
    curve = curve_through([1e3, 2e3, 2e6, 4e6], [0.1, 0.3, 0.301, 0.5], "terrace")
    found = modulus_of_ratio(curve, 0.3005, u=1e-3)
    assert found.sensitivity > 30
    assert str(found.kind) == "interval"
    assert 1e3 < found.low < 2e3 < 2e6 < found.high < 4e6


def test_noise_of_the_model_at_saturation_leaves_a_lower_bound() -> None:
    moduli = np.geomspace(24, 2.4e11, 101)
    noise = 1e-5 * (-1.0) ** np.arange(101)
    curve = curve_through(moduli, [_column_ratio(modulus) for modulus in moduli] + noise, "noisy", error=1e-5)
    assert len(curve.turns) > 2
    found = modulus_of_ratio(curve, [0.5, 0.9999, 0.99999])
    assert list(found.kind) == ["interval", "at least", "at least"]
    assert found.low[1:] == pytest.approx(column_modulus(np.array([0.9999, 0.99999])), rel=0.7)


# --- curves --------------------------------------------------------------------------------------------


def _column_ratio(modulus: float) -> float:
    hardness = modulus * 3.88 / (24e3 * 3)
    return AREA_SHARE * (1 + hardness) / (1 + AREA_SHARE * hardness)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_curve_is_nowhere_further_off_than_it_says(tolerance: float) -> None:
    asked: list[float] = []

    def answer(modulus: float) -> tuple[float, float]:
        asked.append(modulus)
        return _column_ratio(modulus), 0.0

    curve = sampled_curve(answer, 24.0, 2.4e11, "sampled", tolerance)
    moduli = np.geomspace(24.0, 2.4e11, 5001)
    truth = np.array([_column_ratio(modulus) for modulus in moduli])
    assert np.abs(curve.force_ratio(moduli) - truth).max() <= curve.error <= tolerance
    assert len(set(asked)) == len(asked)
    assert len(curve.turns) == 2


def test_what_no_spline_can_follow_is_refused() -> None:
    def jump(modulus: float) -> tuple[float, float]:
        return (0.2 if modulus < 1e5 else 0.8), 0.0

    with pytest.raises(EstimateError, match="at 961 nodes is above"):
        sampled_curve(jump, 1e3, 1e7, "jump", 1e-4)


def test_auto_is_one_model_over_the_priced_moduli_with_its_priced_error(monkeypatch: pytest.MonkeyPatch) -> None:
    priced = replace(price_list.stored(), moduli_Pa=(1e4, 1e5, 1e6), prices=(), references=())
    monkeypatch.setattr(price_list, "stored", lambda: priced)
    monkeypatch.setattr(price_list, "choose", lambda *_: ModelChoice("column", 0.04, 1e-5, "cheap", 0.01))
    curve = ratio_curve(SINGLE, LOAD, "auto", 0.05)
    assert curve.model == "column"
    assert curve.moduli == pytest.approx((1e4, 1e6))
    assert curve.error == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize(
    ("ask", "error", "message"),
    [
        (lambda: ratio_curve(SINGLE, LOAD, "colum"), UnknownName, "did you mean 'column'"),
        (lambda: ratio_curve(SINGLE, LOAD, "column", 1e-4), RangeError, "model 'column' has no error estimate"),
        (lambda: ratio_curve(SINGLE, LOAD, "axisymmetric", -1.0), RangeError, "tolerance -1 is not above 0"),
        (lambda: ratio_curve(get_design("common_base"), LOAD, "axisymmetric"), RangeError, "has 2 teeth, not one"),
        (lambda: ratio_curve(get_design("array"), LOAD, "experiment"), RangeError, "nothing was measured"),
        (lambda: curve_through([1e3], [0.1], "x"), RangeError, "give two or more"),
        (lambda: curve_through([2e3, 1e3], [0.1, 0.2], "x"), RangeError, "positive and ascending"),
        (lambda: curve_through([1e3, 2e3], [0.1, 0.2], "x").force_ratio(3e3), RangeError, "modulus 3000 Pa is outside"),
        (lambda: curve_through([1e3, 2e3], [0.1, 0.2], "x").force_ratio(math.nan), RangeError, "modulus nan Pa"),
    ],
)
def test_a_curve_that_cannot_be_is_refused(ask: Callable[[], object], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        ask()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"ratio": 0.0}, "force ratio 0 is not between 0 and 1"),
        ({"ratio": [0.3, 1.0]}, "force ratio 1 is not between 0 and 1"),
        ({"ratio": -0.2}, "force ratio -0.2 is not"),
        ({"ratio": [0.3, math.nan]}, "force ratio nan is not"),
        ({"ratio": []}, "no force ratio is given"),
        ({"u": -0.01}, "uncertainty -0.01 is below 0"),
        ({"u": math.nan}, "uncertainty nan is below 0 or not finite"),
        ({"u": math.inf}, "uncertainty inf is below 0 or not finite"),
        ({"u": [0.1, 0.2, 0.3]}, r"uncertainties of shape \(3,\) do not go with ratios of shape \(2,\)"),
        ({"coverage": 1.0}, "coverage 1 is not between 0 and 1"),
        ({"coverage": math.nan}, "coverage nan is not"),
    ],
)
def test_a_ratio_that_is_none_is_refused(column: RatioCurve, wrong: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"ratio": [0.3, 0.5], "u": 0.01, **wrong}
    with pytest.raises(RangeError, match=message):
        modulus_of_ratio(column, **given)  # type: ignore[arg-type]


# --- Force ratios of a finite-element mesh over the modulus, and back ----------------------------------

LOWEST, HIGHEST = 24.0, 2.4e11


@pytest.fixture(scope="module")
def rising() -> RatioCurve:
    return pole_curve(curve_on(RoundParameters(), 3, 1), LOWEST, HIGHEST, "axisymmetric", 0.0)


def test_every_modulus_is_found_again_from_its_ratio(rising: RatioCurve) -> None:
    moduli = np.geomspace(5e3, 2e6, 200)
    found = modulus_of_ratio(rising, rising.force_ratio(moduli))
    assert found.modulus == pytest.approx(moduli, rel=1e-11)
    assert (found.low < moduli * (1 + 1e-11)).all()
    assert (found.high > moduli * (1 - 1e-11)).all()


def test_the_sensitivity_is_that_of_the_sum_of_poles(rising: RatioCurve) -> None:
    modulus, step = 1e5, 1e-4
    below, at, above = rising.force_ratio(modulus * np.exp([-step, 0, step]))
    assert modulus_of_ratio(rising, at).sensitivity == pytest.approx(2 * step * at / (above - below), rel=1e-6)


def test_a_curve_of_a_mesh_ends_where_it_is_asked_to(rising: RatioCurve) -> None:
    assert rising.moduli == pytest.approx((LOWEST, HIGHEST), rel=1e-12)
    assert len(rising.turns) == 2
    least, greatest = rising.ratios
    assert (least, greatest) == tuple(rising.force_ratio(np.array([LOWEST, HIGHEST])))


def test_a_ratio_that_rises_and_falls_again_has_its_turn_and_two_moduli() -> None:
    """1/(1 + E/1e3) - 1/(1 + E/1e6) is least at the geometric middle of 1e3 and 1e6 Pa, which is no node here."""
    hump = Curve(
        rates=np.array([1e-3, 1e-6]),
        loads=np.array([[1.0], [1.0]]),
        goals=np.zeros((2, 0)),
        offsets=np.zeros((0, 1)),
        ratio=np.array([-0.5, 0.5]),
        share=0.1,
        least=0.0,
        clamped=np.array([1.0]),
        charges=np.zeros((2, 0)),
        capacity=np.zeros((0, 0)),
    )
    curve = pole_curve(hump, 1.0, 3e9, "made up", 0.0)
    assert np.exp(curve.turns[1:-1]) == pytest.approx(10**4.5, rel=1e-6)
    found = modulus_of_ratio(curve, 0.4)
    assert found.ambiguous
    assert curve.force_ratio([float(found.low), float(found.high)]) == pytest.approx(0.4, abs=1e-12)
    assert found.low < 10**4.5 < found.high
