"""Force ratios of a finite-element mesh over the modulus, and back."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.instrument.findings.object_modulus import modulus_of_ratio
from palpate.instrument.models.axisymmetric.curves import curve_on
from palpate.instrument.models.curve import RatioCurve, pole_curve
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import RoundParameters

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
