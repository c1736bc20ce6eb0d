"""Error estimates over the modulus of the object, from the curves of two made-up meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from palpate.instrument.models.axisymmetric import model as axisymmetric
from palpate.instrument.models.axisymmetric.model import REGULAR, SPECIAL
from palpate.instrument.models.finite_elements.error_estimate import Manner, estimates
from palpate.instrument.models.finite_elements.poles import Curve
from palpate.instrument.models.parameters import RoundParameters, SolidParameters
from palpate.instrument.models.solid import model as solid


def _one_pole(rate: float, ratio: float) -> Curve:
    """Of a made-up mesh."""
    return Curve(
        rates=np.array([rate]),
        loads=np.array([[0.5]]),
        goals=np.zeros((1, 0)),
        offsets=np.zeros((0, 1)),
        ratio=np.array([ratio]),
        share=0.1,
        least=0.0,
        clamped=np.array([1.0]),
        charges=np.array([[1e-9]]),
        capacity=np.array([[1e9]]),
    )


PLAIN = Manner(product=1.0, factors=(1.0,), voltages=(4.0,), luck=0.0)
BY_STEP = Manner(product=1.0, factors=(2.0, 1.0, 0.5), voltages=(4.0,), luck=0.12)


def _ratio_bound(curves: Sequence[Curve], modulus: float, manner: Manner = PLAIN) -> float:
    ratio, _ = estimates(curves, np.array([modulus]), manner)
    return float(ratio[0])


COARSE, FINE = _one_pole(1.2e-5, 1.02), _one_pole(1e-5, 1.0)


def test_many_moduli_have_the_bounds_of_each() -> None:
    moduli = np.array([3.1e4, 1e5, 7.7e8, 2.4, 1e5])
    ratio, voltage = estimates([COARSE, FINE], moduli, PLAIN)
    each = [estimates([COARSE, FINE], moduli[[place]], PLAIN) for place in range(len(moduli))]
    assert np.array_equal(np.concatenate(each, axis=1), [ratio, voltage])


@pytest.mark.parametrize("modulus", [1e4, 1.03e4, 9.9e3, 5.2e4])
def test_two_meshes_that_cross_at_a_modulus_are_told_apart_there(modulus: float) -> None:
    """The finer one's pole is moved so that both give the same ratio there."""
    crossing = 0.5 * 1.02 / (0.5 / (1 + 1e-5 * modulus)) - 1
    coarse = _one_pole(crossing / modulus, 1.02)
    at = np.array([modulus])
    assert coarse.force_ratios(at)[0, 0] == pytest.approx(FINE.force_ratios(at)[0, 0], abs=1e-15)
    near = modulus * np.array([10**-0.5, 10**0.5])
    apart = np.abs(coarse.force_ratios(near) - FINE.force_ratios(near)).max()
    assert _ratio_bound([coarse, FINE], modulus) >= apart > 1e-4


def test_the_bound_of_voltages_is_of_the_greatest_change_nearby() -> None:
    at = np.array([1e5 * 10**0.5])
    change = np.abs(COARSE.voltages(at) - FINE.voltages(at)).max()
    _, (voltage,) = estimates([COARSE, FINE], np.array([1e5]), PLAIN)
    assert voltage >= 4 * change > 0


def _constant(ratio: float) -> Curve:
    return replace(_one_pole(1e-5, 0.0), share=ratio)


def test_a_bound_falls_with_the_root_of_the_rate_where_errors_fall_regularly() -> None:
    meshes = [_constant(ratio) for ratio in (0.5, 0.4, 0.385, 0.38275)]
    bounds = [_ratio_bound(meshes[:k], 1e5, REGULAR) for k in (2, 3, 4)]
    assert bounds == pytest.approx([1.2 * 0.1, 1.4 * 0.015 * 0.15**0.5, 1.4 * 0.00225 * 0.15**0.5])


def test_each_step_of_the_meshes_has_its_factor_and_no_bound_falls_below_a_share_of_the_one_before() -> None:
    meshes = [_constant(ratio) for ratio in (0.5, 0.4, 0.36, 0.359, 0.359)]
    bounds = [_ratio_bound(meshes[:k], 1e5, BY_STEP) for k in (2, 3, 4, 5)]
    assert bounds == pytest.approx([2 * 0.1, 0.04, 0.12 * 0.04, 0.12 * 0.12 * 0.04])


def test_errors_that_hardly_fall_are_believed_to_add_up() -> None:
    meshes = [_constant(ratio) for ratio in (0.5, 0.4, 0.31)]
    assert _ratio_bound(meshes, 1e5, REGULAR) == pytest.approx(1.4 * 0.09 * 9)


@pytest.mark.parametrize("manner", [REGULAR, SPECIAL])
def test_meshes_that_agree_by_luck_leave_a_share_of_the_bounds_before(manner: Manner) -> None:
    at = np.array([1e5])
    before, after = (np.array(estimates(meshes, at, manner)) for meshes in ([COARSE, FINE], [COARSE, FINE, FINE]))
    assert after == pytest.approx(manner.luck * before)
    assert after.min() > 0


def test_energies_bound_a_ratio_that_two_meshes_agree_upon() -> None:
    """The load's changes by 3 J Pa over the modulus, most at the soft end of the window; the jump's by 2 J."""
    fine = replace(FINE, clamped=FINE.clamped + 3.0, least=FINE.least + 2.0)
    product = np.sqrt(3.0 / (1e5 * 10**-0.5) * 2.0)
    assert _ratio_bound([FINE, fine], 1e5) == pytest.approx(product)
    assert _ratio_bound([FINE, fine], 1e5, REGULAR) == pytest.approx(1.2 * 0.3 * product)


def test_what_rounding_may_change_is_added_to_the_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    bounds = []
    for rounded in ((0.0, 0.0), (0.5, 3.0)):
        monkeypatch.setattr(axisymmetric, "rounding", lambda *_, rounded=rounded: rounded)
        bounds.append(np.array(axisymmetric.estimates([COARSE, FINE], RoundParameters(), np.array([1e5]))).ravel())
    assert bounds[1] - bounds[0] == pytest.approx([0.5, 3.0])


def test_bounds_are_several_times_as_wide_where_a_gap_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """There the error only halves from mesh to mesh."""
    monkeypatch.setattr(axisymmetric, "rounding", lambda *_: (0.0, 0.0))
    narrow = RoundParameters(ring_inner_radius=1.005 * RoundParameters().tooth_radius)
    closed = replace(narrow, ring_inner_radius=narrow.tooth_radius)
    open_bounds, closed_bounds = (
        np.array(axisymmetric.estimates([COARSE, FINE], sensor, np.array([1e5]))) for sensor in (narrow, closed)
    )
    assert (closed_bounds / open_bounds).ravel() == pytest.approx([6 / 1.4, 24 / 8])
    assert open_bounds.min() > 0


FEW = SolidParameters()
MANY = SolidParameters(cell_length=12e-3, cell_width=12e-3, columns=3, rows=2)


@pytest.mark.parametrize(
    ("sensor", "product", "count", "factor", "of_voltages"),
    [
        (FEW, 0.05, 2, 1.5, 8.0),
        (FEW, 0.05, 3, 1.4, 6.0),
        (MANY, 0.15, 2, 2.0, 12.0),
        (MANY, 0.15, 3, 1.0, 8.0),
        (MANY, 0.15, 4, 0.5, 4.0),
    ],
)
@pytest.mark.parametrize(("inner", "thin", "times"), [(1.2, 0.11, 1.0), (1.04, 0.11, 4.0), (1.2, 0.09, 4.0)])
def test_the_solid_model_believes_its_meshes_as_its_decisions_say(
    sensor: SolidParameters,
    product: float,
    count: int,
    factor: float,
    of_voltages: float,
    inner: float,
    thin: float,
    times: float,
) -> None:
    """By their number and that of the teeth, and less where the gap is narrow or the object thin."""
    radius = sensor.tooth_radius
    sensor = replace(sensor, ring_inner_radius=inner * radius, sensed_thickness=thin * radius)
    at = np.array([1e5])
    ratio, voltage = estimates([COARSE, FINE], at, Manner(product, (1.0,), (1.0,), luck=0.0, reach=8))
    found = solid.estimates([COARSE, FINE, COARSE, FINE][-count:], sensor, at)
    assert found[0] - 1e-8 == pytest.approx(factor * times * ratio)
    assert found[1] == pytest.approx(of_voltages * times * voltage)


@pytest.mark.parametrize(("sensor", "luck"), [(FEW, 0.06), (MANY, 0.12)])
def test_the_solid_model_does_not_trust_meshes_that_hardly_differ(sensor: SolidParameters, luck: float) -> None:
    at = np.array([1e5])
    before, after = (np.array(solid.estimates(meshes, sensor, at)) for meshes in ([COARSE, FINE], [COARSE, FINE, FINE]))
    assert after - [[1e-8], [0.0]] == pytest.approx(luck * (before - [[1e-8], [0.0]]))
